//! Slices by time and by number are what a full pass would keep.

use super::{All, events_of, everything, raw_writer};
use lobula_core::wire::{Encoding, WordOrder};
use lobula_core::{Event, Geometry, Polarity, Span, Trigger};
use lobula_formats::{Limits, OpenOptions, Recording, Summary, WithDigest, WriteOptions, open, open_with};
use lobula_tests::data;
use proptest::prelude::*;
use std::ops::Range;
use std::path::Path;

/// A full pass, to compare slices with.
struct Whole(All);

impl Whole {
    fn of(recording: &Recording) -> Self {
        Self(everything(recording.blocks()))
    }

    fn check_time(&self, recording: &Recording, t: Range<u64>) {
        let slice = everything(recording.slice_time(t.clone()).unwrap());
        self.check(
            &slice,
            |_, time| t.contains(&time),
            |trigger| t.contains(&trigger.t),
            &format!("{t:?} µs"),
        );
    }

    fn check_numbers(&self, recording: &Recording, numbers: Range<u64>) {
        let slice = everything(recording.slice_events(numbers.clone()).unwrap());
        let inside = |trigger: &Trigger| numbers.contains(&trigger.ordinal);
        self.check(&slice, |i, _| numbers.contains(&i), inside, &format!("events {numbers:?}"));
    }

    /// Naive: the events and triggers to be kept, and the kept events before each of these.
    #[track_caller]
    fn check(
        &self,
        slice: &All,
        keep: impl Fn(u64, u64) -> bool,
        keep_trigger: impl Fn(&Trigger) -> bool,
        name: &str,
    ) {
        let numbered = (0u64..).zip(&self.0.events);
        let kept: Vec<_> = numbered.filter(|(i, (t, _))| keep(*i, *t)).collect();
        let events: Vec<_> = kept.iter().map(|(_, event)| **event).collect();
        assert!(slice.events == events, "{name}: {} events, not {}", slice.events.len(), events.len());
        let triggers: Vec<_> = self.0.triggers.iter().filter(|one| keep_trigger(one)).copied().collect();
        assert_eq!(slice.triggers, triggers, "{name}");
        let before = |one: &Trigger| kept.iter().filter(|(i, _)| *i < one.ordinal).count();
        assert_eq!(slice.places, triggers.iter().map(before).collect::<Vec<_>>(), "{name}");
    }

    /// Ranges around everything, and at random.
    fn check_many(&self, recording: &Recording, draws: u64) {
        let events = self.0.events.len() as u64;
        let times = self.0.events.iter().map(|(t, _)| *t);
        let (low, high) = (times.clone().min().unwrap_or(0), times.max().unwrap_or(0));
        let mut draw = Draw(0x9E37_79B9_7F4A_7C15);
        for t in [0..u64::MAX, 0..low, low..high, high..high + 1, high + 1..u64::MAX, low..low] {
            self.check_time(recording, t);
        }
        for numbers in [0..u64::MAX, 0..0, 0..1, events..events + 1, events + 5..u64::MAX] {
            self.check_numbers(recording, numbers);
        }
        for _ in 0..draws {
            let t = low + draw.below(high - low + 1);
            self.check_time(recording, t..t + draw.below(1 + (high - low) / 10));
            let number = draw.below(events + 1);
            self.check_numbers(recording, number..number + draw.below(20_000));
        }
    }
}

/// xorshift: the same ranges in every run.
struct Draw(u64);

impl Draw {
    fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % end.max(1)
    }
}

#[test]
fn of_real_recordings() {
    for file in [
        "evt2_gen3_640x480.raw",
        "evt21_legacy_1280x720.raw",
        "evt3_gen41_1280x720.raw",
        "evt3_trigger_1280x720.raw",
        "hdf5_dsec_blosc.h5",
        "hdf5_gzip.h5",
        "hdf5_prophesee_compound_zstd.h5",
    ] {
        let Some(path) = data(file) else { return };
        let recording = open(&path).unwrap();
        let whole = Whole::of(&recording);
        whole.check_many(&recording, 20);
        assert_eq!(recording.index().unwrap().events(), whole.0.events.len() as u64);
    }
}

#[test]
fn of_a_coarse_index() {
    let Some(path) = data("evt2_gen3_640x480.raw") else { return };
    let fine = open(&path).unwrap().index().unwrap().bytes();
    let mut options = OpenOptions::default();
    options.limits = index_limit(fine / 4);
    let recording = open_with(&path, &options).unwrap();
    let coarse = recording.index().unwrap().bytes();
    assert!(coarse <= fine / 4, "{coarse} of {fine} bytes");
    Whole::of(&recording).check_many(&recording, 5);
}

fn index_limit(bytes: usize) -> Limits {
    let mut limits = Limits::default();
    limits.index_bytes_max = bytes;
    limits
}

fn write(path: &Path, encoding: Encoding, events: &[(u64, Event)]) {
    let geometry = Geometry::new(2048, 2048);
    let mut writer = raw_writer(path, encoding, geometry, &WriteOptions::default()).unwrap();
    for (t, event) in events {
        writer.write(Span { t_first: *t, t_last: *t, geometry, events: &[*event] }).unwrap();
    }
    writer.finish().unwrap();
}

/// Steps of time: mostly small, now and then back, now and then long silence.
fn steps() -> impl Strategy<Value = Vec<i64>> {
    prop::collection::vec(prop_oneof![9 => 0i64..20, 2 => -40i64..0, 1 => 0i64..40_000_000], 1..40)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Long enough for many checkpoints: each step is repeated.
    #[test]
    fn of_generated_recordings(steps in steps(), coarse in any::<bool>()) {
        let mut t = 1_000_000_000i64;
        let mut events = Vec::new();
        for (i, step) in steps.iter().cycle().take(60_000).enumerate() {
            // EVT3 cannot tell a step back over a wrap of its 24 bits, and refuses it.
            let next = (t + step).max(0);
            t = if next >> 24 < t >> 24 { t } else { next };
            let event = Event::new(t as u32, (i % 1009) as u16, (i % 719) as u16, Polarity::from_bit(i as u16));
            events.push((t as u64, event));
        }
        let folder = tempfile::tempdir().unwrap();
        for encoding in [Encoding::Evt2, Encoding::Evt21(WordOrder::Little), Encoding::Evt3, Encoding::Evt4] {
            let path = folder.path().join(encoding.name());
            write(&path, encoding, &events);
            let mut options = OpenOptions::default();
            options.limits = index_limit(if coarse { 0 } else { 8 << 20 });
            let recording = open_with(&path, &options).unwrap();
            prop_assert!(events_of(&recording) == events, "{}", encoding);
            let back = events.windows(2).filter(|pair| pair[1].0 < pair[0].0).count() as u64;
            prop_assert_eq!(Summary::of(&recording, WithDigest::No).unwrap().steps_back, back);
            Whole::of(&recording).check_many(&recording, 4);
        }
    }
}
