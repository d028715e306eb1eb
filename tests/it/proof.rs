//! The core's streaming path neither panics nor allocates: the linker says so. See `tests/proof`.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// What a panic that can be reached leaves undefined.
const PANIC: &str = "__lobula_panic_reachable";
/// The firmware target, built with Debian's compiler, since rustup has no core for it here.
const ARM: &str = "thumbv7em-none-eabihf";
const ARM_RUSTC: &str = "/usr/bin/rustc";

fn proof() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("proof")
}

/// A target directory of the proof's own: cargo holds the lock of the one that this test was built in.
fn target_dir() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("proof")
}

/// `cargo build` of the proof in release, as far as a static library.
fn cargo(args: &[&str]) -> Command {
    let mut cargo = Command::new(env!("CARGO"));
    cargo
        .args(["build", "--release", "--locked", "--quiet", "--manifest-path"])
        .arg(proof().join("Cargo.toml"));
    cargo.arg("--target-dir").arg(target_dir()).args(args);
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
    succeeds(cargo(&[]));
    let linked = link("proof");
    let messages = String::from_utf8_lossy(&linked.stderr);
    assert!(linked.status.success(), "a panic can be reached from the functions named here:\n{messages}");

    succeeds(cargo(&["--features", "planted"]));
    let linked = link("planted");
    let messages = String::from_utf8_lossy(&linked.stderr);
    assert!(
        !linked.status.success() && messages.contains(PANIC),
        "a planted index was not found:\n{messages}"
    );
}

#[test]
fn the_streaming_path_builds_for_a_microcontroller() {
    let library = std::fs::read_dir("/usr/src").ok().and_then(|entries| {
        let named =
            |path: &PathBuf| path.file_name().is_some_and(|it| it.to_string_lossy().starts_with("rustc-"));
        entries.flatten().map(|entry| entry.path()).find(named)
    });
    if !Path::new(ARM_RUSTC).exists() || library.is_none() {
        eprintln!(
            "skipped: no {ARM_RUSTC} with its library's source (apt-get install rustc-web rust-web-src)"
        );
        return;
    }
    let mut cargo = cargo(&["--target", ARM, "-Zbuild-std=core,compiler_builtins"]);
    cargo.arg("-Zbuild-std-features=compiler-builtins-mem");
    cargo.arg("--target-dir").arg(target_dir().join("arm"));
    cargo.env("RUSTC", ARM_RUSTC).env("RUSTC_BOOTSTRAP", "1");
    succeeds(cargo);
}
