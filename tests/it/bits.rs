//! The law "same bits everywhere": digests of what every representation makes of a fixed stream, here and on aarch64
//! (under qemu-user). The firmware is compared with the same in `firmware`.

#[path = "../bits/src/bits.rs"]
mod stages;

use crate::toolchain::{cargo, is_there, rustc_for, skip, succeeds};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

const TARGET: &str = "aarch64-unknown-linux-gnu";
const QEMU: &str = "qemu-aarch64-static";
const LINKER: &str = "aarch64-linux-gnu-gcc";
/// How to get them; std for aarch64 is in a package of the same release as the compiler.
const HINT: &str = "apt-get install qemu-user-static gcc-aarch64-linux-gnu, and libstd-rust-web-dev:arm64";

/// Digests by name, as the program of `tests/bits` prints them.
pub fn on_this_machine() -> BTreeMap<String, String> {
    let mut digests = BTreeMap::new();
    stages::each(&mut stages::Memory::new(), |name, digest| {
        digests.insert(name.to_string(), format!("{digest:016x}"));
    });
    digests
}

/// Every stage makes something, and each something else.
#[test]
fn stages_are_told_apart() {
    let digests = on_this_machine();
    let none: Vec<&String> = digests
        .iter()
        .filter(|(_, digest)| u64::from_str_radix(digest, 16) == Ok(0))
        .map(|(name, _)| name)
        .collect();
    assert!(none.is_empty(), "nothing is made of {none:?}: give them parameters or memory in tests/bits");
    let mut different: Vec<&String> = digests.values().collect();
    different.sort();
    different.dedup();
    assert!(different.len() + 3 > digests.len(), "{digests:?}");
}

#[test]
#[ignore = "builds for another machine: .ci/run asks for it"]
fn aarch64_gives_the_same_bits() {
    let Some(rustc) = rustc_for(TARGET) else {
        return skip(&format!("no std for {TARGET} ({HINT})"));
    };
    if !is_there(QEMU) || !is_there(LINKER) {
        return skip(&format!("no {QEMU} or {LINKER} ({HINT})"));
    }
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("bits/Cargo.toml");
    let target_dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bits");
    let mut build = cargo(&manifest, &target_dir, &["--target", TARGET]);
    build.env("RUSTC", rustc).env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", LINKER);
    succeeds(build);
    let mut qemu = Command::new(QEMU);
    qemu.args(["-L", "/usr/aarch64-linux-gnu"]).arg(target_dir.join(TARGET).join("release/lobula-bits"));
    let said = String::from_utf8(succeeds(qemu).stdout).unwrap();
    let there: BTreeMap<String, String> = said
        .lines()
        .filter_map(|line| line.split_once('='))
        .map(|(name, digest)| (name.into(), digest.into()))
        .collect();
    let here = on_this_machine();
    println!("{} digests on {TARGET}, {} here", there.len(), here.len());
    assert_eq!(there, here);
}
