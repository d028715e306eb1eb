//! Runs the tool.

use std::process::{Command, Output};

/// The tool, to be given arguments.
pub fn lobula() -> Command {
    Command::new(env!("CARGO_BIN_EXE_lobula"))
}

/// Runs the tool to its end.
pub fn run(args: &[&str]) -> Output {
    lobula().args(args).output().expect("the tool starts")
}

/// The exit code and what was said about it.
pub fn failure(output: &Output) -> (i32, String) {
    assert!(output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stdout));
    (output.status.code().unwrap_or(-1), String::from_utf8(output.stderr.clone()).unwrap())
}
