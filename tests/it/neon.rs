//! What the decoders' kernels for 64-bit ARM CPUs gain over the portable ones: instructions an event, since there is no
//! such CPU here to tell the time. That they decode the same is tested beside them (`.ci/run` runs these tests there).

use crate::toolchain::{AARCH64_HINT, aarch64_program, qemu_aarch64, skip};
use std::io::Read;
use std::path::Path;
use std::process::Stdio;

/// Encoding, size of the sensor, recording, and of the portable kernel's instructions how many percent NEON may take.
const RECORDINGS: [(&str, [&str; 2], &str, u64); 4] = [
    ("evt2", ["640", "480"], "evt2_gen3_640x480.raw", 60),
    ("evt21", ["1280", "720"], "evt21_le_1280x720.raw", 50),
    ("evt3", ["1280", "720"], "evt3_gen41_1280x720.raw", 75),
    ("evt3", ["1280", "720"], "evt3_trigger_1280x720.raw", 50),
];
/// What is decoded of each: every instruction of it is a line of text that QEMU writes.
const BYTES: usize = 32 << 10;

#[test]
#[ignore = "builds for another machine: .ci/run asks for it"]
fn neon_takes_fewer_instructions_than_the_portable_kernels() {
    let Some(program) = aarch64_program("lobula-decode") else {
        return skip(AARCH64_HINT);
    };
    let directory = tempfile::tempdir().unwrap();
    for (encoding, size, name, percent_max) in RECORDINGS {
        let Some(path) = lobula_tests::data(name) else { continue };
        let words = directory.path().join(name);
        let file = std::fs::read(path).unwrap();
        std::fs::write(&words, lobula_tests::words_of_raw(&file).get(..BYTES).unwrap()).unwrap();
        let [portable, neon] = ["Portable", "Neon"].map(|kernel| {
            let (once, events) = instructions(&program, [encoding, kernel, size[0], size[1], "1"], &words);
            let (twice, _) = instructions(&program, [encoding, kernel, size[0], size[1], "2"], &words);
            100 * (twice - once) / events
        });
        let shown = |n: u64| format!("{}.{:02}", n / 100, n % 100);
        println!("{name}: portable {}, NEON {} instructions an event", shown(portable), shown(neon));
        assert!(100 * neon <= percent_max * portable, "{name}");
    }
}

/// How many instructions the program executes in all, and how many events it tells. QEMU translates one instruction at a
/// time and writes a line for each that it executes.
fn instructions(program: &Path, arguments: [&str; 5], words: &Path) -> (u64, u64) {
    let mut qemu = qemu_aarch64();
    qemu.args(["-singlestep", "-d", "nochain,exec"]).arg(program).args(arguments).arg(words);
    let mut child = qemu.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let (mut lines, mut buffer) = (0, vec![0; 1 << 16]);
    let mut log = child.stderr.take().unwrap();
    while let n @ 1.. = log.read(&mut buffer).unwrap() {
        lines += buffer[..n].iter().filter(|byte| **byte == b'\n').count() as u64;
    }
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{qemu:?}");
    (lines, String::from_utf8(output.stdout).unwrap().trim().parse().unwrap())
}
