//! A sensor's counter of few bits, made a 64-bit time.

/// Unwraps a counter of `BITS` bits by OpenEB's rule: a step forward is one, however long; a step back is a wrap
/// only beyond half the range, else time steps back.
///
/// ```
/// use lobula_core::Unwrap;
/// let mut high = Unwrap::<12>::default();
/// assert_eq!(high.push(3900), 3900);
/// assert_eq!(high.push(50), 4096 + 50); // wrapped
/// assert_eq!(high.push(49), 4096 + 49); // stepped back
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unwrap<const BITS: u32> {
    last: u64,
}

impl<const BITS: u32> Unwrap<BITS> {
    const RANGE: u64 = 1 << BITS;

    /// A counter whose unwrapped value is near `value`: the next reading is taken nearest to it (after a gap).
    pub const fn near(value: u64) -> Self {
        Self { last: value }
    }

    /// The unwrapped value of the next reading; bits above `BITS` are ignored.
    #[inline]
    pub const fn push(&mut self, reading: u64) -> u64 {
        let reading = reading & (Self::RANGE - 1);
        let epoch = self.last & !(Self::RANGE - 1);
        let before = self.last & (Self::RANGE - 1);
        let wrapped = before > reading && before - reading > Self::RANGE / 2;
        self.last = epoch + reading + if wrapped { Self::RANGE } else { 0 };
        self.last
    }

    /// The unwrapped value nearest to `near` whose reading this is: where a gap lost count of the wraps.
    pub const fn resume(&mut self, reading: u64, near: u64) -> u64 {
        let reading = reading & (Self::RANGE - 1);
        let same = (near & !(Self::RANGE - 1)) + reading;
        let half = Self::RANGE / 2;
        self.last = if same > near + half && same >= Self::RANGE {
            same - Self::RANGE
        } else if same + half < near {
            same + Self::RANGE
        } else {
            same
        };
        self.last
    }

    /// The last unwrapped value.
    pub const fn value(&self) -> u64 {
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_back_are_wraps_only_beyond_half_the_range() {
        let mut high = Unwrap::<12>::near(4095);
        assert_eq!(high.push(4095 - 2048), 4095 - 2048);
        let mut high = Unwrap::<12>::near(4095);
        assert_eq!(high.push(4095 - 2049), 4096 + 4095 - 2049);
    }

    #[test]
    fn a_gap_resumes_nearest_to_the_hint() {
        for near in [0u64, 1, 2047, 2048, 4095, 4096, 10_000, 1 << 40] {
            for reading in [0u64, 1, 2047, 2048, 4095] {
                let value = Unwrap::<12>::default().resume(reading, near);
                assert_eq!(value % 4096, reading);
                let best = (0..3u64)
                    .map(|k| (((near / 4096) + k) * 4096 + reading).wrapping_sub(4096))
                    .filter(|v| *v < 1 << 41)
                    .map(|v| v.abs_diff(near))
                    .min();
                assert_eq!(Some(value.abs_diff(near)), best, "near {near} reading {reading}");
            }
        }
    }
}
