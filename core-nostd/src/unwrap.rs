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

    /// The reverse, for encoders: the reading to send next, so that a receiver at this value gets to `target`. A long
    /// way takes several, at most two per wrap: [`push`](Self::push) each and ask again until the value is `target`.
    /// `None` where the rule knows no way: a step back over the end of the range or over more than half of it.
    ///
    /// ```
    /// use lobula_core::Unwrap;
    /// let mut sent = Unwrap::<12>::near(100);
    /// let mut readings = Vec::new();
    /// while sent.value() != 2 * 4096 + 3000 {
    ///     let reading = sent.toward(2 * 4096 + 3000).unwrap();
    ///     sent.push(reading);
    ///     readings.push(reading);
    /// }
    /// assert_eq!(readings, [4095, 0, 4095, 0, 3000]);
    /// assert_eq!(Unwrap::<12>::near(4096).toward(4095), None);
    /// ```
    #[inline]
    pub const fn toward(&self, target: u64) -> Option<u64> {
        let mask = Self::RANGE - 1;
        let same_epoch = target & !mask == self.last & !mask;
        if target < self.last {
            return if same_epoch && self.last - target <= Self::RANGE / 2 {
                Some(target & mask)
            } else {
                None
            };
        }
        if same_epoch || target - self.last < Self::RANGE / 2 {
            return Some(target & mask);
        }
        Some(if self.last & mask > Self::RANGE / 2 { 0 } else { mask })
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
    fn any_value_ahead_is_reached_in_two_readings_per_wrap() {
        for from in [0u64, 1, 2047, 2048, 2049, 4095, 4096 + 5] {
            for to in (from..from + 3 * 4096).step_by(37) {
                let mut sent = Unwrap::<12>::near(from);
                let mut readings = 0;
                while sent.value() != to {
                    let reading = sent.toward(to).unwrap();
                    assert!(sent.push(reading) <= to, "from {from} to {to}");
                    readings += 1;
                }
                assert!(readings <= 2 * (to / 4096 - from / 4096) + 1, "{readings} from {from} to {to}");
            }
        }
    }

    #[test]
    fn a_step_back_is_reached_at_once_or_refused() {
        for from in [0u64, 1, 2047, 2048, 2049, 4095, 4096, 4097, 9000] {
            for to in 0..from {
                let sent = Unwrap::<12>::near(from);
                let reachable = from / 4096 == to / 4096 && from - to <= 2048;
                assert_eq!(sent.toward(to).is_some(), reachable);
                if let Some(reading) = sent.toward(to) {
                    assert_eq!(Unwrap::<12>::near(from).push(reading), to);
                }
            }
        }
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
