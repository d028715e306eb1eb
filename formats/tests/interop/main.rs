//! Files we write are read by independent programs with identical events.
//!
//! The programs are Python packages, in a virtual environment that the first run makes in the target folder (18 s of
//! CPU, 350 MB). That needs Python 3 with venv and a package index, so it is run on request, as .ci/run does:
//! `cargo test -p lobula-formats --test interop -- --ignored`.
#![allow(clippy::unwrap_used)] // helpers of tests may too

use lobula_core::wire::{Encoding, WordOrder};
use lobula_core::{Event, Geometry, Polarity, Span, Trigger};
use lobula_formats::{
    Blocks, Compression, CopyOptions, Frame, ImuSample, LeftOut, OpenOptions, Recording, Summary, WithDigest,
    WriteOptions, Writer, copy, open, open_with,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

/// What is installed, without what it depends on for other formats than these.
const PACKAGES: &[&str] = &[
    "numpy==2.4.6",
    "aedat==2.3.0",
    "dv-processing==2.0.4",
    "faery==0.7.1",
    "evlib==0.13.2",
    "evutils==0.3.18",
    "h5py==3.16.0",
    "hdf5plugin==7.1.0",
    "polars==2.1.0",
    "polars-runtime-32==2.1.0",
    "rosbags==0.11.9",
    "mcap==1.6.0",
    "apsw==3.54.1.0",
    "backports.zstd==1.8.0",
    "lz4==4.4.5",
    "ruamel.yaml==0.19.1",
    "typing_extensions==4.16.0",
    "zstandard==0.25.0",
];

/// A file that we write.
struct File {
    name: &'static str,
    /// The sensor's size.
    size: Geometry,
    set: fn(&mut WriteOptions),
    /// What must be said of it when it is read back.
    say: fn(&mut OpenOptions),
}

const fn file(name: &'static str, set: fn(&mut WriteOptions)) -> File {
    File { name, size: Geometry::new(1280, 720), set, say: |_| {} }
}

/// Every format and kind of file that we write.
const FILES: &[File] = &[
    file("evt2.raw", |options| options.encoding = Some(Encoding::Evt2)),
    file("evt21-little.raw", |options| options.encoding = Some(Encoding::Evt21(WordOrder::Little))),
    file("evt4.raw", |options| options.encoding = Some(Encoding::Evt4)),
    file("evt21-legacy.raw", |options| options.encoding = Some(Encoding::Evt21(WordOrder::Legacy))),
    file("evt3.raw", |options| options.encoding = Some(Encoding::Evt3)),
    file("cd.dat", |_| {}),
    File { size: Geometry::new(346, 260), ..file("davis346.aedat", |_| {}) },
    file("none.aedat4", |options| options.compression = Some(Compression::None)),
    file("lz4.aedat4", |options| options.compression = Some(Compression::Lz4)),
    file("lz4-high.aedat4", |options| options.compression = Some(Compression::Lz4High)),
    file("zstd.aedat4", |options| options.compression = Some(Compression::Zstd)),
    file("zstd-high.aedat4", |options| options.compression = Some(Compression::ZstdHigh)),
    file("gzip.h5", |_| {}),
    file("none.h5", |options| options.compression = Some(Compression::None)),
    file("lz4.h5", |options| options.compression = Some(Compression::Lz4)),
    file("zstd.h5", |options| options.compression = Some(Compression::Zstd)),
    file("dsec.h5", |options| options.layout = Some("dsec".into())),
    file("none.bag", |_| {}),
    file("bz2.bag", |options| options.compression = Some(Compression::Bz2)),
    file("lz4.bag", |options| options.compression = Some(Compression::Lz4)),
    file("none.mcap", |_| {}),
    file("lz4.mcap", |options| options.compression = Some(Compression::Lz4)),
    file("zstd.mcap", |options| options.compression = Some(Compression::Zstd)),
    file("events.es", |_| {}),
    file("events.npy", |_| {}),
    file("events.npz", |_| {}),
    file("events.txt", |_| {}),
    file("events.csv", |_| {}),
    file("events.csv.gz", |_| {}),
];

/// Which reads what, found by trial. Of EVT 2.1 each knows one word order or none. faery 0.7.1 counts no wrap of EVT3
/// before the first event, and expelliarmus 1.1.12 adds 4096 µs at some TIME_HIGH words and stops at triggers.
const PEERS: &[(&str, &[&str])] = &[
    ("dv", AEDAT4),
    ("aedat", AEDAT4),
    ("faery", &["evt2.raw", "cd.dat", "events.es"]),
    ("numpy_load", &["events.npy", "events.npz"]),
    ("numpy_loadtxt", &["events.txt", "events.csv", "events.csv.gz"]),
    ("evlib", &["evt2.raw", "evt21-little.raw", "evt3.raw"]),
    ("evutils", &["evt2.raw", "evt21-legacy.raw", "evt3.raw", "evt4.raw", "cd.dat", "davis346.aedat"]),
    ("hdf5", &["gzip.h5", "none.h5", "lz4.h5", "zstd.h5", "dsec.h5"]),
    ("rosbags", &["none.bag", "bz2.bag", "lz4.bag"]),
    ("mcap", &["none.mcap", "lz4.mcap", "zstd.mcap"]),
];

const AEDAT4: &[&str] = &["none.aedat4", "lz4.aedat4", "lz4-high.aedat4", "zstd.aedat4", "zstd-high.aedat4"];

#[test]
fn every_file_has_a_reader() {
    for File { name, .. } in FILES {
        assert!(PEERS.iter().any(|(_, names)| names.contains(name)), "{name} is read by none");
    }
}

#[test]
#[ignore = "makes a Python environment: see the top of the file"]
fn others_read_what_we_write() {
    let python = python();
    let folder = tempfile::tempdir().unwrap();
    let ours = FILES.iter().map(|file| (file.name, written(&folder.path().join(file.name), file)));
    let ours: BTreeMap<_, _> = ours.collect();
    for (peer, names) in PEERS {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interop/read.py");
        let paths = names.iter().map(|name| folder.path().join(name));
        let output = Command::new(&python).arg(script).arg(peer).args(paths).output().unwrap();
        let told = String::from_utf8_lossy(&output.stdout);
        // Some greet on the standard output.
        let told: Vec<_> = told.lines().filter(|line| line.len() > 64).collect();
        let ours: Vec<_> = names.iter().map(|name| ours[name].as_str()).collect();
        assert_eq!(told, ours, "{peer} of {names:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

/// h5py and hdf5plugin write every kind of HDF5 file that we read.
#[test]
#[ignore = "makes a Python environment: see the top of the file"]
fn we_read_what_others_write() {
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interop/write_hdf5.py");
    let output = Command::new(python()).arg(script).arg(folder.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told = String::from_utf8(output.stdout).unwrap();
    let mut wrong = Vec::new();
    for line in told.lines() {
        let (name, events, sha256, say): (String, u64, String, BTreeMap<String, String>) =
            serde_json::from_str(line).unwrap();
        let mut options = OpenOptions::default();
        options.time_unit = say.get("time_unit").map(|unit| unit.parse().unwrap());
        options.columns = say.get("columns").map(|columns| columns.parse().unwrap());
        options.topic = say.get("topic").cloned();
        let summary = open_with(folder.path().join(&name), &options)
            .and_then(|recording| Summary::of(&recording, WithDigest::Yes));
        if let Some(triggers) = say.get("triggers") {
            wrong.extend(wrong_triggers(&folder.path().join(&name), triggers));
        }
        match summary {
            Ok(summary) if summary.events == events && summary.sha256 == Some(sha256) => {}
            Ok(summary) => wrong.push(format!("{name}: {summary:?}")),
            Err(error) => wrong.push(error.to_string()),
        }
    }
    assert!(told.lines().count() > 200 && wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What is wrong with the triggers of a file, in a pass over it and in slices by time.
fn wrong_triggers(path: &Path, expected: &str) -> Vec<String> {
    let told =
        |t: &Trigger| format!("{},{},{},{}", t.t, t.ordinal, t.channel, u8::from(t.edge == Polarity::On));
    let triggers = |blocks: Blocks| {
        let (mut blocks, mut triggers) = (blocks, Vec::new());
        while let Some(chunk) = blocks.next_block().unwrap() {
            triggers.extend_from_slice(chunk.triggers);
        }
        triggers
    };
    let recording = open(path).unwrap();
    let all = triggers(recording.blocks());
    let found: Vec<_> = all.iter().map(told).collect();
    let mut wrong = Vec::new();
    if found.join(" ") != expected {
        wrong.push(format!("{}: {found:?}", path.display()));
    }
    if recording.load().unwrap().triggers() != all {
        wrong.push(format!("{}: others when loaded", path.display()));
    }
    let (start, end) = (all[0].t - 10, all[199].t + 10);
    for from in (start..end).step_by(61_001) {
        let t = from..from + 40_000;
        let slice = triggers(recording.slice_time(t.clone()).unwrap());
        if !all.iter().filter(|trigger| t.contains(&trigger.t)).eq(&slice) {
            wrong.push(format!("{}: {slice:?} in {t:?}", path.display()));
        }
    }
    wrong
}

/// Writes the file; events and digest as we read them back.
fn written(path: &Path, file: &File) -> String {
    let mut options = WriteOptions::default();
    (file.set)(&mut options);
    write(path, file.size, &options);
    let mut options = OpenOptions::default();
    (file.say)(&mut options);
    let summary = Summary::of(&open_with(path, &options).unwrap(), WithDigest::Yes).unwrap();
    assert!(summary.events > 10_000 && summary.bytes_faulty == 0);
    format!("{} {}", summary.events, summary.sha256.unwrap())
}

/// Runs, single events, triggers and silence over more than one wrap of EVT3, from 100 s on; times never step back,
/// which some of the programs take for a wrap.
fn write(path: &Path, geometry: Geometry, options: &WriteOptions) {
    let [width, height] = [geometry.width, geometry.height].map(u64::from);
    let mut writer = Writer::create(path, Some(geometry), options).unwrap();
    let mut t = 100_000_000u64;
    for i in 0..5_000u64 {
        t += match i % 1000 {
            999 => 20_000_000,
            _ => i * i % 71,
        };
        let polarity = Polarity::from_bit((i / 3) as u16);
        let event = |x: u64| Event::new(t as u32, (x % width) as u16, (i * 7 % height) as u16, polarity);
        let events = [i * 131, i * 131 + 1, i * 131 + 5, i * 17].map(event);
        writer.write(Span { t_first: t, t_last: t, geometry, events: &events }).unwrap();
        if i % 100 == 50 {
            writer.write_trigger(Trigger { t, ordinal: 0, channel: 6, edge: polarity }).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// An archive of 4.7 GB, with a member behind 4 GiB: Python's zipfile finds every checksum right, NumPy the column.
#[test]
#[ignore = "makes a Python environment, and a file of 4.7 GB with another of 1.9 GB beside it"]
fn numpy_reads_an_archive_beyond_4_gib() {
    let (times, rounds) = (1_000_000u32, 360u32);
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let path = folder.path().join("large.npz");
    let geometry = Geometry::new(1280, 720);
    let mut writer = Writer::create(&path, Some(geometry), &WriteOptions::default()).unwrap();
    for round in 0..rounds {
        let at = round * times;
        let event = |i| Event::new(at + i, (i % 1280) as u16, 7, Polarity::from_bit(u16::from(i % 4 == 3)));
        let events: Vec<_> = (0..times).map(event).collect();
        let (t_first, t_last) = (u64::from(at), u64::from(at + times - 1));
        writer.write(Span { t_first, t_last, geometry, events: &events }).unwrap();
    }
    assert!(writer.finish().unwrap().bytes > 4_600_000_000);
    let script = "import sys, zipfile, numpy\n\
        assert zipfile.ZipFile(sys.argv[1]).testzip() is None\n\
        p = numpy.load(sys.argv[1])['p']\n\
        print(len(p), p.sum())";
    let output = Command::new(python()).args(["-c", script]).arg(&path).output().unwrap();
    let told = String::from_utf8_lossy(&output.stdout);
    assert_eq!(told.trim(), "360000000 90000000", "{}", String::from_utf8_lossy(&output.stderr));
    let summary = Summary::of(&open(&path).unwrap(), WithDigest::No).unwrap();
    assert_eq!((summary.events, summary.on, summary.bytes_faulty), (360_000_000, 90_000_000, 0));
}

/// Every kind of stream that dv-processing writes is read, copied, and read by it again.
#[test]
#[ignore = "makes a Python environment: see the top of the file"]
fn dv_streams_both_ways() {
    let python = python();
    let folder = tempfile::tempdir().unwrap();
    let (theirs, ours) = (folder.path().join("theirs.aedat4"), folder.path().join("ours.aedat4"));
    for compression in Compression::ALL.into_iter().take(5) {
        let name = compression.name().to_uppercase().replace('-', "_");
        let mut wrote = streams(&python, &["write", theirs.to_str().unwrap(), &name]);
        let recording = open_with(&theirs, &OpenOptions::default()).unwrap();
        assert_eq!(wrote, lines(&recording), "{name}");
        let mut options = WriteOptions::default();
        (options.compression, options.overwrite) = (Some(compression), true);
        let mut writer = Writer::create(&ours, recording.geometry(), &options).unwrap();
        copy(&recording, &mut writer, CopyOptions::default()).unwrap();
        assert_eq!(writer.finish().unwrap().left_out, LeftOut::default());
        assert_eq!(wrote, lines(&open_with(&ours, &OpenOptions::default()).unwrap()), "{name}");
        // It reads one stream of triggers.
        wrote.retain(|line| !(line.starts_with("trigger") && line.contains(" 1 ")));
        assert_eq!(wrote, streams(&python, &["read", ours.to_str().unwrap()]), "{name}");
    }
}

/// What `streams.py` prints, sorted.
fn streams(python: &Path, arguments: &[&str]) -> Vec<String> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interop/streams.py");
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut lines: Vec<_> = String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect();
    lines.sort();
    lines
}

/// The same of a recording.
fn lines(recording: &Recording) -> Vec<String> {
    let mut lines = Vec::new();
    let mut blocks = recording.blocks();
    while let Some(chunk) = blocks.next_block().unwrap() {
        let span = chunk.span();
        let event = |one: &Event| {
            format!("event {} {} {} {}", span.time(*one), one.x(), one.y(), u8::from(one.is_on()))
        };
        lines.extend(span.events.iter().map(event));
        let trigger = |one: &Trigger| format!("trigger {} {} {}", one.t, one.channel, one.edge as u8);
        lines.extend(chunk.triggers.iter().map(trigger));
    }
    lines.extend(recording.imu().map(|sample| sample_line(&sample.unwrap())));
    lines.extend(recording.frames().map(|frame| frame_line(&frame.unwrap())));
    lines.sort();
    lines
}

fn sample_line(sample: &ImuSample) -> String {
    let numbers = [sample.temperature.unwrap_or_default()]
        .into_iter()
        .chain(sample.acceleration.map(|a| a / 9.80665))
        .chain(sample.rotation.map(f64::to_degrees))
        .chain(sample.magnetic_field.unwrap_or_default());
    let numbers: Vec<_> = numbers.map(|number| ((number * 64.0).round() as i64).to_string()).collect();
    format!("imu {} {}", sample.t, numbers.join(" "))
}

fn frame_line(frame: &Frame) -> String {
    let Frame { t, exposure, x, y, width, height, format, pixels } = frame;
    let exposure = exposure.as_ref().map_or(0, |exposure| exposure.end - exposure.start);
    let total: u64 = (0..).zip(pixels).map(|(i, byte)| i % 251 * u64::from(*byte)).sum();
    format!("frame {t} {exposure} {x} {y} {width} {height} {} 1 {total}", format.bytes())
}

/// The interpreter of an environment with the packages; the first test that needs it makes it.
fn python() -> PathBuf {
    static PYTHON: LazyLock<PathBuf> = LazyLock::new(|| {
        lobula_tests::python(&Path::new(env!("CARGO_TARGET_TMPDIR")).join("peers"), PACKAGES)
    });
    PYTHON.clone()
}
