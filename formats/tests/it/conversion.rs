//! Every sample in every format that we write holds the same events, or is refused for a reason in the table.

use super::everything;
use super::truth::{SAMPLES, Sample};
use lobula_core::wire::{Encoding, WordOrder};
use lobula_core::{Geometry, Trigger};
use lobula_formats::{
    Compression, CopyOptions, FORMATS, OpenOptions, Recording, Summary, WithDigest, WriteOptions, Writer,
    copy, open_with,
};
use lobula_tests::data;
use serde_json::Value;
use std::path::Path;

/// A kind of file that we write.
pub(crate) struct Target {
    /// Name of the file.
    pub(crate) name: &'static str,
    pub(crate) set: fn(&mut WriteOptions),
    /// What must be said of it when it is read back.
    say: fn(&mut OpenOptions),
    /// Whether it has a place for triggers.
    triggers: bool,
}

/// A line for each kind of file that we write.
pub(crate) const TARGETS: &[Target] = &[
    Target { name: "evt2.raw", set: |o| o.encoding = Some(Encoding::Evt2), say: |_| {}, triggers: true },
    Target { name: "evt21.raw", set: |o| o.encoding = Some(LITTLE), say: |_| {}, triggers: true },
    Target { name: "evt4.raw", set: |o| o.encoding = Some(Encoding::Evt4), say: |_| {}, triggers: true },
    Target { name: "evt21-legacy.raw", set: |o| o.encoding = Some(LEGACY), say: |_| {}, triggers: true },
    Target { name: "evt3.raw", set: |o| o.encoding = Some(Encoding::Evt3), say: |_| {}, triggers: true },
    Target {
        name: "none.aedat4",
        set: |o| o.compression = Some(Compression::None),
        say: |_| {},
        triggers: true,
    },
    Target { name: "lz4.aedat4", set: |_| {}, say: |_| {}, triggers: true },
    Target {
        name: "zstd.aedat4",
        set: |o| o.compression = Some(Compression::Zstd),
        say: |_| {},
        triggers: true,
    },
    Target { name: "aedat2.aedat", set: |_| {}, say: |_| {}, triggers: true },
    Target { name: "own.h5", set: |_| {}, say: |_| {}, triggers: true },
    Target { name: "dsec.h5", set: |o| o.layout = Some("dsec".into()), say: |_| {}, triggers: false },
    Target { name: "cd.dat", set: |_| {}, say: |_| {}, triggers: false },
    Target { name: "plain.bag", set: |_| {}, say: |_| {}, triggers: false },
    Target { name: "bz2.bag", set: |o| o.compression = Some(Compression::Bz2), say: |_| {}, triggers: false },
    Target { name: "lz4.bag", set: |o| o.compression = Some(Compression::Lz4), say: |_| {}, triggers: false },
    Target { name: "plain.mcap", set: |_| {}, say: |_| {}, triggers: true },
    Target { name: "lz4.mcap", set: |o| o.compression = Some(Compression::Lz4), say: |_| {}, triggers: true },
    Target {
        name: "zstd.mcap",
        set: |o| o.compression = Some(Compression::Zstd),
        say: |_| {},
        triggers: true,
    },
    Target { name: "events.es", set: |_| {}, say: |_| {}, triggers: false },
    Target { name: "events.npy", set: |_| {}, say: |_| {}, triggers: false },
    Target { name: "events.npz", set: |_| {}, say: |_| {}, triggers: false },
    Target { name: "events.txt", set: |_| {}, say: |_| {}, triggers: false },
    Target { name: "events.csv.zst", set: |_| {}, say: |_| {}, triggers: false },
];

const LITTLE: Encoding = Encoding::Evt21(WordOrder::Little);
const LEGACY: Encoding = Encoding::Evt21(WordOrder::Legacy);

/// Every refusal: start of the samples' names, end of the target's, what the error says.
const REFUSALS: &[(&str, &str, &str)] = &[
    ("aedat4_davis346", ".raw", "beyond the 2^40 µs"),
    ("aedat4_dvxplorer", ".raw", "beyond the 2^40 µs"),
    ("hdf5_dsec", ".raw", "beyond the 2^40 µs"),
    ("mcap", ".raw", "beyond the 2^40 µs"),
    ("rosbag_dvs_msgs", ".raw", "beyond the 2^40 µs"),
    ("text_rpg_seconds", ".raw", "beyond the 2^40 µs"),
    ("aedat4_davis346", ".es", "µs without an event"),
    ("aedat4_dvxplorer", ".es", "µs without an event"),
    ("hdf5_dsec", ".es", "µs without an event"),
    ("mcap", ".es", "µs without an event"),
    ("rosbag_dvs_msgs", ".es", "µs without an event"),
    ("text_rpg_seconds", ".es", "µs without an event"),
    ("aedat4_davis346", ".dat", "beyond the 2^32 µs"),
    ("aedat4_dvxplorer", ".dat", "beyond the 2^32 µs"),
    ("hdf5_dsec", ".dat", "beyond the 2^32 µs"),
    ("mcap", ".dat", "beyond the 2^32 µs"),
    ("rosbag_dvs_msgs", ".dat", "beyond the 2^32 µs"),
    ("text_rpg_seconds", ".dat", "beyond the 2^32 µs"),
    ("aedat4_davis346", ".mcap", "beyond the 2^40 µs"),
    ("aedat4_dvxplorer", ".mcap", "beyond the 2^40 µs"),
    ("hdf5_dsec", ".mcap", "beyond the 2^40 µs"),
    ("mcap", ".mcap", "beyond the 2^40 µs"),
    ("rosbag_dvs_msgs", ".mcap", "beyond the 2^40 µs"),
    ("text_rpg_seconds", ".mcap", "beyond the 2^40 µs"),
    ("aedat4_davis346", ".aedat", "beyond the 2^31 µs"),
    ("aedat4_dvxplorer", ".aedat", "beyond the 2^31 µs"),
    ("hdf5_dsec", ".aedat", "beyond the 2^31 µs"),
    ("mcap", ".aedat", "beyond the 2^31 µs"),
    ("rosbag_dvs_msgs", ".aedat", "beyond the 2^31 µs"),
    ("text_rpg_seconds", ".aedat", "beyond the 2^31 µs"),
    ("rosbag2", ".aedat", "holds sensors up to 1024x512"),
    ("evt21", ".aedat", "holds sensors up to 1024x512"),
    ("evt3", ".aedat", "holds sensors up to 1024x512"),
];

#[test]
fn every_written_format_is_a_target() {
    for format in FORMATS.iter().filter(|format| format.writes()) {
        let is_written = |target: &Target| format.extensions.iter().any(|end| target.name.ends_with(end));
        assert!(TARGETS.iter().any(is_written), "{} has no target", format.name);
    }
}

#[test]
fn every_sample_in_every_format() {
    let Some(truth) = data("truth.json") else { return };
    let truth: Value = serde_json::from_slice(&std::fs::read(truth).unwrap()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for sample in SAMPLES {
        let Some(path) = data(sample.file) else { return };
        let from = open_with(path, &sample.options()).unwrap();
        let truth = &truth[sample.file];
        let triggers = everything(from.blocks()).triggers;
        for target in TARGETS {
            let path = folder.path().join(target.name);
            let refusal = REFUSALS
                .iter()
                .find(|(file, name, _)| sample.file.starts_with(file) && target.name.ends_with(name));
            match (write(&from, &path, target, geometry(&from, truth)), refusal) {
                (Ok(()), None) => check(&path, sample, target, truth, &triggers),
                (Err(error), Some((_, _, what))) => assert!(error.contains(what), "{error}"),
                (Ok(()), Some(_)) => panic!("{} in {} is not refused", sample.file, target.name),
                (Err(error), None) => panic!("{} in {}: {error}", sample.file, target.name),
            }
        }
    }
}

/// The sensor's size; where the file does not tell, what holds its events.
fn geometry(from: &Recording, truth: &Value) -> Geometry {
    let side = |key: &str| truth[key].as_u64().unwrap() as u16 + 1;
    from.geometry().unwrap_or_else(|| Geometry::new(side("x_max"), side("y_max")))
}

fn write(from: &Recording, path: &Path, target: &Target, geometry: Geometry) -> Result<(), String> {
    let mut options = WriteOptions::default();
    options.overwrite = true;
    (target.set)(&mut options);
    let run = || {
        let mut writer = Writer::create(path, Some(geometry), &options)?;
        copy(from, &mut writer, CopyOptions::default())?;
        writer.finish()
    };
    run().map(|_| ()).map_err(|error| error.to_string())
}

fn check(path: &Path, sample: &Sample, target: &Target, truth: &Value, triggers: &[Trigger]) {
    let mut options = OpenOptions::default();
    (target.say)(&mut options);
    let to = open_with(path, &options).unwrap();
    let summary = Summary::of(&to, WithDigest::Yes).unwrap();
    assert_eq!(summary.sha256.as_deref(), truth["sha256"].as_str(), "{} in {}", sample.file, target.name);
    let expected = if target.triggers { triggers } else { &[] };
    assert_eq!(everything(to.blocks()).triggers, expected, "{} in {}", sample.file, target.name);
}
