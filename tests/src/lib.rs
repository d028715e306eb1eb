//! What the tests of every crate share: where the real recordings are, what is in a RAW file, and Python with other libraries.

use std::path::{Path, PathBuf};
use std::process::Command;

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

/// The words of a RAW recording: what follows its header, whose lines begin with `%`.
pub fn words_of_raw(mut file: &[u8]) -> &[u8] {
    while file.first() == Some(&b'%') {
        let end = file.iter().position(|byte| *byte == b'\n').map_or(file.len(), |at| at + 1);
        file = &file[end..];
    }
    file
}

/// The interpreter of a Python environment with these packages and no other, made in `folder` (a test's
/// `CARGO_TARGET_TMPDIR` and a name) at the first run, and again when the list changes.
///
/// # Panics
/// Where Python 3 with venv or the package index is missing.
pub fn python(folder: &Path, packages: &[&str]) -> PathBuf {
    let (python, list) = (folder.join("bin/python"), folder.join("packages"));
    let wanted = packages.join("\n");
    if std::fs::read_to_string(&list).is_ok_and(|made| made == wanted) {
        return python;
    }
    let mut make = Command::new("python3");
    make.args(["-m", "venv", "--clear"]).arg(folder);
    let mut install = Command::new(&python);
    install.args(["-m", "pip", "install", "--quiet", "--no-deps", "--only-binary", ":all:"]).args(packages);
    for mut step in [make, install] {
        assert!(step.status().is_ok_and(|status| status.success()), "{step:?}");
    }
    std::fs::write(&list, wanted).expect("the environment's folder was made above");
    python
}

/// The README's examples are compiled with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
