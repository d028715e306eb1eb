//! The daemon as a library, so that one binary can also serve.

pub mod clock;
pub mod config;
pub mod pipeline;
pub mod source;
