//! Whether a recording is whole and in order, and what of it can be read.

use crate::info::invalid_sentence;
use crate::{Error, Recording, StreamKind};
use lobula_core::{Fault, Span};
use serde::Serialize;
use std::collections::BTreeMap;

/// What a full pass over a recording found; serialised, these are the names in `lobula check --json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Check {
    /// Whether every byte could be read and every event lies on the sensor.
    pub sound: bool,
    /// Whether no event is earlier than the one before it.
    pub in_order: bool,
    /// Events that can be read.
    pub events: u64,
    /// Triggers that can be read.
    pub triggers: u64,
    /// Samples of the inertial sensor that can be read.
    pub imu: u64,
    /// Frames that can be read.
    pub frames: u64,
    /// Time of the first event that can be read, in µs; null if there is none.
    pub t_first_us: Option<u64>,
    /// Time of the last event that can be read, in µs; null if there is none.
    pub t_last_us: Option<u64>,
    /// Events earlier than the one before them.
    pub steps_back: u64,
    /// The largest such step, in µs.
    pub step_back_max_us: u64,
    /// Events whose pixel is not on the sensor: dropped by readers.
    pub off_sensor: u64,
    /// Events and triggers that the file marks as invalid: dropped by readers.
    pub marked_invalid: u64,
    /// Bytes that cannot be read.
    pub bytes_faulty: u64,
    /// What is wrong with them, by kind.
    pub faults: BTreeMap<&'static str, u64>,
    /// Why reading ended before the end of the file, of each stream that did.
    pub errors: Vec<String>,
    /// What else is odd.
    pub warnings: Vec<String>,
}

impl Check {
    /// Reads the whole recording, in constant memory. What is wrong is told, never an error.
    pub fn of(recording: &Recording, mut progress: impl FnMut(u64)) -> Self {
        let mut check = Self { in_order: true, ..Self::default() };
        let mut blocks = recording.blocks();
        loop {
            match blocks.next_block() {
                Ok(Some(chunk)) => {
                    check.triggers += chunk.triggers.len() as u64;
                    check.add(chunk.span());
                }
                Ok(None) => break,
                Err(error) => {
                    check.errors.push(error.to_string());
                    break;
                }
            }
            progress(blocks.position());
        }
        let counters = blocks.counters();
        (check.off_sensor, check.bytes_faulty) = (counters.off_sensor, counters.bytes_faulty);
        check.marked_invalid = counters.marked_invalid;
        check.faults = Fault::ALL.map(|fault| (fault.name(), counters.faults.get(fault))).into();
        check.side_streams(recording);
        // After the pass, which finds some of them.
        check.warnings = recording.warnings();
        check.warnings.extend(invalid_sentence(check.marked_invalid, "events and triggers"));
        check.in_order = check.steps_back == 0;
        check.sound = check.errors.is_empty() && check.bytes_faulty == 0 && check.off_sensor == 0;
        check
    }

    fn side_streams(&mut self, recording: &Recording) {
        let streams = recording.streams();
        let has = |kind| streams.iter().any(|stream| stream.kind == kind);
        if has(StreamKind::Imu) {
            self.imu = self.count(recording.imu());
        }
        if has(StreamKind::Frames) {
            self.frames = self.count(recording.frames());
        }
    }

    /// Number of items before the end or an error.
    fn count<T>(&mut self, items: impl Iterator<Item = Result<T, Error>>) -> u64 {
        let mut good = 0;
        for item in items {
            match item {
                Ok(_) => good += 1,
                Err(error) => {
                    self.errors.push(error.to_string());
                    break;
                }
            }
        }
        good
    }

    fn add(&mut self, span: Span<'_>) {
        self.events += span.events.len() as u64;
        for event in span.events {
            let t = span.time(*event);
            self.t_first_us.get_or_insert(t);
            let back = self.t_last_us.map_or(0, |last| last.saturating_sub(t));
            self.steps_back += u64::from(back > 0);
            self.step_back_max_us = self.step_back_max_us.max(back);
            self.t_last_us = Some(t);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open;

    /// EVT2: TIME_HIGH, then ON events at 5, 9 and 7 µs, a word of no type, and half a word.
    #[test]
    fn tells_steps_back_and_damage() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("it.raw");
        let event = |t: u32| (1 << 28) | (t << 22) | (3 << 11) | 4;
        let words = [8 << 28, event(5), event(9), event(7), 3 << 28].map(u32::to_le_bytes);
        let header: &[u8] = b"% evt 2.0\n% geometry 640x480\n% end\n";
        std::fs::write(&path, [header, words.as_flattened(), &[1, 2]].concat()).unwrap();
        let check = Check::of(&open(&path).unwrap(), |_| {});
        assert_eq!((check.events, check.t_first_us, check.t_last_us), (3, Some(5), Some(7)));
        assert_eq!((check.steps_back, check.step_back_max_us, check.in_order), (1, 2, false));
        assert_eq!((check.bytes_faulty, check.sound), (6, false));
        assert_eq!((check.faults["unknown_word"], check.faults["cut_short"]), (1, 1));
    }
}
