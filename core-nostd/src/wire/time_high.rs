//! The time of EVT 2.0 and 2.1: 34 bits of µs, of which a TIME_HIGH word tells the upper 28 and each event the
//! lower 6. 34 bits wrap after 4 h 46 min; [`Unwrap`] makes them 64.

use crate::{Refused, Unwrap};

/// Bits of the time that each event carries.
pub(super) const LOW_BITS: u32 = 6;
/// Bits of the time that a TIME_HIGH word carries.
pub(super) const HIGH_BITS: u32 = 28;
/// Latest time of the first event: beyond it time is of an epoch, and thousands of wraps would have to be told.
const START_MAX_US: u64 = 1 << 40;

/// What a decoder knows of the time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Known {
    /// Nothing yet; the next TIME_HIGH goes on from the last.
    No,
    /// Nothing since bytes were lost, but where it must be near.
    Near(u64),
    Yes,
}

/// The decoder's clock.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    high: Unwrap<HIGH_BITS>,
    known: Known,
    now: u64,
}

impl Clock {
    pub(super) const fn new() -> Self {
        Self { high: Unwrap::near(0), known: Known::No, now: 0 }
    }

    /// A TIME_HIGH word. One that repeats the last keeps the low bits of [`now`](Self::now).
    #[inline]
    pub(super) fn time_high(&mut self, reading: u64) {
        let high = match self.known {
            Known::Near(near) => self.high.resume(reading, near >> LOW_BITS),
            _ => self.high.push(reading),
        };
        self.known = Known::Yes;
        if self.now >> LOW_BITS != high {
            self.now = high << LOW_BITS;
        }
    }

    /// Time in µs of a word with low bits 0; `None` before it is known.
    #[inline]
    pub(super) fn base(&self) -> Option<u64> {
        (self.known == Known::Yes).then_some(self.high.value() << LOW_BITS)
    }

    /// An event of this time came.
    #[inline]
    pub(super) fn set_now(&mut self, t: u64) {
        self.now = t;
    }

    pub(super) const fn now(&self) -> u64 {
        self.now
    }

    /// Forgets the time until the next TIME_HIGH.
    pub(super) fn gap(&mut self, near: Option<u64>) {
        self.known = near.map_or(Known::No, Known::Near);
    }
}

/// The encoder's clock: the value a decoder of the words so far has.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClockOut {
    high: Unwrap<HIGH_BITS>,
    /// Time of the last event asked for; `None` before the first.
    t: Option<u64>,
    /// Whether a TIME_HIGH was sent.
    told: bool,
}

impl ClockOut {
    pub(super) const fn new() -> Self {
        Self { high: Unwrap::near(0), t: None, told: false }
    }

    /// The reading of the TIME_HIGH word to send next, so that an event of time `t` can follow; `None` when it can
    /// now. Refused where no words tell that time.
    #[inline]
    pub(super) fn toward(&mut self, t: u64) -> Result<Option<u64>, Refused> {
        if self.t.is_none() && t > START_MAX_US {
            return Err(Refused::StartTooLate { t });
        }
        let high = t >> LOW_BITS;
        if self.told && self.high.value() == high {
            self.t = Some(t);
            return Ok(None);
        }
        let from = self.t.unwrap_or(0);
        let reading = self.high.toward(high).ok_or(Refused::StepBack { from, to: t })?;
        self.high.push(reading);
        self.told = true;
        self.t = self.t.or(Some(0));
        Ok(Some(reading))
    }
}
