//! The 32-bit counter of AEDAT 2, made a time of 64 bits.
//!
//! A step of less than a second, forward or back, is taken as it is, also over the end of the range: clocks jitter.
//! A longer step forward is one, however long; a longer step back is a wrap beyond half the range, else time steps
//! back. So neither jitter around a wrap nor hours of silence are mistaken for the other.

use super::{Addresses, RECORD_BYTES, split};
use lobula_core::Event;
use lobula_core::vector::in_order;

/// Longest step that is jitter wherever it falls, in µs.
const JITTER_US: i64 = 1 << 20;
/// Range of the counter in µs.
const RANGE_US: i64 = 1 << 32;

/// Where the counter is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Clock {
    /// Time of the last record in µs.
    last: i64,
    started: bool,
}

impl Clock {
    /// The time of the next record by its reading.
    #[inline]
    pub fn peek(&self, reading: u32) -> i64 {
        let step = i64::from(reading.wrapping_sub(self.last as u32) as i32);
        if self.started && step.abs() < JITTER_US {
            return self.last + step;
        }
        let epoch = self.last & !(RANGE_US - 1);
        let before = self.last & (RANGE_US - 1);
        let wrapped = before - i64::from(reading) > RANGE_US / 2;
        epoch + i64::from(reading) + if wrapped { RANGE_US } else { 0 }
    }

    /// The record was taken, and this was its time.
    #[inline]
    pub fn set(&mut self, t: i64) {
        (self.last, self.started) = (t, true);
    }

    /// Whether a record was taken.
    pub fn is_started(&self) -> bool {
        self.started
    }

    /// The earliest and latest time that [`take_all`](Self::take_all) takes: so near that no two of them are further
    /// from each other than jitter. `None` before the first record.
    pub fn near(&self) -> Option<(i64, i64)> {
        self.started.then_some((self.last - JITTER_US / 2, self.last + JITTER_US / 2 - 1))
    }

    /// Turns records into events, if each is one and its time is [near](Self::near); `low` is the earliest of these
    /// times, shifted. Gives the times of the first and the last, shifted.
    #[inline(always)]
    pub fn take_all(
        &mut self,
        records: &[[u8; RECORD_BYTES]],
        events: &mut [Event],
        low: u64,
        addresses: impl Addresses,
    ) -> Option<(u64, u64)> {
        let start = (self.last - JITTER_US / 2) as u32;
        let wrong = in_order(
            #[inline(always)]
            || {
                let mut wrong = 0;
                for (record, slot) in records.iter().zip(events) {
                    let (address, reading) = split(*record);
                    let after = reading.wrapping_sub(start);
                    let (pixel, off) = addresses.pixel(address);
                    let t = (low as u32).wrapping_add(after);
                    *slot = Event::from_word(u64::from(pixel) << 32 | u64::from(t));
                    wrong |= off | (after & !(JITTER_US as u32 - 1));
                }
                wrong
            },
        );
        if wrong != 0 {
            return None;
        }
        let after = |record: &[u8; RECORD_BYTES]| u64::from(split(*record).1.wrapping_sub(start));
        let (first, last) = (after(records.first()?), after(records.last()?));
        self.last += last as i64 - JITTER_US / 2;
        Some((low + first, low + last))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(readings: &[u32], expected: &[i64]) {
        let mut clock = Clock::default();
        let times: Vec<_> = readings
            .iter()
            .map(|reading| {
                let t = clock.peek(*reading);
                clock.set(t);
                t
            })
            .collect();
        assert_eq!(times, expected);
    }

    #[test]
    fn jitter_around_a_wrap() {
        const W: i64 = RANGE_US;
        check(&[u32::MAX - 1, 3, u32::MAX, 4, u32::MAX - 9, 9], &[W - 2, W + 3, W - 1, W + 4, W - 10, W + 9]);
    }

    #[test]
    fn silence_and_wraps() {
        const W: i64 = RANGE_US;
        check(
            &[5, 3_000_000_000, 10, 4_000_000_000, 7],
            &[5, 3_000_000_000, W + 10, W + 4_000_000_000, 2 * W + 7],
        );
        check(&[3_000_000_000, 2_000_000_000], &[3_000_000_000, 2_000_000_000]);
        check(&[0x7FFF_FFFF, 0x8000_0000, 0x8000_0001], &[0x7FFF_FFFF, 0x8000_0000, 0x8000_0001]);
    }

    #[test]
    fn a_step_back_over_the_start_is_negative() {
        check(&[2, u32::MAX, 3], &[2, -1, 3]);
        check(&[u32::MAX, 3], &[i64::from(u32::MAX), RANGE_US + 3]);
    }
}
