//! Files we write are read by independent programs with identical events.
//!
//! The programs are Python packages, in a virtual environment that the first run makes in the target folder (18 s of
//! CPU, 350 MB). That needs Python 3 with venv and a package index, so it is run on request, as .ci/run does:
//! `cargo test -p lobula-formats --test interop -- --ignored`.
#![allow(clippy::unwrap_used)] // helpers of tests may too

use lobula_core::wire::{Encoding, WordOrder};
use lobula_core::{Event, Geometry, Polarity, Span, Trigger};
use lobula_formats::{OpenOptions, Summary, WithDigest, WriteOptions, Writer, open_with};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What is installed, without what it depends on for other formats than these.
const PACKAGES: &[&str] = &[
    "numpy==2.4.6",
    "faery==0.7.1",
    "evlib==0.13.2",
    "evutils==0.3.18",
    "polars==2.1.0",
    "polars-runtime-32==2.1.0",
];

/// A file that we write.
struct File {
    name: &'static str,
    set: fn(&mut WriteOptions),
    /// What must be said of it when it is read back.
    say: fn(&mut OpenOptions),
}

const fn file(name: &'static str, set: fn(&mut WriteOptions)) -> File {
    File { name, set, say: |_| {} }
}

/// Every format and kind of file that we write.
const FILES: &[File] = &[
    file("evt2.raw", |options| options.encoding = Some(Encoding::Evt2)),
    file("evt21-little.raw", |options| options.encoding = Some(Encoding::Evt21(WordOrder::Little))),
    file("evt21-legacy.raw", |options| options.encoding = Some(Encoding::Evt21(WordOrder::Legacy))),
    file("evt3.raw", |options| options.encoding = Some(Encoding::Evt3)),
    file("cd.dat", |_| {}),
];

/// Which reads what, found by trial. Of EVT 2.1 each knows one word order or none. faery 0.7.1 counts no wrap of EVT3
/// before the first event, and expelliarmus 1.1.12 adds 4096 µs at some TIME_HIGH words and stops at triggers.
const PEERS: &[(&str, &[&str])] = &[
    ("faery", &["evt2.raw", "cd.dat"]),
    ("evlib", &["evt2.raw", "evt21-little.raw", "evt3.raw"]),
    ("evutils", &["evt2.raw", "evt21-legacy.raw", "evt3.raw", "cd.dat"]),
];

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

/// Writes the file; events and digest as we read them back.
fn written(path: &Path, file: &File) -> String {
    let mut options = WriteOptions::default();
    (file.set)(&mut options);
    write(path, &options);
    let mut options = OpenOptions::default();
    (file.say)(&mut options);
    let summary = Summary::of(&open_with(path, &options).unwrap(), WithDigest::Yes).unwrap();
    assert!(summary.events > 10_000 && summary.bytes_faulty == 0);
    format!("{} {}", summary.events, summary.sha256.unwrap())
}

/// Runs, single events, triggers and silence over more than one wrap of EVT3, from 100 s on; times never step back,
/// which some of the programs take for a wrap.
fn write(path: &Path, options: &WriteOptions) {
    let geometry = Geometry::new(1280, 720);
    let mut writer = Writer::create(path, Some(geometry), options).unwrap();
    let mut t = 100_000_000u64;
    for i in 0..5_000u64 {
        t += match i % 1000 {
            999 => 20_000_000,
            _ => i * i % 71,
        };
        let polarity = Polarity::from_bit((i / 3) as u16);
        let event = |x: u64| Event::new(t as u32, (x % 1280) as u16, (i * 7 % 720) as u16, polarity);
        let events = [i * 131, i * 131 + 1, i * 131 + 5, i * 17].map(event);
        writer.write(Span { t_first: t, t_last: t, geometry, events: &events }).unwrap();
        if i % 100 == 50 {
            writer.write_trigger(Trigger { t, ordinal: 0, channel: 6, edge: polarity }).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// The interpreter of an environment with the packages; made at the first run, again when the list changes.
fn python() -> PathBuf {
    let environment = Path::new(env!("CARGO_TARGET_TMPDIR")).join("peers");
    let (python, list) = (environment.join("bin/python"), environment.join("packages"));
    let wanted = PACKAGES.join("\n");
    if std::fs::read_to_string(&list).is_ok_and(|made| made == wanted) {
        return python;
    }
    let mut make = Command::new("python3");
    make.args(["-m", "venv", "--clear"]).arg(&environment);
    let mut install = Command::new(&python);
    install.args(["-m", "pip", "install", "--quiet", "--no-deps", "--only-binary", ":all:"]).args(PACKAGES);
    for mut step in [make, install] {
        assert!(step.status().unwrap().success(), "{step:?}");
    }
    std::fs::write(&list, wanted).unwrap();
    python
}
