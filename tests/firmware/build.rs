//! Puts the board's memory and the events to work on where the compiler and the linker find them.

use std::env::var;
use std::fs;
use std::path::PathBuf;

/// Made by tests/it/firmware.rs from a recording.
const INPUTS: [&str; 3] = ["crop.evt3", "crop.evt2", "whole.evt3"];

fn main() {
    let out = PathBuf::from(var("OUT_DIR").expect("cargo sets OUT_DIR"));
    let target = var("TARGET").expect("cargo sets TARGET");
    let board = match &target[..] {
        "thumbv7em-none-eabihf" => "mps2",
        "thumbv6m-none-eabi" => "microbit",
        "riscv32imac-unknown-none-elf" => "virt",
        other => panic!("no board for {other}"),
    };
    println!("cargo:rustc-check-cfg=cfg(board, values(\"mps2\", \"microbit\", \"virt\"))");
    println!("cargo:rustc-cfg=board=\"{board}\"");
    let memory = format!("memory/{board}.x");
    fs::copy(&memory, out.join("memory.x")).unwrap_or_else(|error| panic!("{memory}: {error}"));
    println!("cargo:rerun-if-changed={memory}");
    println!("cargo:rustc-link-search={}", out.display());
    let scripts: &[&str] =
        if board == "virt" { &["-Tmemory.x", "-Tlink.x"] } else { &["--nmagic", "-Tlink.x"] };
    scripts.iter().for_each(|argument| println!("cargo:rustc-link-arg-bins={argument}"));

    println!("cargo:rerun-if-env-changed=LOBULA_FIRMWARE_INPUT");
    let folder = PathBuf::from(
        var("LOBULA_FIRMWARE_INPUT").expect("set LOBULA_FIRMWARE_INPUT: tests/it/firmware.rs does"),
    );
    for input in INPUTS {
        let from = folder.join(input);
        println!("cargo:rerun-if-changed={}", from.display());
        fs::copy(&from, out.join(input)).unwrap_or_else(|error| panic!("{}: {error}", from.display()));
    }
}
