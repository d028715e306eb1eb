//! The core's streaming path neither panics nor allocates: the linker says so. See `tests/proof`.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// What a panic that can be reached leaves undefined.
const PANIC: &str = "__lobula_panic_reachable";
/// The firmware target: a Cortex-M4. rustup's compiler has no core for it here; Debian's has the source of its core.
const ARM: &str = "thumbv7em-none-eabihf";

fn proof() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("proof")
}

/// A target directory of the proof's own: cargo holds the lock of the one that this test was built in.
fn target_dir() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("proof")
}

/// `cargo build` of the proof in release, as far as a static library.
fn cargo(target_dir: &Path, args: &[&str]) -> Command {
    let mut cargo = Command::new(env!("CARGO"));
    cargo
        .args(["build", "--release", "--locked", "--quiet", "--manifest-path"])
        .arg(proof().join("Cargo.toml"));
    cargo.arg("--target-dir").arg(target_dir).args(args);
    // The proof is of the plain build, whatever flags the tests run with.
    cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS");
    cargo
}

fn run(mut command: Command) -> Output {
    command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"))
}

#[track_caller]
fn succeeds(command: Command) {
    let shown = format!("{command:?}");
    let output = run(command);
    assert!(output.status.success(), "{shown}\n{}", String::from_utf8_lossy(&output.stderr));
}

/// Links the library built last with nothing but the four functions that compilers take for granted.
fn link(name: &str) -> Output {
    let mut cc = Command::new("cc");
    cc.args(["-O1", "-nostdlib", "-static", "-ffreestanding", "-fno-builtin"]);
    cc.args(["-Wl,--gc-sections", "-Wl,--entry=lobula_proof"]);
    cc.arg(proof().join("mem.c")).arg(target_dir().join("release/liblobula_proof.a"));
    cc.arg("-o").arg(target_dir().join(name));
    run(cc)
}

/// One test, since both builds make the same library.
#[test]
fn nothing_that_streams_can_panic_or_allocate() {
    succeeds(cargo(&target_dir(), &[]));
    let linked = link("proof");
    let messages = String::from_utf8_lossy(&linked.stderr);
    assert!(linked.status.success(), "a panic can be reached from the functions named here:\n{messages}");

    succeeds(cargo(&target_dir(), &["--features", "planted"]));
    let linked = link("planted");
    let messages = String::from_utf8_lossy(&linked.stderr);
    assert!(
        !linked.status.success() && messages.contains(PANIC),
        "a planted index was not found:\n{messages}"
    );
}

/// `$LOBULA_ARM_RUSTC`, else Debian's compiler, if it has the source of core.
fn arm_rustc() -> Option<PathBuf> {
    let rustc =
        std::env::var_os("LOBULA_ARM_RUSTC").map_or_else(|| PathBuf::from("/usr/bin/rustc"), PathBuf::from);
    let core = sysroot(&rustc)?.join("lib/rustlib/src/rust/library/core");
    core.exists().then_some(rustc)
}

fn sysroot(rustc: &Path) -> Option<PathBuf> {
    let output = Command::new(rustc).args(["--print", "sysroot"]).output().ok()?;
    output.status.success().then(|| PathBuf::from(String::from_utf8_lossy(&output.stdout).trim()))
}

/// rustup's linker, which knows every target.
fn rust_lld() -> Option<PathBuf> {
    let host = sysroot(Path::new("rustc"))?.join("lib/rustlib");
    let linkers = std::fs::read_dir(host).ok()?.flatten().map(|entry| entry.path().join("bin/rust-lld"));
    linkers.into_iter().find(|linker| linker.exists())
}

#[test]
fn nor_can_it_on_a_microcontroller() {
    let Some(rustc) = arm_rustc() else {
        eprintln!(
            "skipped: no compiler for {ARM} (apt-get install rustc-web rust-web-src, or set LOBULA_ARM_RUSTC)"
        );
        return;
    };
    let target_dir = target_dir().join("arm");
    let mut cargo = cargo(&target_dir, &["--target", ARM, "-Zbuild-std=core,compiler_builtins"]);
    cargo.arg("-Zbuild-std-features=compiler-builtins-mem");
    // Another compiler, so another target directory, or each would undo the other's work.
    cargo.env("RUSTC", rustc).env("RUSTC_BOOTSTRAP", "1");
    succeeds(cargo);
    let Some(linker) = rust_lld() else {
        eprintln!("skipped: built for {ARM}, but rustup's toolchain has no rust-lld to link it with");
        return;
    };
    let mut lld = Command::new(linker);
    lld.args(["-flavor", "gnu", "--gc-sections", "--entry=lobula_proof"]);
    lld.arg(target_dir.join(ARM).join("release/liblobula_proof.a")).arg("-o").arg(target_dir.join("proof"));
    succeeds(lld);
}
