//! Times of 32 bits in µs, made 64 bits: they wrap after 71 minutes and 35 seconds.

/// Farthest that an event may step back over the end of the range and still be late, not a gap of 71 minutes: 8.4 s.
const LATE_US_MAX: u64 = 1 << 23;

/// Unwraps times of 32 bits: a step forward is one however long, a step back of more than half the range is a wrap,
/// and after a wrap an event may be late by [`LATE_US_MAX`] from before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Wrap32 {
    last: u64,
}

impl Wrap32 {
    /// After how many µs the readings wrap.
    pub const RANGE: u64 = 1 << 32;

    /// After this reading in the second range: for a stretch that knows neither how many came before it nor, below
    /// that range, whether there was one.
    pub fn after(reading: u32) -> Self {
        Self { last: Self::RANGE + u64::from(reading) }
    }

    /// The full time of the next reading.
    #[inline]
    pub fn push(&mut self, reading: u32) -> u64 {
        let step = reading.wrapping_sub(self.last as u32) as i32;
        let epoch = self.last & !(Self::RANGE - 1);
        self.last = match self.last.checked_add_signed(step.into()) {
            Some(nearest) if nearest >= epoch || u64::from(step.unsigned_abs()) <= LATE_US_MAX => nearest,
            _ => epoch + u64::from(reading),
        };
        self.last
    }

    /// The full time of the last reading.
    pub fn last(&self) -> u64 {
        self.last
    }

    /// Goes on from this full time, which a [`push`](Self::push) of every reading before would have come to.
    #[inline]
    pub fn set(&mut self, last: u64) {
        self.last = last;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(readings: &[u64], expected: &[u64]) {
        let mut wrap = Wrap32::default();
        let found: Vec<_> = readings.iter().map(|reading| wrap.push(*reading as u32)).collect();
        assert_eq!(found, expected);
    }

    const END: u64 = 1 << 32;

    #[test]
    fn what_comes_after_the_end_of_the_range_is_a_wrap() {
        check(&[END - 3, 2, END - 1, 5], &[END - 3, END + 2, END - 1, END + 5]);
        check(&[END - 1, 0, END - 1, 0, 1], &[END - 1, END, END - 1, END, END + 1]);
    }

    #[test]
    fn late_events_stay_late_in_any_epoch() {
        check(&[100, 50, 100, 0], &[100, 50, 100, 0]);
        check(&[3 << 30, 5, 3, 3 << 30, 9], &[3 << 30, END + 5, END + 3, END + (3 << 30), 2 * END + 9]);
    }

    #[test]
    fn gaps_up_to_a_whole_range_are_gaps() {
        check(&[7, END - 1], &[7, END - 1]);
        check(&[END - 1, 0, END - 1 - LATE_US_MAX - 1], &[END - 1, END, 2 * END - 1 - LATE_US_MAX - 1]);
        check(&[END - 1, 0, END - LATE_US_MAX], &[END - 1, END, END - LATE_US_MAX]);
        check(&[END - 1, END - 2], &[END - 1, END - 2]);
    }
}
