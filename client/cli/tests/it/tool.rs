//! Runs the tool.

use std::path::PathBuf;
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

/// A file of the shared test data; none, with a line, where it is absent.
pub fn shared(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("LOBULA_SHARED").map(PathBuf::from);
    let root = root.unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared"));
    let path = root.join("data").join(name);
    if path.exists() {
        return Some(path);
    }
    assert!(
        std::env::var_os("CI").is_none_or(|ci| ci != "true"),
        "{} is needed with CI=true",
        path.display()
    );
    eprintln!("skipped: {} is not there; set LOBULA_SHARED", path.display());
    None
}
