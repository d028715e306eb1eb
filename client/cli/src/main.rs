//! The `lobula` binary.

fn main() {}
