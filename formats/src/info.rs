//! What `lobula info` tells of a recording, after one pass over it.

use crate::{Digest, Error, Recording, Stream, StreamKind};
use lobula_core::{Counters, Event, Fault, Span};
use serde::Serialize;
use std::collections::BTreeMap;

/// Facts of a recording; serialised, these are the names in `lobula info --json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Summary {
    /// Name of the format.
    pub format: &'static str,
    /// Name of the camera's encoding, where there is one.
    pub encoding: Option<&'static str>,
    /// Length of the file in bytes.
    pub bytes: u64,
    /// Columns of the sensor; null where unknown.
    pub width: Option<u16>,
    /// Rows of the sensor; null where unknown.
    pub height: Option<u16>,
    /// Number of events.
    pub events: u64,
    /// Those that are ON.
    pub on: u64,
    /// Those that are OFF.
    pub off: u64,
    /// Time of the first event in the file, in µs; null if there is none.
    pub t_first_us: Option<u64>,
    /// Time of the last event in the file, in µs; null if there is none.
    pub t_last_us: Option<u64>,
    /// Events earlier than the one before them.
    pub steps_back: u64,
    /// External triggers.
    pub triggers: u64,
    /// Samples of the inertial sensor.
    pub imu: u64,
    /// Frames.
    pub frames: u64,
    /// Every stream of the file, also those we do not read.
    pub streams: Vec<Stream>,
    /// Sentences about what is odd in the file and was no error.
    pub warnings: Vec<String>,
    /// Events whose pixel is not on the sensor: dropped.
    pub off_sensor: u64,
    /// Events and triggers that the file marks as invalid: dropped.
    pub marked_invalid: u64,
    /// Bytes of well-formed words.
    pub bytes_decoded: u64,
    /// Bytes of malformed words.
    pub bytes_faulty: u64,
    /// Malformed words by kind.
    pub faults: BTreeMap<&'static str, u64>,
    /// The [`Digest`] of all events; null where it was not asked for.
    pub sha256: Option<String>,
}

/// Whether to hash every event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WithDigest {
    /// Yes; it costs more than decoding.
    Yes,
    /// No.
    No,
}

impl Summary {
    /// Reads the whole recording, in constant memory.
    ///
    /// # Errors
    /// Those of reading the file.
    pub fn of(recording: &Recording, digest: WithDigest) -> Result<Self, Error> {
        let mut summary = Self::header(recording);
        let mut digest = (digest == WithDigest::Yes).then(Digest::default);
        let mut blocks = recording.blocks();
        while let Some(chunk) = blocks.next_block()? {
            summary.add(chunk.span());
            if let Some(digest) = &mut digest {
                digest.update(chunk.span());
            }
        }
        summary.count(&blocks.counters());
        summary.count_side_items(recording)?;
        summary.sha256 = digest.map(Digest::finish);
        // Last: some show in the passes.
        summary.warnings = recording.warnings();
        summary.warnings.extend(invalid_sentence(summary.marked_invalid, "events and triggers"));
        Ok(summary)
    }

    fn header(recording: &Recording) -> Self {
        let geometry = recording.geometry();
        Self {
            format: recording.format().name,
            encoding: recording.encoding().map(|encoding| encoding.name()),
            bytes: recording.bytes(),
            width: geometry.map(|geometry| geometry.width),
            height: geometry.map(|geometry| geometry.height),
            streams: recording.streams(),
            ..Self::default()
        }
    }

    fn add(&mut self, span: Span<'_>) {
        let (Some(first), Some(last)) = (span.events.first(), span.events.last()) else { return };
        let on: u64 = span.events.iter().map(|event| u64::from(event.is_on())).sum();
        self.events += span.events.len() as u64;
        self.on += on;
        self.off += span.events.len() as u64 - on;
        self.steps_back += steps_back(span);
        self.steps_back += u64::from(self.t_last_us.is_some_and(|last| span.time(*first) < last));
        self.t_first_us = self.t_first_us.or(Some(span.time(*first)));
        self.t_last_us = Some(span.time(*last));
    }

    /// Streams that the file does not have are not looked for.
    fn count_side_items(&mut self, recording: &Recording) -> Result<(), Error> {
        let has = |kind| self.streams.iter().any(|stream| stream.kind == kind);
        let (imu, frames) = (has(StreamKind::Imu), has(StreamKind::Frames));
        if imu {
            self.imu = recording.imu().try_fold(0, |n, sample| sample.map(|_| n + 1))?;
        }
        if frames {
            self.frames = recording.frames().try_fold(0, |n, frame| frame.map(|_| n + 1))?;
        }
        Ok(())
    }

    fn count(&mut self, counters: &Counters) {
        self.triggers = counters.triggers;
        self.off_sensor = counters.off_sensor;
        self.marked_invalid = counters.marked_invalid;
        self.bytes_decoded = counters.bytes_decoded;
        self.bytes_faulty = counters.bytes_faulty;
        self.faults = Fault::ALL.map(|fault| (fault.name(), counters.faults.get(fault))).into();
    }
}

/// A warning about what a file marks as invalid, if there is any.
pub(crate) fn invalid_sentence(count: u64, what: &str) -> Option<String> {
    (count > 0)
        .then(|| format!("{count} {what} are marked invalid by the program that wrote the file: left out"))
}

/// Events of a block earlier than the one before them.
fn steps_back(span: Span<'_>) -> u64 {
    // Distance to the anchor fits 32 bits and has no branch.
    let near = |event: &Event| event.t().wrapping_sub(span.t_first as u32) as i32;
    let after = span.events.get(1..).unwrap_or_default();
    span.events.iter().zip(after).map(|(before, after)| u64::from(near(after) < near(before))).sum()
}
