//! Hostile files: no panic, bounded memory, every byte counted.
#![allow(clippy::unwrap_used)] // helpers of tests may too

mod ecf;
mod sqlite;

use lobula_core::wire::Encoding;
use lobula_core::{Event, Geometry, Polarity, Span, Trigger};
use lobula_formats::{
    Blocks, Compression, Error, ErrorKind, Frame, ImuSample, OpenOptions, PixelFormat, Summary, TimeUnit,
    WithDigest, WriteOptions, Writer, open_with,
};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;

/// The system's allocator, which keeps count of what each thread has in use and of the most that it had. Reading a
/// recording is the work of one thread, so the formats can be tested side by side.
struct Counting;

thread_local! {
    static IN_USE: Cell<usize> = const { Cell::new(0) };
    static PEAK: Cell<usize> = const { Cell::new(0) };
}

#[allow(unsafe_code)] // an allocator cannot be written without
// SAFETY: every call goes to the system's allocator unchanged; only numbers are kept beside it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = IN_USE.get().wrapping_add(layout.size());
        IN_USE.set(now);
        PEAK.set(PEAK.get().max(now));
        // SAFETY: the caller's promise, passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // What another thread made may end here.
        IN_USE.set(IN_USE.get().saturating_sub(layout.size()));
        // SAFETY: the caller's promise, passed on.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Memory that opening and reading may take above the file's size.
const BYTES_MAX: usize = 64 << 20;

/// Runs `job`; the most memory it took above what was in use before.
fn peak(job: impl FnOnce()) -> usize {
    let before = IN_USE.get();
    PEAK.set(before);
    job();
    PEAK.get() - before
}

/// Runs `job` and checks its memory.
fn bounded<T>(job: impl FnOnce() -> T) -> T {
    let mut done = None;
    let peak = peak(|| done = Some(job()));
    assert!(peak <= BYTES_MAX, "{peak} bytes above the start");
    done.unwrap()
}

/// A format under attack.
struct Target {
    /// End of the file's name.
    extension: &'static str,
    /// Small files of it with everything that it can hold, written to the path one after the other.
    wholes: fn(&Path) -> Vec<Vec<u8>>,
    /// What must be said of them because the files do not.
    say: fn(&mut OpenOptions),
    /// How many of the mutations open at least, and how many of those are found faulty at least.
    reached: [usize; 2],
}

/// Every format: a line each.
macro_rules! targets {
    ($($name:ident: $target:expr,)*) => {
        $(mod $name {
            use super::*;

            #[test]
            fn every_prefix() {
                super::every_prefix(&$target);
            }

            #[test]
            fn a_hundred_thousand_mutations() {
                super::a_hundred_thousand_mutations(&$target);
            }
        })*
    };
}

targets! {
    raw: Target { extension: "raw", wholes: raw, say: |_| {}, reached: [20_000, 10_000] },
    dat: Target { extension: "dat", wholes: dat, say: |_| {}, reached: [20_000, 5_000] },
    aedat4: Target { extension: "aedat4", wholes: aedat4, say: |_| {}, reached: [20_000, 5_000] },
    aedat31: Target { extension: "aedat", wholes: aedat31, say: |_| {}, reached: [20_000, 5_000] },
    aedat2: Target { extension: "aedat", wholes: aedat2, say: |_| {}, reached: [20_000, 5_000] },
    hdf5: Target { extension: "h5", wholes: hdf5, say: |_| {}, reached: [20_000, 1000] },
    hdf5_ecf: Target { extension: "h5", wholes: hdf5_ecf, say: |_| {}, reached: [10_000, 1000] },
    es: Target { extension: "es", wholes: |path| vec![written(path, |_| {})], say: |_| {}, reached: [20_000, 10] },
    npy: Target { extension: "npy", wholes: |path| vec![written(path, |_| {})], say: |_| {}, reached: [20_000, 1_000] },
    npz: Target { extension: "npz", wholes: |path| vec![written(path, |_| {})], say: |_| {}, reached: [20_000, 5_000] },
    npz_deflated: Target {
        extension: "npz",
        wholes: npz_deflated,
        say: |options| options.time_unit = Some(TimeUnit::Microseconds),
        reached: [5_000, 1_000],
    },
    text: Target { extension: "csv", wholes: text, say: |_| {}, reached: [50_000, 20_000] },
    nmnist: Target { extension: "bin", wholes: nmnist, say: |_| {}, reached: [20_000, 0] },
    rosbag: Target { extension: "bag", wholes: bags, say: |_| {}, reached: [20_000, 10_000] },
    mcap: Target { extension: "mcap", wholes: mcaps, say: |_| {}, reached: [20_000, 10_000] },
    db3: Target { extension: "db3", wholes: |_| vec![sqlite::small()], say: |_| {}, reached: [20_000, 1_000] },
}

/// Both versions; of the first with and without a header's size.
fn dat(path: &Path) -> Vec<Vec<u8>> {
    let place = |i: u32| (i % 300) | ((i % 240) << 9) | ((i & 1) << 17);
    let event = |i: u32| {
        let t = i.wrapping_mul(9_000_000);
        (u64::from(t) | (u64::from(place(i)) << 32)).to_le_bytes()
    };
    let v1 =
        |header: &[u8]| [header, &[0, 8], (0..480).map(event).collect::<Vec<_>>().as_flattened()].concat();
    vec![
        written(path, |_| {}),
        v1(b"% Data file containing Event2d events.\n% Version 1\n"),
        v1(b"% Data file containing Event2d events.\n% Width 304\n% Height 240\n"),
    ]
}

/// Every kind of stream, in every kind of compression.
fn aedat4(path: &Path) -> Vec<Vec<u8>> {
    let geometry = Geometry::new(346, 260);
    let mut wholes = Vec::new();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let mut options = WriteOptions::default();
        (options.overwrite, options.compression) = (true, Some(compression));
        let mut writer = Writer::create(path, Some(geometry), &options).unwrap();
        for i in 0..120u64 {
            let t = 1_000 + i * i * i * 37;
            let run =
                [0, 1, 2, 5].map(|x| Event::new(t as u32, 64 + x, i as u16, Polarity::from_bit(i as u16)));
            writer.write(Span { t_first: t, t_last: t, geometry, events: &run }).unwrap();
            if i % 40 == 20 {
                writer
                    .write_trigger(Trigger { t, ordinal: 0, channel: (i / 60) as u8, edge: Polarity::On })
                    .unwrap();
                let magnetic_field = (i > 60).then_some([1.0, 2.0, 3.0]);
                writer.write_imu(&ImuSample { t, magnetic_field, ..ImuSample::default() }).unwrap();
                let exposure = Some(t..t + 50);
                let (format, pixels) = (PixelFormat::Gray8, (0..20).collect());
                let frame = Frame { t, exposure, x: 1, y: 2, width: 5, height: 4, format, pixels };
                writer.write_frame(frame).unwrap();
            }
        }
        writer.finish().unwrap();
        wholes.push(std::fs::read(path).unwrap());
    }
    wholes
}

/// Every kind of packet, two of each.
fn aedat31(_: &Path) -> Vec<Vec<u8>> {
    let head = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DAVIS240C\r\n#!END-HEADER\r\n";
    let mut bytes = head.to_vec();
    let mut packet = |number: i16, time: i32, overflow: i32, events: Vec<Vec<i32>>| {
        bytes.extend([number.to_le_bytes(), 1i16.to_le_bytes()].concat());
        let count = events.len() as i32;
        let head = [events[0].len() as i32 * 4, time, overflow, count, count, count];
        let words = head.into_iter().chain(events.into_iter().flatten());
        bytes.extend(words.flat_map(i32::to_le_bytes));
    };
    for part in 0..2 {
        let polarity = |i: i32| vec![(i % 240) << 17 | (i % 180) << 2 | (i & 1) << 1 | 1, i * 8_000_000];
        packet(1, 4, part, (0..240).map(polarity).collect());
        packet(0, 4, part, (0..14).map(|kind| vec![kind << 1 | 1, kind]).collect());
        packet(3, 4, part, (0..3).map(|i| [vec![1, i], vec![0x3F80_0000; 7]].concat()).collect());
        packet(4, 4, part, (0..3).map(|i| [vec![1, i], vec![0x3F80_0000; 10]].concat()).collect());
        let frame = |channels: i32| [vec![channels << 1 | 1, 1, 9, 2, 8, 2, 3, 4, 5], vec![77; 12]].concat();
        packet(2, 12, part, [1, 3, 4].map(frame).to_vec());
    }
    vec![bytes]
}

/// Both layouts: events, triggers, and of the DAVIS words of the inertial sensor and of two frames.
fn aedat2(_: &Path) -> Vec<Vec<u8>> {
    let file = |chip: &str, address: &dyn Fn(u32) -> u32, others: &[u32]| {
        let mut bytes = format!("#!AER-DAT2.0\r\n# AEChip: {chip}\r\n# End of ASCII Header\r\n").into_bytes();
        let events = (0..480).map(address).enumerate();
        for (i, event) in events {
            let time = (i as u32).wrapping_mul(9_000_000).to_be_bytes();
            let other = others.get(i % 40).filter(|_| i % 2 == 0 && i < 80);
            for address in [Some(&event), other].into_iter().flatten() {
                bytes.extend_from_slice(&address.to_be_bytes());
                bytes.extend_from_slice(&time);
            }
        }
        bytes
    };
    let reads = (0..8).map(|i| 1 << 31 | (i & 3) << 12 | (i >> 2) << 10 | (700 - 80 * i));
    let words = (0..7).map(|which| 1 << 31 | which << 28 | 77 << 12 | 3 << 10);
    let others: Vec<u32> = reads.chain(words).chain([0x402, 0x403]).flat_map(|word| [word, word]).collect();
    let davis = file("Davis346", &|i| (i % 260) << 22 | (i % 346) << 12 | (i & 1) << 11, &others);
    let dvs128 = file("DVS128", &|i| (i % 128) << 8 | (i % 100) << 1 | i & 1, &[0x8000]);
    vec![davis, dvs128]
}

/// In both layouts, with every filter that we write, and with triggers.
fn hdf5(path: &Path) -> Vec<Vec<u8>> {
    let compressions = [Compression::None, Compression::Gzip, Compression::Lz4, Compression::Zstd];
    let own =
        compressions.map(|compression| written(path, |options| options.compression = Some(compression)));
    let dsec = written(path, |options| options.layout = Some("dsec".into()));
    let triggers = with_triggers(path, 5, |options| options.compression = Some(Compression::None));
    own.into_iter().chain([dsec, triggers]).collect()
}

/// With every packing of columns, and triggers beside them.
fn hdf5_ecf(_: &Path) -> Vec<Vec<u8>> {
    use ecf::Mode::{AllPacked, ColumnsPacked, Runs};
    [Runs, ColumnsPacked, AllPacked].map(ecf::small).into()
}

/// The seeds are what they are to be: the events that another file has, and all triggers.
#[test]
fn ecf_seeds_are_sound() {
    let folder = tempfile::tempdir_in(memory()).unwrap();
    let path = folder.path().join("it.h5");
    let digest = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let recording = open_with(&path, &OpenOptions::default()).unwrap();
        assert_eq!(recording.warnings(), Vec::<String>::new());
        let summary = Summary::of(&recording, WithDigest::Yes).unwrap();
        (summary.sha256, summary.triggers)
    };
    let expected = digest(&with_triggers(&path, 5, |_| {}));
    assert!(hdf5_ecf(&path).iter().all(|file| digest(file) == expected));
}

/// As NumPy deflates it: members of 480 events, in an archive without fields of zip64.
fn npz_deflated(_: &Path) -> Vec<Vec<u8>> {
    let (mut archive, mut contents) = (Vec::new(), Vec::new());
    for (name, descr) in [("t", "<i8"), ("x", "<i8"), ("y", "<i8"), ("p", "<i8")] {
        let dict = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (480,), }}\n");
        let values = (0..480i64).flat_map(|i| if name == "p" { i & 1 } else { i }.to_le_bytes());
        let member: Vec<u8> = b"\x93NUMPY\x01\x00"
            .iter()
            .copied()
            .chain((dict.len() as u16).to_le_bytes())
            .chain(dict.bytes())
            .chain(values)
            .collect();
        let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::best());
        std::io::Write::write_all(&mut encoder, &member).unwrap();
        let packed = encoder.finish().unwrap();
        let mut crc = flate2::Crc::new();
        crc.update(&member);
        let sizes = [crc.sum(), packed.len() as u32, member.len() as u32].map(u32::to_le_bytes);
        let name = format!("{name}.npy");
        let head = [20u16, 0, 8, 0, 0].map(u16::to_le_bytes);
        let name_len = (name.len() as u16).to_le_bytes();
        let at = (archive.len() as u32).to_le_bytes();
        let (head, sizes) = (head.as_flattened(), sizes.as_flattened());
        contents.push(
            [&b"PK\x01\x02\x14\0"[..], head, sizes, &name_len, &[0; 12], &at, name.as_bytes()].concat(),
        );
        archive
            .extend([&b"PK\x03\x04"[..], head, sizes, &name_len, &[0; 2], name.as_bytes(), &packed].concat());
    }
    let at = (archive.len() as u32).to_le_bytes();
    let contents = contents.concat();
    let len = (contents.len() as u32).to_le_bytes();
    let end = [&b"PK\x05\x06\0\0\0\0\x04\0\x04\0"[..], &len, &at, &[0; 2]].concat();
    vec![[archive, contents, end].concat()]
}

/// Both kinds, and packed in both ways.
fn text(path: &Path) -> Vec<Vec<u8>> {
    let kinds = ["csv", "txt", "txt.gz", "csv.zst"];
    kinds.map(|kind| written(path, |options| options.format = Some(kind.into()))).to_vec()
}

fn nmnist(_: &Path) -> Vec<Vec<u8>> {
    let word = |i: u8| if i == 240 { [0, 240, 0, 0, 0] } else { [i, i / 2, i, 0, i] };
    vec![(0..=255).chain(0..225).map(word).collect::<Vec<_>>().concat()]
}

/// bz2 takes 4 MB to unpack anything, so it comes seldom.
fn bags(path: &Path) -> Vec<Vec<u8>> {
    use Compression::{Bz2, Lz4, None};
    [None, Lz4, None, Bz2].map(|one| written(path, |options| options.compression = Some(one))).into()
}

fn mcaps(path: &Path) -> Vec<Vec<u8>> {
    use Compression::{Lz4, None, Zstd};
    [None, Lz4, None, Zstd].map(|one| written(path, |options| options.compression = Some(one))).into()
}

/// Frames of zeroes pack a thousandfold: the largest that is let in stays in bounds, a larger one is refused.
#[test]
fn bombs_in_chunks() {
    let folder = tempfile::tempdir_in(memory()).unwrap();
    for (name, compression) in
        [("it.bag", Compression::Bz2), ("it.bag", Compression::Lz4), ("it.mcap", Compression::Zstd)]
    {
        for (rows, good) in [(4000, true), (5000, false)] {
            let path = folder.path().join(name);
            let mut options = WriteOptions::default();
            (options.overwrite, options.compression) = (true, Some(compression));
            let geometry = Geometry::new(64, 64);
            let mut writer = Writer::create(&path, Some(geometry), &options).unwrap();
            let events = [Event::new(5, 1, 2, Polarity::On)];
            writer.write(Span { t_first: 5, t_last: 5, geometry, events: &events }).unwrap();
            let (width, format, pixels) = (8192, PixelFormat::Gray8, vec![0; 8192 * usize::from(rows)]);
            writer
                .write_frame(Frame { t: 6, exposure: None, x: 0, y: 0, width, height: rows, format, pixels })
                .unwrap();
            writer.write(Span { t_first: 7, t_last: 7, geometry, events: &events }).unwrap();
            writer.finish().unwrap();
            let read = || {
                let recording = open_with(&path, &OpenOptions::default())?;
                recording.frames().collect::<Result<Vec<_>, _>>().map(|frames| frames.len())
            };
            match bounded(read) {
                Ok(frames) => assert!(good && frames == 1, "{name} {rows}"),
                Err(error) => assert!(!good && error.kind() == ErrorKind::TooLarge, "{name} {rows}: {error}"),
            }
        }
    }
}

/// A small file with every kind of word that the encoder makes, in every encoding.
fn raw(path: &Path) -> Vec<Vec<u8>> {
    let encodings = Encoding::ALL.iter().copied();
    encodings.map(|encoding| written(path, |options| options.encoding = Some(encoding))).collect()
}

/// A small file as we write it: runs and single events, times further and further apart.
fn written(path: &Path, set: impl FnOnce(&mut WriteOptions)) -> Vec<u8> {
    with_triggers(path, 0, set)
}

/// The same, with so many triggers among the events.
fn with_triggers(path: &Path, triggers: u64, set: impl FnOnce(&mut WriteOptions)) -> Vec<u8> {
    let geometry = Geometry::new(1280, 720);
    let mut options = WriteOptions::default();
    options.overwrite = true;
    set(&mut options);
    let mut writer = Writer::create(path, Some(geometry), &options).unwrap();
    for i in 0..120u64 {
        let t = 1_000 + i * i * 37;
        let run = [0, 1, 2, 5].map(|x| Event::new(t as u32, 64 + x, i as u16, Polarity::from_bit(i as u16)));
        writer.write(Span { t_first: t, t_last: t, geometry, events: &run }).unwrap();
        if i < triggers {
            writer.write_trigger(Trigger { t, ordinal: 0, channel: 1, edge: Polarity::On }).unwrap();
        }
    }
    writer.finish().unwrap();
    std::fs::read(path).unwrap()
}

/// What reading a file came to.
struct Outcome {
    /// Events before the end or an error.
    events: u64,
    /// Whether something was wrong: an error, or a fault counted.
    faulty: bool,
}

/// Opens and reads to the end, by blocks and by a slice: an error that says where, or every byte in one count.
fn read(path: &Path, target: &Target) -> Option<Outcome> {
    let mut options = OpenOptions::default();
    (target.say)(&mut options);
    let recording = match open_with(path, &options) {
        Ok(recording) => recording,
        Err(error) => {
            assert!(error.to_string().contains("; "), "{error}");
            return None;
        }
    };
    let mut blocks = recording.blocks();
    let (events, error) = count(&mut blocks);
    let counters = blocks.counters();
    assert!(counters.events >= events, "{counters:?} but {events} events");
    assert_eq!(counters.faults.total() == 0, counters.bytes_faulty == 0, "{counters:?}");
    match (&error, recording.payload()) {
        (None, Some(payload)) => {
            let range = payload.range();
            assert_eq!(
                counters.bytes_decoded + counters.bytes_faulty,
                range.end - range.start,
                "{counters:?}"
            );
        }
        (None, None) => {}
        (Some(error), _) => assert!(error.to_string().contains(" at byte "), "{error}"),
    }
    if let Ok(mut slice) = recording.slice_time(0..u64::MAX) {
        assert!(error.is_none(), "the index is made by a full pass");
        assert_eq!(count(&mut slice).0, events);
    }
    let side =
        recording.imu().filter(Result::is_err).count() + recording.frames().filter(Result::is_err).count();
    assert!(side <= 2, "an error ends a stream");
    Some(Outcome { events, faulty: error.is_some() || counters.bytes_faulty > 0 })
}

/// Number of events until the end, or an error.
fn count(blocks: &mut Blocks) -> (u64, Option<Error>) {
    let mut events = 0;
    loop {
        match blocks.next_block() {
            Ok(Some(chunk)) => events += chunk.block.len() as u64,
            Ok(None) => return (events, None),
            Err(error) => return (events, Some(error)),
        }
    }
}

fn every_prefix(target: &Target) {
    let folder = tempfile::tempdir_in(memory()).unwrap();
    let path = folder.path().join("it").with_extension(target.extension);
    for whole in (target.wholes)(&path) {
        let mut events_before = 0;
        for len in 0..=whole.len() {
            std::fs::write(&path, &whole[..len]).unwrap();
            let Some(outcome) = bounded(|| read(&path, target)) else { continue };
            assert!(
                outcome.events >= events_before,
                "a prefix of {len} bytes has fewer events than a shorter one"
            );
            events_before = outcome.events;
        }
        assert_eq!(events_before, 480);
    }
}

/// A file of 40 MB is written, read, indexed and sliced in the memory of one of 1 MB, and within the index's limit.
#[test]
fn memory_does_not_grow_with_the_file() {
    let folder = tempfile::tempdir_in(memory()).unwrap();
    let path = folder.path().join("long.raw");
    let geometry = Geometry::new(1280, 720);
    let (mut options, limit) = (OpenOptions::default(), 16 << 10);
    options.limits.index_bytes_max = limit;
    let peak = peak(|| {
        let mut writer = raw_writer(&path, Encoding::Evt2, geometry, &WriteOptions::default()).unwrap();
        for second in 0..1_000u32 {
            let events: Vec<_> =
                (0..10_000).map(|i| Event::new(second * 1_000_000 + i * 100, 1, 2, Polarity::On)).collect();
            let (t_first, t_last) = (u64::from(second) * 1_000_000, u64::from(second) * 1_000_000 + 999_900);
            writer.write(Span { t_first, t_last, geometry, events: &events }).unwrap();
        }
        assert!(writer.finish().unwrap().bytes > 40_000_000);
        let recording = open_with(&path, &options).unwrap();
        assert_eq!(Summary::of(&recording, WithDigest::No).unwrap().events, 10_000_000);
        let mut slice = recording.slice_time(777_000_000..778_000_000).unwrap();
        let mut events = 0;
        while let Some(chunk) = slice.next_block().unwrap() {
            events += chunk.block.len();
        }
        assert_eq!(events, 10_000);
        assert!(recording.index().unwrap().bytes() <= limit);
    });
    assert!(peak < 1 << 20, "{peak} bytes");
}

/// xorshift: the same mutations in every run.
struct Draw(u64);

impl Draw {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % end as u64) as usize
    }

    /// Flips, overwrites, removes or repeats a few bytes; half of the time in the header, where lies are told.
    fn mutate(&mut self, bytes: &mut Vec<u8>) {
        for _ in 0..=self.below(4) {
            let end = if self.below(2) == 0 { bytes.len().min(80) } else { bytes.len() };
            if end == 0 {
                return;
            }
            let at = self.below(end);
            match self.below(5) {
                0 => bytes[at] ^= 1 << self.below(8),
                1 => bytes[at] = self.below(256) as u8,
                2 => bytes[at] = b"0123456789x;=%\n"[self.below(15)],
                3 => drop(bytes.drain(at..(at + self.below(20)).min(end))),
                _ => {
                    let piece = bytes[at..(at + self.below(20)).min(end)].to_vec();
                    bytes.splice(at..at, piece);
                }
            }
        }
    }
}

fn a_hundred_thousand_mutations(target: &Target) {
    let folder = tempfile::tempdir_in(memory()).unwrap();
    let path = folder.path().join("it").with_extension(target.extension);
    let wholes = (target.wholes)(&path);
    let mut draw = Draw(0x2545_F491_4F6C_DD1D);
    let (mut opened, mut faulty) = (0, 0);
    for i in 0..100_000 {
        let mut bytes = wholes[i % wholes.len()].clone();
        draw.mutate(&mut bytes);
        std::fs::write(&path, &bytes).unwrap();
        let Some(outcome) = bounded(|| read(&path, target)) else { continue };
        opened += 1;
        faulty += usize::from(outcome.faulty);
    }
    let [opened_min, faulty_min] = target.reached;
    assert!(
        opened >= opened_min && faulty >= faulty_min,
        "the mutations do not reach the decoders: {opened} opened, {faulty} faulty"
    );
}

/// A folder in memory where there is one: the files are many.
fn memory() -> std::path::PathBuf {
    let shm = Path::new("/dev/shm");
    if shm.is_dir() { shm.to_owned() } else { std::env::temp_dir() }
}

/// A RAW file of this encoding, whatever it is called.
fn raw_writer(
    path: impl AsRef<Path>,
    encoding: Encoding,
    geometry: Geometry,
    options: &WriteOptions,
) -> Result<Writer, Error> {
    let mut options = options.clone();
    (options.encoding, options.format) = (Some(encoding), Some("raw".into()));
    Writer::create(path, Some(geometry), &options)
}
