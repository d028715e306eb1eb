//! The firmware of `tests/firmware`, built for four microcontrollers and run in QEMU: what leaves over its link is what
//! this machine makes of the same bytes with the same Spec, and its memory and instructions are within bounds.
//!
//! Takes a minute or two of building when cold, so `.ci/run` asks for it: `cargo test -p lobula-tests -- --ignored firmware`.

#[path = "../firmware/src/job.rs"]
mod job;

use crate::bits::on_this_machine;
use crate::toolchain::{RUSTC_HINT, cargo_for, is_there, run, rust_lld, rustc, skip};
use job::{Digest, GEOMETRY, LOST, PACKET_BYTES, PERIOD_US, SLOTS, Sender};
use lobula_core::chain::{Offline, View, ViewSpec};
use lobula_core::filter::DoubleWindow;
use lobula_core::link::{Message, serial};
use lobula_core::representation::{Dtype, Kind};
use lobula_core::ring::Rejected;
use lobula_core::wire::{AnyDecoder, AnyEncoder, Encoding, evt2};
use lobula_core::{Decode, Encode, Event, Filter, Sink, Span};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

const RECORDING: &str = "evt3_gen41_1280x720.raw";
/// Where the crop begins on the sensor, and how much of the recording is taken.
const ORIGIN: (u16, u16) = (960, 200);
const LENGTH_US: u64 = 9_000;
const EVENTS_MAX: usize = 40_000;
/// Of the words of the whole sensor.
const WHOLE_BYTES: usize = 200_000;

/// A board: how QEMU is told of it, what runs on it, and the most that it may take.
struct Board {
    name: &'static str,
    target: &'static str,
    qemu: &'static [&'static str],
    jobs: &'static [&'static str],
    /// Bytes, or hundredths of an instruction per event.
    limits: &'static [(&'static str, u64)],
}

impl Board {
    fn is_small(&self) -> bool {
        self.target.starts_with("thumbv6m")
    }
}

const KIB: u64 = 1024;

/// Instructions, in hundredths.
const fn per_event(instructions: u64) -> u64 {
    100 * instructions
}

const QEMU_ARM: &str = "qemu-system-arm";
const QEMU_RISCV: &str = "qemu-system-riscv32";

/// Cortex-M4 and M7 run the same program.
const LIMITS_ARMV7: &[(&str, u64)] = &[
    ("state_bytes", 350 * KIB),
    ("decode_evt3", per_event(40)),
    ("decode_evt3_whole", per_event(40)),
    ("decode_evt2", per_event(22)),
    ("denoise", per_event(120)),
    ("count", per_event(16)),
    ("time_surface", per_event(36)),
];

const BOARDS: [Board; 4] = [
    Board {
        name: "Cortex-M4 (mps2-an386)",
        target: "thumbv7em-none-eabihf",
        qemu: &[QEMU_ARM, "-M", "mps2-an386"],
        jobs: &["evt3", "evt2"],
        limits: LIMITS_ARMV7,
    },
    Board {
        name: "Cortex-M7 (mps2-an500)",
        target: "thumbv7em-none-eabihf",
        qemu: &[QEMU_ARM, "-M", "mps2-an500"],
        jobs: &["evt3", "evt2"],
        limits: LIMITS_ARMV7,
    },
    Board {
        name: "RISC-V (virt, riscv32imac)",
        target: "riscv32imac-unknown-none-elf",
        qemu: &[QEMU_RISCV, "-M", "virt", "-bios", "none"],
        jobs: &["evt3", "evt2"],
        limits: &[
            ("state_bytes", 350 * KIB),
            ("decode_evt3", per_event(47)),
            ("decode_evt3_whole", per_event(47)),
            ("decode_evt2", per_event(35)),
            ("denoise", per_event(135)),
            ("count", per_event(16)),
            ("time_surface", per_event(36)),
        ],
    },
    Board {
        name: "Cortex-M0 (microbit)",
        target: "thumbv6m-none-eabi",
        qemu: &[QEMU_ARM, "-M", "microbit"],
        jobs: &["evt2"],
        limits: &[
            ("ram_bytes", 12 * KIB),
            ("state_bytes", 12 * KIB),
            ("decode_evt2", per_event(46)),
            ("double_window", per_event(3000)),
        ],
    },
];

/// The bytes that the boards work on.
struct Inputs {
    folder: PathBuf,
    crops: BTreeMap<&'static str, (Encoding, Vec<u8>)>,
}

impl Inputs {
    /// From a recording, in files for the build.
    fn make(recording: &Path, folder: PathBuf) -> Self {
        let events = crop(recording);
        let encoded = |encoding| (encoding, encode(&events, encoding));
        let crops = BTreeMap::from([("evt3", encoded(Encoding::Evt3)), ("evt2", encoded(Encoding::Evt2))]);
        std::fs::create_dir_all(&folder).unwrap();
        for (name, (_, bytes)) in &crops {
            write(&folder.join(format!("crop.{name}")), bytes);
        }
        let raw = std::fs::read(recording).unwrap();
        write(&folder.join("whole.evt3"), &lobula_tests::words_of_raw(&raw)[..WHOLE_BYTES]);
        Self { folder, crops }
    }
}

/// Unless it is there already, so that the firmware is not built again.
fn write(path: &Path, bytes: &[u8]) {
    if std::fs::read(path).ok().as_deref() != Some(bytes) {
        std::fs::write(path, bytes).unwrap();
    }
}

/// The first events of a part of the sensor.
fn crop(recording: &Path) -> Vec<(u64, Event)> {
    let recording = lobula_formats::open(recording).unwrap();
    let mut slice = recording.slice_time(0..u64::MAX).unwrap();
    let mut events: Vec<(u64, Event)> = vec![];
    while let Some(chunk) = slice.next_block().unwrap() {
        let span = chunk.block.span();
        for event in span.events {
            let (x, y) = (event.x().wrapping_sub(ORIGIN.0), event.y().wrapping_sub(ORIGIN.1));
            let t = span.time(*event);
            if events.len() == EVENTS_MAX || events.first().is_some_and(|(first, _)| t > first + LENGTH_US) {
                return events;
            }
            if GEOMETRY.contains(x, y) {
                events.push((t, Event::new(t as u32, x, y, event.polarity())));
            }
        }
    }
    events
}

/// The crop as EVT3, and when it begins and ends; for other tests too.
pub fn crop_evt3() -> Option<(Vec<u8>, u64, u64)> {
    let events = crop(&lobula_tests::data(RECORDING)?);
    Some((encode(&events, Encoding::Evt3), events[0].0, events[events.len() - 1].0))
}

fn encode(timed: &[(u64, Event)], encoding: Encoding) -> Vec<u8> {
    let events: Vec<Event> = timed.iter().map(|(_, event)| *event).collect();
    let (t_first, t_last) = (timed[0].0, timed[timed.len() - 1].0);
    let mut out = vec![0; 16 * events.len() + 64];
    let mut encoder = AnyEncoder::new(encoding);
    let done = encoder.encode(Span { t_first, t_last, geometry: GEOMETRY, events: &events }, &mut out);
    assert_eq!((done.events, done.refused), (events.len(), None));
    let end = done.bytes + encoder.finish(&mut out[done.bytes..]);
    out.truncate(end);
    out
}

/// Packets that find the ring full, as the firmware arranges it.
fn lost(bytes: &[u8]) -> std::ops::Range<usize> {
    let first = job::stall_at(bytes) + SLOTS;
    first..first + LOST
}

fn rejected() -> Rejected {
    Rejected { packets: LOST, elements: LOST * PACKET_BYTES }
}

/// What the board sends, by its own code on this machine.
fn sent(board: &Board, encoding: Encoding, bytes: &[u8]) -> Vec<u8> {
    let mut out = vec![];
    let mut frame = vec![0; job::FRAME_BYTES];
    let sender = Sender::new(&mut frame, |bytes: &[u8]| out.extend(bytes));
    // Blocks of another size than the board's.
    let mut events = vec![Event::default(); 300];
    let mut counted = vec![0; job::PLANE_BYTES];
    let (mut state, mut decayed) = (vec![0; job::SURFACE_LEN], vec![0; 2 * job::PLANE_BYTES]);
    let (mut denoise, mut windows) = (vec![0; job::DENOISE_LEN], vec![0; job::WINDOWS_LEN]);
    let mut tiles = vec![0; job::TILES];
    macro_rules! feed {
        ($job:expr) => {{
            let mut job = $job.unwrap();
            for (i, packet) in bytes.chunks(PACKET_BYTES).enumerate() {
                assert!(lost(bytes).contains(&i) || job.packet(i as u32, packet, rejected()));
            }
            job.finish(rejected());
        }};
    }
    if board.is_small() {
        let filter = DoubleWindow::try_new(GEOMETRY, job::WINDOWS, &mut windows[..]).unwrap();
        let views = job::Tiles::new(&mut tiles).unwrap();
        feed!(job::Small::new(evt2::Decoder::new(GEOMETRY), filter, views, sender, &mut events));
    } else {
        let views = job::Planes::new(&mut counted, &mut state, &mut decayed).unwrap();
        let filter = job::denoise(&mut denoise[..]).unwrap();
        feed!(job::Large::new(AnyDecoder::new(encoding, GEOMETRY), filter, views, sender, &mut events));
    }
    out
}

/// Tensors by view and start of window.
type Tensors = BTreeMap<(u8, u64), Vec<u8>>;

/// What a host reads from the link: all tensors, and the losses told last.
fn received(bytes: &[u8]) -> (Tensors, Option<(u32, u32)>) {
    let mut decoder = serial::Decoder::new(vec![0; job::FRAME_BYTES]);
    let (mut tensors, mut losses) = (Tensors::new(), None);
    decoder.decode(bytes, |frame| match frame.message {
        Message::Tensor { view, t0, offset, bytes, .. } => {
            let tensor = tensors.entry((view, t0)).or_default();
            assert_eq!(tensor.len(), offset as usize);
            tensor.extend(bytes);
        }
        Message::Losses { packets, bytes, .. } => losses = Some((packets, bytes)),
        _ => {}
    });
    assert_eq!((decoder.ledger().lost, decoder.ledger().starts), (0, 1));
    (tensors, losses)
}

/// The same by other means: stretches decoded whole, and views from settings.
fn expected(board: &Board, encoding: Encoding, bytes: &[u8]) -> Tensors {
    let small = board.is_small();
    let mut filter: Box<dyn Filter> = if small {
        let memory = vec![0; job::WINDOWS_LEN];
        Box::new(DoubleWindow::try_new(GEOMETRY, job::WINDOWS, memory).unwrap())
    } else {
        Box::new(job::denoise(vec![0; job::DENOISE_LEN]).unwrap())
    };
    let spec = |kind, dtype| ViewSpec { dtype: Some(dtype), ..ViewSpec::new("v", kind, PERIOD_US) };
    let specs = if small {
        vec![ViewSpec { tile_px: Some(job::TILE_PX), ..spec(Kind::TileCount, Dtype::U16) }]
    } else {
        let surface = ViewSpec { tau_us: Some(job::TAU_US), ..spec(Kind::TimeSurface, Dtype::U8) };
        vec![spec(Kind::Count, Dtype::U8), surface]
    };
    let mut views: Vec<View> = specs.iter().map(|spec| View::try_new(spec, GEOMETRY).unwrap()).collect();

    let lost = lost(bytes);
    let (before, after) = (&bytes[..lost.start * PACKET_BYTES], &bytes[lost.end * PACKET_BYTES..]);
    let mut decoder = AnyDecoder::new(encoding, GEOMETRY);
    let mut memory = vec![Event::default(); EVENTS_MAX + Sink::LEN_MIN];
    let mut stretch = |bytes: &[u8]| {
        let mut sink = Sink::new(&mut memory);
        assert_eq!(decoder.decode(bytes, &mut sink), bytes.len());
        decoder.gap(Some(decoder.now()));
        let mut block = sink.block(GEOMETRY);
        filter.retain(&mut block).unwrap();
        (block.t_first, block.t_last, block.span().events.to_vec())
    };
    let stretches = [stretch(before), stretch(after)];
    let end = decoder.now();
    let mut tensors = Tensors::new();
    for (i, view) in views.iter_mut().enumerate() {
        let mut canvas = Offline::new(view.len_bytes(), |closed, bytes: &[u8]| {
            tensors.insert((i as u8, closed.window.t0), bytes.to_vec());
        });
        for (t_first, t_last, events) in &stretches {
            let (t_first, t_last) = (*t_first, *t_last);
            view.push(Span { t_first, t_last, geometry: GEOMETRY, events }, &mut canvas).unwrap();
        }
        view.finish(end, &mut canvas).unwrap();
    }
    tensors
}

/// Bytes of memory that the program has for itself, its stack not counted: segments of the ELF file in RAM.
fn ram_bytes(elf: &[u8]) -> u64 {
    let half = |at: usize| u16::from_le_bytes([elf[at], elf[at + 1]]);
    let word = |at: usize| u32::from_le_bytes([elf[at], elf[at + 1], elf[at + 2], elf[at + 3]]);
    let (table, entry, entries) = (word(28) as usize, half(42) as usize, half(44) as usize);
    let in_ram = |address: u32| (0x2000_0000..0x4000_0000).contains(&address) || address >= 0x8040_0000;
    let segments =
        (0..entries).map(|i| table + i * entry).filter(|at| word(*at) == 1 && in_ram(word(at + 8)));
    segments.map(|at| u64::from(word(at + 20))).sum()
}

/// Runs the firmware; the lines that it prints, and the bytes that leave its UART.
fn qemu(board: &Board, elf: &Path, uart: &Path) -> (BTreeMap<String, String>, Vec<u8>) {
    let mut command = Command::new("timeout");
    command.arg("300").args(board.qemu).args(["-display", "none", "-monitor", "none", "-serial"]);
    command.arg(format!("file:{}", uart.display()));
    command.args([
        "-semihosting-config",
        "enable=on,target=native",
        "-icount",
        "shift=0,sleep=off",
        "-kernel",
    ]);
    command.arg(elf);
    let output = run(command);
    let said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert!(output.status.success(), "{}: {:?}\n{said}", board.name, output.status);
    let pairs = said.lines().filter_map(|line| line.split_once('='));
    (pairs.map(|(key, value)| (key.into(), value.into())).collect(), std::fs::read(uart).unwrap())
}

fn check(board: &Board, inputs: &Inputs, elf: &Path) {
    let (mut figures, uart) = qemu(board, elf, &inputs.folder.join("uart"));
    // riscv-rt reserves all that is left for the stack.
    if !board.target.starts_with("riscv") {
        figures.insert("ram_bytes".into(), ram_bytes(&std::fs::read(elf).unwrap()).to_string());
    }
    let mut from_uart = &uart[..];
    for name in board.jobs {
        let (encoding, bytes) = &inputs.crops[name];
        let sent = sent(board, *encoding, bytes);
        let mut digest = Digest::new();
        digest.extend(&sent);
        let (host, guest) = (format!("{:016x}", digest.0), &figures[&format!("digest_{name}")]);
        let equal = if host == *guest { "equal" } else { "DIFFERENT" };
        println!("{}, {name}: digest host={host} guest={guest} {equal}", board.name);
        assert_eq!(host, *guest);
        let (received_bytes, rest) = from_uart.split_at(sent.len());
        from_uart = rest;
        assert!(received_bytes == sent, "{}: the UART gave other bytes than the digest tells of", board.name);
        let (tensors, losses) = received(received_bytes);
        assert_eq!(losses, Some((LOST as u32, (LOST * PACKET_BYTES) as u32)));
        let expected = expected(board, *encoding, bytes);
        assert_eq!(tensors.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
        assert!(tensors == expected, "{}: tensors differ from those of views", board.name);
        assert!(tensors.values().flatten().any(|byte| *byte != 0));
    }
    assert!(from_uart.is_empty());
    let digests: BTreeMap<String, String> = figures
        .iter()
        .filter_map(|(key, digest)| Some((key.strip_prefix("bits_")?.into(), digest.clone())))
        .collect();
    figures.retain(|key, _| !key.starts_with("bits_"));
    if !board.is_small() {
        assert_eq!(digests, on_this_machine(), "{}", board.name);
        println!("{}: {} stages give the same bits", board.name, digests.len());
    }
    let number = |key: &str| figures[key].parse::<u64>().unwrap();
    for key in figures.keys().filter(|key| !key.starts_with("digest") && *key != "ok") {
        match number(key) {
            n if key.ends_with("_bytes") || key.starts_with("sent") => println!("{}: {key} {n}", board.name),
            n => println!("{}: {key} {}.{:02} instructions per event", board.name, n / 100, n % 100),
        }
    }
    for (key, limit) in board.limits {
        assert!(
            number(key) <= *limit,
            "{}: {key} is {}, at most {limit} is allowed",
            board.name,
            number(key)
        );
    }
}

#[test]
#[ignore = "builds core for three targets: .ci/run asks for it"]
fn firmware_gives_the_bits_of_the_host() {
    let (Some(rustc), Some(linker)) = (rustc(), rust_lld()) else {
        return skip(&format!("no compiler for microcontrollers ({RUSTC_HINT})"));
    };
    if !is_there(QEMU_ARM) || !is_there(QEMU_RISCV) {
        return skip("no QEMU (apt-get install qemu-system-arm qemu-system-misc)");
    }
    let Some(recording) = lobula_tests::data(RECORDING) else { return };
    let target_dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("firmware");
    let inputs = Inputs::make(&recording, target_dir.join("inputs"));
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("firmware/Cargo.toml");
    for board in &BOARDS {
        let mut cargo = cargo_for(board.target, &manifest, &target_dir, &rustc);
        let variable = board.target.to_uppercase().replace('-', "_");
        cargo.env(format!("CARGO_TARGET_{variable}_LINKER"), &linker);
        cargo.env("LOBULA_FIRMWARE_INPUT", &inputs.folder);
        let output = run(cargo);
        assert!(output.status.success(), "{}:\n{}", board.name, String::from_utf8_lossy(&output.stderr));
        check(board, &inputs, &target_dir.join(board.target).join("release/firmware"));
    }
}
