//! Wire formats: the bytes that cameras send, decoded and encoded.

pub mod evt3;
