//! Periods of stream time: the fixed points at which a filter's counters change, whatever the packets.

use crate::Event;
use core::num::NonZeroU64;

/// Tells when a period ends. Periods begin at multiples of their length.
///
/// An event that stepped back by up to a period belongs to the open one; a longer step back is a restart of the camera's
/// clock.
#[derive(Clone, Copy, Debug)]
pub(super) struct Periods {
    length_us: NonZeroU64,
    start: u64,
    started: bool,
}

/// How many periods have ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ended {
    /// So many, one after the other.
    Periods(u64),
    /// The clock restarted, or started: nothing before it says anything.
    All,
}

impl Periods {
    pub(super) const fn new(length_us: NonZeroU64) -> Self {
        Self { length_us, start: 0, started: false }
    }

    /// Full time of an event of no block: the nearest to the newest period.
    pub(super) fn time(&self, event: Event) -> u64 {
        if !self.started {
            return event.t() as u64;
        }
        self.start.saturating_add_signed(event.t().wrapping_sub(self.start as u32) as i32 as i64)
    }

    /// What ended, if anything, now that stream time is at `t`.
    #[inline(always)]
    pub(super) fn ended(&mut self, t: u64) -> Option<Ended> {
        let inside = self.started & (t.wrapping_sub(self.start) < self.length_us.get());
        if inside { None } else { self.turn(t) }
    }

    #[cold]
    fn turn(&mut self, t: u64) -> Option<Ended> {
        let length = self.length_us;
        if self.started && t < self.start && self.start - t <= length.get() {
            return None;
        }
        let start = t - t % length;
        let ended = match self.started && t >= self.start {
            true => Ended::Periods(start.wrapping_sub(self.start) / length),
            false => Ended::All,
        };
        (self.start, self.started) = (start, true);
        Some(ended)
    }
}
