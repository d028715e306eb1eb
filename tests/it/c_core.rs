//! The core's C library and header: a program without a C library gives what Rust gives of the same bytes, and the header
//! is C99 and C++.

use crate::firmware::crop_evt3;
use crate::toolchain::{cargo, run, succeeds};
use lobula_core::filter::{Denoise, DenoiseParams};
use lobula_core::representation::{Count, Dtype, IntegerTimeSurface, Pixel};
use lobula_core::{
    Counters, Decode, Event, Filter, Geometry, Representation, Sink, Window, for_each_representation,
    wire::evt3,
};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const GEOMETRY: Geometry = Geometry::new(320, 320);

fn core_c() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../core-nostd/c")
}

fn target_dir() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("core-c")
}

fn compiler(program: &str, args: &[&str]) -> Command {
    let mut cc = Command::new(program);
    cc.args(args).args(["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I"]).arg(core_c().join("include"));
    cc
}

/// The example, with nothing but the four functions that compilers take for granted.
fn example() -> PathBuf {
    succeeds(cargo(&core_c().join("Cargo.toml"), &target_dir(), &[]));
    let program = target_dir().join("pipeline");
    let examples = core_c().join("examples");
    let mut cc =
        compiler("cc", &["-std=c99", "-O1", "-nostdlib", "-static", "-ffreestanding", "-fno-builtin"]);
    cc.args(["-fno-stack-protector", "-Wl,--gc-sections"]);
    cc.arg(examples.join("pipeline.c")).arg(examples.join("linux_x86_64.c"));
    cc.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("proof/mem.c"));
    cc.arg(target_dir().join("release/liblobula_core.a")).arg("-o").arg(&program);
    succeeds(cc);
    program
}

fn words(counters: &Counters) -> Vec<u8> {
    let Counters { bytes_decoded, bytes_faulty, events, off_sensor, triggers, .. } = *counters;
    let words = [bytes_decoded, bytes_faulty, events, off_sensor, triggers, counters.faults.total()];
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// What the example does, in Rust and in one go.
fn expected(bytes: &[u8], window: Window) -> Vec<u8> {
    let mut decoder = evt3::Decoder::new(GEOMETRY);
    let mut memory = vec![Event::default(); bytes.len()];
    let mut sink = Sink::new(&mut memory);
    assert_eq!(decoder.decode(bytes, &mut sink), bytes.len());
    let mut block = sink.block(GEOMETRY);
    let params =
        DenoiseParams { refractory_us: 200, support_us: 2_000, shift: 4, ..DenoiseParams::default() };
    let memory = vec![0; Denoise::<u16, ()>::required_len(GEOMETRY)];
    let mut filter = Denoise::<u16, _>::try_new(GEOMETRY, params, memory).unwrap();
    assert!(filter.mask(160, 160));
    filter.retain(&mut block).unwrap();
    assert!(block.len() > 1_000);

    fn draw<R: Representation<Pixel = u8>>(
        mut stage: R,
        window: Window,
        block: &lobula_core::Block<'_>,
    ) -> Vec<u8> {
        let mut out = vec![0xA5; stage.shape().len()];
        stage.begin(window, &mut out);
        stage.accumulate(block.span(), &mut out).unwrap();
        stage.finish(&mut out);
        out
    }
    let state = vec![0; IntegerTimeSurface::<()>::state_len(GEOMETRY)];
    let surface = IntegerTimeSurface::try_new(GEOMETRY, 3_000, state).unwrap();
    [
        words(decoder.counters()),
        draw(Count::<u8>::new(GEOMETRY), window, &block),
        draw(surface, window, &block),
    ]
    .concat()
}

#[test]
#[cfg(target_arch = "x86_64")]
#[ignore = "builds the library: .ci/run asks for it"]
fn c_firmware_gives_the_bits_of_rust_and_cannot_panic() {
    let Some((bytes, t_first, t_last)) = crop_evt3() else { return };
    let window = Window { t0: t_first, t1: t_last + 1 };
    let program = example();
    assert_no_panic(&program);
    let input = [&window.t0.to_le_bytes()[..], &window.t1.to_le_bytes(), &bytes].concat();
    let mut child = Command::new(program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let writer = std::thread::spawn(move || stdin.write_all(&input));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stdout == expected(&bytes, window), "C and Rust differ");
}

/// Names before brackets, as far as they begin like ours.
fn functions(c: &str) -> BTreeSet<&str> {
    let before_brackets =
        c.split('(').filter_map(|text| text.rsplit(|c: char| !c.is_alphanumeric() && c != '_').next());
    before_brackets.filter(|name| name.starts_with("lobula_")).collect()
}

#[test]
#[ignore = "builds the library: .ci/run asks for it"]
fn the_library_has_what_the_header_declares() {
    const INLINE: [&str; 3] = ["lobula_event_y", "lobula_event_is_on", "lobula_event_time"];
    succeeds(cargo(&core_c().join("Cargo.toml"), &target_dir(), &[]));
    let mut nm = Command::new("nm");
    nm.args(["--defined-only", "--format=just-symbols"]).arg(target_dir().join("release/liblobula_core.a"));
    let symbols = String::from_utf8_lossy(&succeeds(nm).stdout).into_owned();
    let symbols: BTreeSet<&str> = symbols.lines().filter(|name| name.starts_with("lobula_")).collect();
    let mut cc = compiler("cc", &["-E", "-P"]);
    cc.arg(core_c().join("include/lobula_core.h"));
    let header = String::from_utf8_lossy(&succeeds(cc).stdout).into_owned();
    let mut declared = functions(&header);
    INLINE.iter().for_each(|name| assert!(declared.remove(name), "{name}"));
    assert!(declared.len() > 200);
    assert_eq!(declared, symbols);
}

#[test]
fn the_header_has_every_representation() {
    macro_rules! all {
        ($($name:ident $kind:ident $type:ty;)*) => {
            [$((stringify!($name), <$type as Representation>::Pixel::DTYPE),)*]
        };
    }
    let header = std::fs::read_to_string(core_c().join("include/lobula_core.h")).unwrap();
    for (name, dtype) in for_each_representation!(all, Vec<u32>) {
        let snake = name.replace(char::is_uppercase, "_$");
        let initials = name.chars().filter(|c| c.is_uppercase()).map(|c| c.to_ascii_lowercase().to_string());
        let snake = initials.fold(snake, |name, initial| name.replacen('$', &initial, 1));
        let pixel = match dtype {
            Dtype::U8 => "uint8_t",
            Dtype::U16 => "uint16_t",
            Dtype::F16 => "lobula_f16",
            Dtype::F32 => "float",
        };
        let line = format!("LOBULA_REPRESENTATION({}, {pixel})\n", snake.trim_start_matches('_'));
        assert!(header.contains(&line), "{line} is missing");
    }
}

/// No panic is left in what the example links.
fn assert_no_panic(program: &Path) {
    let mut nm = Command::new("nm");
    nm.arg(program);
    let symbols = String::from_utf8(succeeds(nm).stdout).unwrap();
    assert!(symbols.contains("lobula_evt3_decode"));
    let unwanted: Vec<&str> =
        symbols.lines().filter(|line| line.contains("panic") || line.contains("__rust_alloc")).collect();
    assert!(unwanted.is_empty(), "{unwanted:?}");
}

#[test]
fn the_header_is_c99_and_cpp() {
    let header = core_c().join("include/lobula_core.h");
    let languages: [(&str, &[&str]); 3] = [
        ("cc", &["-std=c99", "-x", "c", "-fsyntax-only"]),
        ("cc", &["-std=c11", "-x", "c", "-fsyntax-only"]),
        ("c++", &["-std=c++11", "-x", "c++", "-fsyntax-only"]),
    ];
    for (program, args) in languages {
        if Command::new(program).arg("--version").output().is_err() {
            eprintln!("skipped: no {program}");
            continue;
        }
        let mut cc = compiler(program, args);
        cc.arg(&header);
        let output = run(cc);
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
}
