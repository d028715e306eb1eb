//! The tool as users run it: processes, exit codes, output.
#![allow(clippy::unwrap_used)] // helpers of tests may too

mod info;
mod tool;
