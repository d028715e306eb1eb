//! The tool as users run it: processes, exit codes, output.

mod info;
mod tool;
