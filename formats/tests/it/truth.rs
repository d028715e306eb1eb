//! Real recordings give what other programs found in them (data/truth.json).

use lobula_core::wire::AnyDecoder;
use lobula_core::{Decode, Event, Polarity, Sink};
use lobula_formats::{Digest, ErrorKind, OpenOptions, Summary, TimeUnit, WithDigest, open, open_with};
use lobula_tests::data;
use serde_json::Value;

/// A real recording, and what must be said of it because the file does not.
pub struct Sample {
    pub file: &'static str,
    pub say: fn(&mut OpenOptions),
}

const fn sample(file: &'static str) -> Sample {
    Sample { file, say: |_| {} }
}

impl Sample {
    pub fn options(&self) -> OpenOptions {
        let mut options = OpenOptions::default();
        (self.say)(&mut options);
        options
    }
}

/// Every sample that opens; those that hold a camera's bytes first.
pub const SAMPLES: &[Sample] = &[
    sample("evt2_gen3_640x480.raw"),
    sample("evt21_le_1280x720.raw"),
    sample("evt21_legacy_1280x720.raw"),
    sample("evt3_gen41_1280x720.raw"),
    sample("evt3_trigger_1280x720.raw"),
    sample("dat_ncars.dat"),
    sample("rosbag_dvs_msgs.bag"),
    sample("rosbag_dvs_msgs_bz2.bag"),
    sample("rosbag_dvs_msgs_lz4.bag"),
    sample("mcap_libcaer_cmp_davis346.mcap"),
    sample("rosbag2_evt3_trigger.db3"),
    sample("aedat2_davis346.aedat"),
    sample("aedat4_davis346_lz4.aedat4"),
    sample("aedat4_davis346_none.aedat4"),
    sample("aedat4_davis346_zstd.aedat4"),
    sample("aedat4_dvxplorer_320x240.aedat4"),
    sample("hdf5_dsec_blosc.h5"),
    sample("hdf5_e2vid_seconds.h5"),
    sample("hdf5_gzip.h5"),
    sample("hdf5_prophesee_compound_zstd.h5"),
    sample("es_dvs.es"),
    sample("text_rpg_seconds.txt"),
    Sample { file: "text_us.csv", say: |options| options.time_unit = Some(TimeUnit::Microseconds) },
    Sample { file: "numpy_structured.npy", say: |options| options.time_unit = Some(TimeUnit::Microseconds) },
    Sample { file: "numpy_columns.npz", say: |options| options.time_unit = Some(TimeUnit::Microseconds) },
    Sample {
        file: "text_metavision_xypt.csv",
        say: |options| {
            options.time_unit = Some(TimeUnit::Microseconds);
            options.columns = "x,y,p,t".parse().ok();
        },
    },
];

/// Those that hold a camera's bytes in order.
const RAW: usize = 5;

/// Every sample that does not say enough: the options that the refusal names.
const REFUSED: &[(&str, &[&str])] = &[
    ("numpy_structured.npy", &["--time-unit"]),
    ("numpy_columns.npz", &["--time-unit"]),
    ("text_us.csv", &["--time-unit"]),
    ("text_metavision_xypt.csv", &["--time-unit", "--columns"]),
];

#[test]
fn what_a_file_does_not_say_is_asked_for() {
    for (file, names) in REFUSED {
        let Some(path) = data(file) else { return };
        let error = open(path).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NeedsOption, "{error}");
        for option in ["--time-unit", "--columns", "--topic"] {
            assert_eq!(error.remedy().contains(option), names.contains(&option), "{error}");
        }
    }
}

const KEYS: [&str; 8] = ["events", "on", "off", "t_first_us", "t_last_us", "width", "height", "sha256"];

#[test]
fn counts_times_sizes_and_digests() {
    let Some(truth) = data("truth.json") else { return };
    let truth: Value = serde_json::from_slice(&std::fs::read(truth).unwrap()).unwrap();
    for sample in SAMPLES {
        let file = sample.file;
        let Some(path) = data(file) else { return };
        let recording = open_with(path, &sample.options()).unwrap();
        let summary = Summary::of(&recording, WithDigest::Yes).unwrap();
        let summary = serde_json::to_value(&summary).unwrap();
        for key in KEYS {
            assert_eq!(summary[key], truth[file][key], "{file} {key}");
        }
    }
}

#[test]
fn every_byte_is_in_one_count() {
    for file in SAMPLES[..RAW].iter().map(|sample| sample.file) {
        let Some(path) = data(file) else { return };
        let recording = open(path).unwrap();
        let payload = recording.payload().unwrap().range();
        let summary = Summary::of(&recording, WithDigest::No).unwrap();
        assert_eq!(summary.bytes_decoded + summary.bytes_faulty, payload.end - payload.start, "{file}");
        assert_eq!(summary.off_sensor, 0, "{file}");
    }
}

/// What a live source does: the bytes in transfers of any length through a decoder.
#[test]
fn the_payload_decodes_to_the_blocks() {
    for file in SAMPLES[..RAW].iter().map(|sample| sample.file) {
        let Some(path) = data(file) else { return };
        let recording = open(path).unwrap();
        let mut payload = recording.payload().unwrap();
        let geometry = payload.geometry().unwrap();
        for _twice in 0..2 {
            let mut decoder = AnyDecoder::new(payload.encoding(), geometry);
            let (mut transfer, mut memory) = (vec![0; 10_007], vec![Event::default(); 4096]);
            let mut digest = Digest::default();
            loop {
                let len = payload.read(&mut transfer).unwrap();
                let mut rest = &transfer[..len];
                while !rest.is_empty() {
                    let mut sink = Sink::new(&mut memory);
                    rest = &rest[decoder.decode(rest, &mut sink)..];
                    digest.update(sink.block(geometry).span());
                }
                if len == 0 {
                    break;
                }
            }
            let expected = Summary::of(&recording, WithDigest::Yes).unwrap().sha256;
            assert_eq!(Some(digest.finish()), expected, "{file}");
            assert_eq!(payload.position(), payload.range().end);
            payload.rewind();
        }
    }
}

/// Naive: every 16-bit word of type 0xA, its channel and edge.
fn trigger_words(payload: &[u8]) -> Vec<(u8, bool)> {
    let words = payload.as_chunks().0.iter().map(|word| u16::from_le_bytes(*word));
    words.filter(|word| word >> 12 == 0xA).map(|word| ((word >> 8 & 0xF) as u8, word & 1 == 1)).collect()
}

/// The same recording, once the camera's bytes and once in messages.
#[test]
fn triggers_of_messages_are_those_of_the_bytes() {
    let (Some(raw), Some(bag)) = (data("evt3_trigger_1280x720.raw"), data("rosbag2_evt3_trigger.db3")) else {
        return;
    };
    let [raw, bag] = [raw, bag].map(|path| super::everything(open(path).unwrap().blocks()));
    assert!(!bag.triggers.is_empty());
    assert_eq!((bag.triggers, bag.places), (raw.triggers, raw.places));
}

#[test]
fn triggers_come_in_order_with_their_place() {
    let Some(path) = data("evt3_trigger_1280x720.raw") else { return };
    let bytes = std::fs::read(&path).unwrap();
    let recording = open(path).unwrap();
    let payload = &bytes[recording.payload().unwrap().range().start as usize..];
    let super::All { events, triggers, places } = super::everything(recording.blocks());
    let told: Vec<_> = triggers.iter().map(|one| (one.channel, one.edge == Polarity::On)).collect();
    assert!(!told.is_empty());
    assert_eq!(told, trigger_words(payload));
    assert!(places.is_sorted());
    assert!(triggers.iter().zip(&places).all(|(trigger, place)| trigger.ordinal == *place as u64));
    for trigger in &triggers {
        let before = events[trigger.ordinal as usize - 1].0;
        assert!(before <= trigger.t, "{trigger:?} after the event of {before} µs");
    }
}
