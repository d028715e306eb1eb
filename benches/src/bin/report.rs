//! Each operation beside the same one of its peer.

fn main() {}
