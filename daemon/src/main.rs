//! The binary of the installed service.

fn main() {}
