//! Compilers and linkers for other machines than this one: rustup's have no core for them here; Debian's has the source.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// `$LOBULA_ARM_RUSTC`, else Debian's compiler, if it has the source of core.
pub fn rustc() -> Option<PathBuf> {
    let rustc =
        std::env::var_os("LOBULA_ARM_RUSTC").map_or_else(|| PathBuf::from("/usr/bin/rustc"), PathBuf::from);
    let core = sysroot(&rustc)?.join("lib/rustlib/src/rust/library/core");
    core.exists().then_some(rustc)
}

/// How to get it.
pub const RUSTC_HINT: &str = "apt-get install rustc-web rust-web-src, or set LOBULA_ARM_RUSTC";

fn sysroot(rustc: &Path) -> Option<PathBuf> {
    let output = Command::new(rustc).args(["--print", "sysroot"]).output().ok()?;
    output.status.success().then(|| PathBuf::from(String::from_utf8_lossy(&output.stdout).trim()))
}

/// The same compiler, if it has a std for the target.
pub fn rustc_for(target: &str) -> Option<PathBuf> {
    let rustc = rustc()?;
    let std = sysroot(&rustc)?.join("lib/rustlib").join(target).join("lib");
    std.exists().then_some(rustc)
}

/// 64-bit ARM Linux, its linker, and what runs its programs here.
pub const AARCH64: &str = "aarch64-unknown-linux-gnu";
const AARCH64_LINKER: &str = "aarch64-linux-gnu-gcc";
const AARCH64_QEMU: &str = "qemu-aarch64-static";
/// What is missing where nothing can be built for it, and how to get it: std is in a package of the same release as the
/// compiler.
pub const AARCH64_HINT: &str = "no aarch64-unknown-linux-gnu (apt-get install qemu-user-static gcc-aarch64-linux-gnu, \
     and libstd-rust-web-dev:arm64)";

/// A program of `tests/bits`, built for it; `None` where there is no toolchain.
pub fn aarch64_program(name: &str) -> Option<PathBuf> {
    let rustc = rustc_for(AARCH64).filter(|_| is_there(AARCH64_QEMU) && is_there(AARCH64_LINKER))?;
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("bits/Cargo.toml");
    let target_dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bits");
    let mut build = cargo(&manifest, &target_dir, &["--target", AARCH64]);
    build.env("RUSTC", rustc).env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", AARCH64_LINKER);
    succeeds(build);
    Some(target_dir.join(AARCH64).join("release").join(name))
}

/// What runs it.
pub fn qemu_aarch64() -> Command {
    let mut qemu = Command::new(AARCH64_QEMU);
    qemu.args(["-L", "/usr/aarch64-linux-gnu"]);
    qemu
}

/// rustup's linker, which knows every target.
pub fn rust_lld() -> Option<PathBuf> {
    let host = sysroot(Path::new("rustc"))?.join("lib/rustlib");
    let linkers = std::fs::read_dir(host).ok()?.flatten().map(|entry| entry.path().join("bin/rust-lld"));
    linkers.into_iter().find(|linker| linker.exists())
}

/// Whether a program can be started.
pub fn is_there(program: impl AsRef<OsStr>) -> bool {
    Command::new(program).arg("--version").output().is_ok()
}

/// `cargo build` in release of a manifest that is a workspace of its own, with the plain flags.
pub fn cargo(manifest: &Path, target_dir: &Path, args: &[&str]) -> Command {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["build", "--release", "--locked", "--quiet", "--manifest-path"]).arg(manifest);
    cargo.arg("--target-dir").arg(target_dir).args(args);
    cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS");
    cargo
}

/// The same for a machine without a std, whose core is built from source. Another compiler, so another target
/// directory, or each would undo the other's work.
pub fn cargo_for(target: &str, manifest: &Path, target_dir: &Path, rustc: &Path) -> Command {
    let mut cargo = cargo(manifest, target_dir, &["--target", target, "-Zbuild-std=core,compiler_builtins"]);
    cargo.arg("-Zbuild-std-features=compiler-builtins-mem");
    cargo.env("RUSTC", rustc).env("RUSTC_BOOTSTRAP", "1");
    cargo
}

pub fn run(mut command: Command) -> Output {
    command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"))
}

#[track_caller]
pub fn succeeds(command: Command) -> Output {
    let shown = format!("{command:?}");
    let output = run(command);
    let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{shown}\n{}{}", said(&output.stdout), said(&output.stderr));
    output
}

/// Says in one line why a test is skipped; with CI=true that is a failure.
#[track_caller]
pub fn skip(why: &str) {
    let ci = std::env::var_os("CI").is_some_and(|ci| ci == "true");
    assert!(!ci, "CI=true but {why}");
    eprintln!("skipped: {why}");
}
