//! Blocks: what stages work on, in stream order, in the caller's memory.
//!
//! Cameras' clocks step back by a few µs now and then: nothing here sorts or clamps.

use crate::{Event, Geometry, Trigger};

/// Largest distance in µs of an event's time from its block's first, so that 32 bits are enough.
pub const SPAN_MAX_US: u64 = 1 << 31;

/// Full time of an event whose 32-bit time is `t`, near `anchor` (within [`SPAN_MAX_US`]).
#[inline]
pub const fn full_time(anchor: u64, t: u32) -> u64 {
    anchor.wrapping_add_signed(t.wrapping_sub(anchor as u32) as i32 as i64)
}

/// Events to read, in stream order, with what is needed to know their full time.
#[derive(Clone, Copy, Debug)]
pub struct Span<'a> {
    /// Anchor of the events' time: that of the first event decoded into the block (it may have been filtered out since).
    pub t_first: u64,
    /// Stream time at the end: that of the last event decoded into the block.
    pub t_last: u64,
    /// The sensor's size; every event is on it.
    pub geometry: Geometry,
    /// The events.
    pub events: &'a [Event],
}

impl<'a> Span<'a> {
    /// Full time of one of the events, in µs.
    #[inline]
    pub const fn time(&self, event: Event) -> u64 {
        full_time(self.t_first, event.t())
    }

    /// Largest distance of an event's time from [`t_first`](Self::t_first), in µs.
    pub fn reach(&self) -> u64 {
        let anchor = self.t_first as u32;
        let distance = |event: &Event| (event.t().wrapping_sub(anchor) as i32).unsigned_abs();
        u64::from(self.events.iter().map(distance).max().unwrap_or(0))
    }

    /// How many of the first events lie within `reach` µs of the first of them: at least 1, but of an empty span.
    pub fn fitting(&self, reach: u64) -> usize {
        let Some(first) = self.events.first() else { return 0 };
        let near = |event: &Event| self.time(*event).abs_diff(self.time(*first)) <= reach;
        self.events.iter().position(|event| !near(event)).unwrap_or(self.events.len())
    }

    /// The same span with a part of its events.
    #[inline]
    pub const fn with_events(self, events: &'a [Event]) -> Self {
        Self { events, ..self }
    }
}

/// Events to change in place, in stream order: what a filter thins and a transform moves.
#[derive(Debug)]
pub struct Block<'a> {
    /// Anchor of the events' time, see [`Span::t_first`]. Filters leave it.
    pub t_first: u64,
    /// Stream time at the end, see [`Span::t_last`]. Filters leave it.
    pub t_last: u64,
    /// The sensor's size.
    pub geometry: Geometry,
    events: &'a mut [Event],
}

impl<'a> Block<'a> {
    /// A block over `events`, whose times all lie within [`SPAN_MAX_US`] of `t_first`.
    pub const fn new(t_first: u64, t_last: u64, geometry: Geometry, events: &'a mut [Event]) -> Self {
        Self { t_first, t_last, geometry, events }
    }

    /// The events, to read.
    #[inline]
    pub const fn span(&self) -> Span<'_> {
        Span { t_first: self.t_first, t_last: self.t_last, geometry: self.geometry, events: self.events }
    }

    /// The events, to change in place.
    #[inline]
    pub const fn events_mut(&mut self) -> &mut [Event] {
        self.events
    }

    /// Number of events.
    #[inline]
    pub const fn len(&self) -> usize {
        self.events.len()
    }

    /// Whether no event is left.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.events.is_empty()
    }

    /// Keeps the first `len` events; more than there are keeps all.
    #[inline]
    pub fn truncate(&mut self, len: usize) {
        let events = core::mem::take(&mut self.events);
        let len = len.min(events.len());
        self.events = events.split_at_mut(len).0;
    }
}

/// Where a decoder puts what it finds: the caller's memory, bounded; full is a state and not an error.
///
/// A sink holds one block: it refuses an event that lies [`SPAN_MAX_US`] or more from its first.
#[derive(Debug)]
pub struct Sink<'a> {
    events: &'a mut [Event],
    len: usize,
    t_first: u64,
    t_last: u64,
    triggers: Option<&'a mut [Trigger]>,
    triggers_len: usize,
}

impl<'a> Sink<'a> {
    /// The least number of events a sink must hold: no word of any format makes more.
    pub const LEN_MIN: usize = 64;

    /// A sink over `events` (at least [`Sink::LEN_MIN`], else a decoder may make no progress). Triggers are counted
    /// by the decoder and not kept.
    pub const fn new(events: &'a mut [Event]) -> Self {
        Self { events, len: 0, t_first: 0, t_last: 0, triggers: None, triggers_len: 0 }
    }

    /// A sink that keeps triggers too; the decoder stops where either is full.
    pub const fn with_triggers(events: &'a mut [Event], triggers: &'a mut [Trigger]) -> Self {
        Self { events, len: 0, t_first: 0, t_last: 0, triggers: Some(triggers), triggers_len: 0 }
    }

    /// Number of events it holds.
    #[inline]
    pub const fn len(&self) -> usize {
        self.len
    }

    /// Whether it holds no event.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// How many more events fit.
    #[inline]
    pub const fn room(&self) -> usize {
        self.events.len() - self.len
    }

    /// Whether an event of time `t` may join the block.
    #[inline]
    pub const fn admits(&self, t: u64) -> bool {
        self.len == 0 || t.abs_diff(self.t_first) < SPAN_MAX_US
    }

    /// Adds an event of full time `t`. False, and nothing is done, when it is full or the time is refused.
    #[inline]
    #[must_use]
    pub fn push(&mut self, t: u64, event: Event) -> bool {
        if !self.admits(t) {
            return false;
        }
        let Some(slot) = self.events.get_mut(self.len) else { return false };
        *slot = event;
        self.commit(1, t, t);
        true
    }

    /// The free memory, for a decoder to write events to and [`commit`](Self::commit).
    #[inline]
    pub fn spare(&mut self) -> &mut [Event] {
        self.events.get_mut(self.len..).unwrap_or_default()
    }

    /// Takes the first `n` events of [`spare`](Self::spare), the first of time `t_first`, the last of `t_last`;
    /// the caller made sure that the sink [admits](Self::admits) them. `n` beyond the spare memory is cut to it.
    #[inline]
    pub fn commit(&mut self, n: usize, t_first: u64, t_last: u64) {
        let n = n.min(self.room());
        if n == 0 {
            return;
        }
        if self.len == 0 {
            self.t_first = t_first;
        }
        self.len += n;
        self.t_last = t_last;
    }

    /// Adds a trigger. False when there is no room for it: the decoder stops before it.
    #[inline]
    #[must_use]
    pub fn push_trigger(&mut self, trigger: Trigger) -> bool {
        let Some(triggers) = self.triggers.as_deref_mut() else { return true };
        let Some(slot) = triggers.get_mut(self.triggers_len) else { return false };
        *slot = trigger;
        self.triggers_len += 1;
        true
    }

    /// The triggers it holds.
    pub fn triggers(&self) -> &[Trigger] {
        self.triggers.as_deref().and_then(|triggers| triggers.get(..self.triggers_len)).unwrap_or_default()
    }

    /// Time of the first event; 0 when empty.
    #[inline]
    pub const fn t_first(&self) -> u64 {
        self.t_first
    }

    /// The events as a block.
    pub fn block(&mut self, geometry: Geometry) -> Block<'_> {
        let events = self.events.get_mut(..self.len).unwrap_or_default();
        Block::new(self.t_first, self.t_last, geometry, events)
    }

    /// Forgets what it holds, for the next block.
    pub fn clear(&mut self) {
        self.len = 0;
        self.triggers_len = 0;
        self.t_first = 0;
        self.t_last = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polarity;

    #[test]
    fn a_sink_refuses_what_32_bits_cannot_tell_apart() {
        let mut memory = [Event::default(); 4];
        let mut sink = Sink::new(&mut memory);
        let at = |t: u64| Event::new(t as u32, 0, 0, Polarity::On);
        let t = 5_000_000_000;
        assert!(sink.push(t, at(t)));
        assert!(!sink.push(t + SPAN_MAX_US, at(t + SPAN_MAX_US)));
        assert!(sink.push(t + SPAN_MAX_US - 1, at(t + SPAN_MAX_US - 1)));
        assert!(sink.push(t - 7, at(t - 7)));
        let block = sink.block(Geometry::new(1, 1));
        let times: [u64; 3] = core::array::from_fn(|i| block.span().time(block.span().events[i]));
        assert_eq!(times, [t, t + SPAN_MAX_US - 1, t - 7]);
    }

    #[test]
    fn a_full_sink_takes_nothing() {
        let mut memory = [Event::default(); 1];
        let mut sink = Sink::new(&mut memory);
        assert!(sink.push(1, Event::default()));
        assert!(!sink.push(1, Event::default()));
        assert_eq!((sink.len(), sink.room()), (1, 0));
    }
}
