//! The law "same bits everywhere": digests of what every representation makes of a fixed stream, here and on aarch64
//! (under qemu-user). The firmware is compared with the same in `firmware`.

#[path = "../bits/src/bits.rs"]
mod stages;

use crate::toolchain::{AARCH64, AARCH64_HINT, aarch64_program, qemu_aarch64, skip, succeeds};
use std::collections::BTreeMap;

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
    let Some(program) = aarch64_program("lobula-bits") else {
        return skip(AARCH64_HINT);
    };
    let mut qemu = qemu_aarch64();
    qemu.arg(program);
    let said = String::from_utf8(succeeds(qemu).stdout).unwrap();
    let there: BTreeMap<String, String> = said
        .lines()
        .filter_map(|line| line.split_once('='))
        .map(|(name, digest)| (name.into(), digest.into()))
        .collect();
    let here = on_this_machine();
    println!("{} digests on {AARCH64}, {} here", there.len(), here.len());
    assert_eq!(there, here);
}
