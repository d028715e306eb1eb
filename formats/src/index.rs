//! Where to start decoding for an event by its time or number: built once by a full pass, in bounded memory.

use crate::container::{Container, Cursor, Stop};
use crate::recording::Memory;
use crate::{Error, Limits};
use std::ops::Range;

/// Bytes of recording between two checkpoints, at first: about half a millisecond of decoding.
const STRIDE_BYTES: u64 = 128 << 10;

/// Checkpoints of a recording, and what is known after a full pass.
#[derive(Debug)]
pub struct Index {
    segments: Vec<Segment>,
    stride: u64,
    events: u64,
    times: Option<Times>,
}

/// The stretch of a recording from one checkpoint to the next.
#[derive(Debug)]
struct Segment {
    /// At its start.
    cursor: Box<dyn Cursor>,
    /// Number of its first event.
    event_first: u64,
    /// Times of its events and triggers.
    times: Option<Times>,
}

/// Earliest and latest time, both inclusive, in µs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Times {
    /// Earliest.
    pub t_min: u64,
    /// Latest.
    pub t_max: u64,
}

impl Times {
    pub(crate) fn join(a: Option<Self>, b: Option<Self>) -> Option<Self> {
        match (a, b) {
            (Some(a), Some(b)) => Some(Self { t_min: a.t_min.min(b.t_min), t_max: a.t_max.max(b.t_max) }),
            (one, other) => one.or(other),
        }
    }

    pub(crate) fn overlaps(self, t: &Range<u64>) -> bool {
        self.t_min < t.end && self.t_max >= t.start
    }
}

impl Index {
    pub(crate) fn build(container: &dyn Container, limits: &Limits) -> Result<Self, Error> {
        let mut index = Self { segments: Vec::new(), stride: STRIDE_BYTES, events: 0, times: None };
        let mut cursor = container.start();
        let mut memory = Memory::new(container.geometry_of_blocks());
        let mut next = 0;
        loop {
            if cursor.position() >= next {
                index.checkpoint(&*cursor, limits);
                next = cursor.position() + index.stride;
            }
            let stop = memory.fill(&mut *cursor)?;
            index.add(&memory);
            if stop == Stop::End {
                return Ok(index);
            }
        }
    }

    fn checkpoint(&mut self, cursor: &dyn Cursor, limits: &Limits) {
        let segment = Segment { cursor: cursor.fork(), event_first: self.events, times: None };
        self.segments.push(segment);
        if self.segments.len() > 2 && self.bytes() > limits.index_bytes_max {
            self.thin_out();
        }
    }

    /// Joins every second segment with the one before it.
    fn thin_out(&mut self) {
        self.stride *= 2;
        let mut thinned: Vec<Segment> = Vec::new();
        for (i, segment) in self.segments.drain(..).enumerate() {
            match thinned.last_mut() {
                Some(last) if i % 2 == 1 => last.times = Times::join(last.times, segment.times),
                _ => thinned.push(segment),
            }
        }
        self.segments = thinned;
    }

    fn add(&mut self, memory: &Memory) {
        let times = memory.times();
        self.events += memory.events().len() as u64;
        self.times = Times::join(self.times, times);
        if let Some(last) = self.segments.last_mut() {
            last.times = Times::join(last.times, times);
        }
    }

    /// Number of events.
    pub fn events(&self) -> u64 {
        self.events
    }

    /// Times of all events and triggers; `None` if there are none.
    pub fn times(&self) -> Option<Times> {
        self.times
    }

    /// Memory that the checkpoints take, in bytes.
    pub fn bytes(&self) -> usize {
        let cursor = self.segments.first().map_or(0, |segment| size_of_val(&*segment.cursor));
        self.segments.len() * (size_of::<Segment>() + cursor)
    }

    /// From where to where to decode for everything with `t.start <= time < t.end`: a cursor, the number of its next
    /// event, and the position at which to stop.
    pub(crate) fn seek_time(&self, t: &Range<u64>) -> Option<Seek> {
        let inside = |segment: &Segment| segment.times.is_some_and(|times| times.overlaps(t));
        let first = self.segments.iter().position(inside)?;
        let last = self.segments.iter().rposition(inside)?;
        let end = self.segments.get(last + 1).map_or(u64::MAX, |next| next.cursor.position());
        Some(self.seek(first, end))
    }

    /// From where to decode for the event of this number.
    pub(crate) fn seek_event(&self, number: u64) -> Option<Seek> {
        // The first of those that start at it: a segment without events may hold triggers before it.
        let after = self.segments.partition_point(|segment| segment.event_first < number);
        (!self.segments.is_empty()).then(|| self.seek(after.saturating_sub(1), u64::MAX))
    }

    fn seek(&self, segment: usize, end: u64) -> Seek {
        let segment = &self.segments[segment];
        Seek { cursor: segment.cursor.fork(), event_next: segment.event_first, end }
    }
}

/// Where to decode.
#[derive(Debug)]
pub(crate) struct Seek {
    pub cursor: Box<dyn Cursor>,
    pub event_next: u64,
    pub end: u64,
}
