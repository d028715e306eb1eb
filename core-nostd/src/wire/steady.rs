//! Steady stretches of EVT 2.0 and 2.1: events on the sensor, and TIME_HIGH words within a [`Reach`]. Kernels go through
//! them; every other word is the decoder's.

use super::evt2::Limits;
use super::time_high::{LOW_BITS, Reach};

/// What a kernel is given, and leaves to the next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steady {
    /// Pixels that an event, or a vector's first, may have.
    pub limits: Limits,
    /// TIME_HIGH words that only move the base.
    pub reach: Reach,
    /// Time in µs modulo 2^32 of a word with low bits 0.
    pub base: u32,
}

impl Steady {
    /// Moves the base if the upper half of a word is a TIME_HIGH within reach. All bits set if so, else none: these
    /// words come at random, so a branch would be mispredicted.
    #[inline(always)]
    pub fn take_time(&mut self, head: u32) -> u32 {
        let is_time = self.reach.mask(head);
        self.base = self.base & !is_time | head << LOW_BITS & is_time;
        is_time
    }
}
