//! The core's streaming path neither panics nor allocates: the linker says so. See `tests/proof`.

use crate::toolchain::{RUSTC_HINT, cargo, cargo_for, run, rust_lld, rustc, skip, succeeds};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// What a panic that can be reached leaves undefined.
const PANIC: &str = "__lobula_panic_reachable";
/// The firmware target: a Cortex-M4.
const ARM: &str = "thumbv7em-none-eabihf";

fn proof() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("proof")
}

/// A target directory of the proof's own: cargo holds the lock of the one that this test was built in.
fn target_dir() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("proof")
}

/// Links what can be reached from `root` with nothing but the four functions that compilers take for granted.
fn link(root: &str) -> Output {
    let mut cc = Command::new("cc");
    cc.args(["-O1", "-nostdlib", "-static", "-ffreestanding", "-fno-builtin", "-Wl,--gc-sections"]);
    cc.arg(format!("-Wl,--entry={root}"));
    cc.arg(proof().join("mem.c")).arg(target_dir().join("release/liblobula_proof.a"));
    cc.arg("-o").arg(target_dir().join(root));
    run(cc)
}

#[test]
fn nothing_that_streams_can_panic_or_allocate() {
    succeeds(cargo(&proof().join("Cargo.toml"), &target_dir(), &[]));
    let linked = link("lobula_proof");
    let messages = String::from_utf8_lossy(&linked.stderr);
    assert!(linked.status.success(), "a panic can be reached from the functions named here:\n{messages}");

    let linked = link("lobula_planted");
    let messages = String::from_utf8_lossy(&linked.stderr);
    assert!(
        !linked.status.success() && messages.contains(PANIC),
        "a planted index was not found:\n{messages}"
    );
}

#[test]
#[ignore = "builds core for another machine: .ci/run asks for it"]
fn nor_can_it_on_a_microcontroller() {
    let Some(rustc) = rustc() else {
        return skip(&format!("no compiler for {ARM} ({RUSTC_HINT})"));
    };
    let target_dir = target_dir().join("arm");
    succeeds(cargo_for(ARM, &proof().join("Cargo.toml"), &target_dir, &rustc));
    let Some(linker) = rust_lld() else {
        return skip(&format!("built for {ARM}, but rustup's toolchain has no rust-lld to link it with"));
    };
    let mut lld = Command::new(linker);
    lld.args(["-flavor", "gnu", "--gc-sections", "--entry=lobula_proof"]);
    lld.arg(target_dir.join(ARM).join("release/liblobula_proof.a")).arg("-o").arg(target_dir.join("proof"));
    succeeds(lld);
}
