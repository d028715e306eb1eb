//! What the tests of every crate share: where the real recordings are.

use std::path::{Path, PathBuf};

/// The file `name` of the shared recordings: in `$LOBULA_SHARED/data`, else in `../shared/data` beside the repository.
///
/// `None`, with one line that says so, where the recordings are absent (a user's clone).
///
/// # Panics
/// Where they are absent with CI=true: there a skipped test is a failure.
pub fn data(name: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("LOBULA_SHARED").map_or_else(beside_the_repository, PathBuf::from);
    let path = shared.join("data").join(name);
    if path.exists() {
        return Some(path);
    }
    let ci = std::env::var_os("CI").is_some_and(|ci| ci == "true");
    assert!(
        !ci,
        "CI=true but {} is absent: set LOBULA_SHARED to the folder that holds data/",
        path.display()
    );
    eprintln!("skipped: {} is absent (set LOBULA_SHARED to the folder that holds data/)", path.display());
    None
}

fn beside_the_repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared")
}

/// The README's examples are compiled with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
