//! How many events each element had, as digits to the base of 256, each digit in a plane of its own.
//!
//! Few pixels have more than 255 events in a window, so that nearly all the work is in one plane of bytes, a quarter of
//! what 32-bit counts take; and with few different counts there are, a table does for any function of them.

use core::ops::Range;

use crate::representation::BadRepresentation;
use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::pixel::uncount_each;
use crate::vector::widest;
use crate::{Event, Geometry};

/// Digits of a count.
const DIGITS: usize = 4;

/// Counts of events by pixel and polarity (ON, OFF), exact up to 2^32 - 1, in memory of the caller's.
#[derive(Clone, Debug)]
pub(super) struct Digits<S> {
    geometry: Geometry,
    state: S,
    /// Whether there is a digit but the lowest.
    carried: bool,
    /// Whether there is a count at all; whatever the memory held at first counts as one.
    counted: bool,
    saturated: u64,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Digits<S> {
    /// Elements of the memory.
    pub(super) const fn state_len(geometry: Geometry) -> usize {
        DIGITS * (2 * geometry.pixels()).div_ceil(DIGITS)
    }

    pub(super) fn try_new(geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        let (expected, found) = (Self::state_len(geometry), state.as_ref().len());
        if expected != found {
            return Err(BadRepresentation::StateLen { expected, found });
        }
        Ok(Self { geometry, state, carried: true, counted: true, saturated: 0 })
    }

    /// Events that could not be counted, since the start.
    pub(super) const fn saturated(&self) -> u64 {
        self.saturated
    }

    /// All counts are 0 again.
    pub(super) fn clear(&mut self) {
        let all =
            if self.carried { self.state.as_ref().len() } else { Self::state_len(self.geometry) / DIGITS };
        if let Some(words) = self.state.as_mut().get_mut(..all).filter(|_| self.counted) {
            words.fill(0);
        }
        (self.carried, self.counted) = (false, false);
    }

    pub(super) fn accumulate(&mut self, events: &[Event]) {
        let stride = Self::state_len(self.geometry) / DIGITS * size_of::<u32>();
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(self.state.as_mut());
        let (lowest, higher) = bytes.split_at_mut_checked(stride).unwrap_or_default();
        let mut counting = Counting { higher, stride, carried: false, saturated: 0 };
        let places = Places::by_polarity(self.geometry);
        widest(
            #[inline(always)]
            || draw_each(events, places, lowest, &mut counting),
        );
        self.carried |= counting.carried;
        self.saturated += counting.saturated;
        self.counted = true;
    }

    /// Takes back what counting these events did; returns whether the counts are then those of the others. Where there
    /// is a digit but the lowest they are not, and all have to be cleared.
    pub(super) fn take_away(&mut self, events: &[Event]) -> bool {
        let digits: &mut [u8] = bytemuck::cast_slice_mut(self.state.as_mut());
        let lowest = digits.get_mut(..2 * self.geometry.pixels()).unwrap_or_default();
        !self.carried && uncount_each(Places::by_polarity(self.geometry), events, lowest)
    }

    /// The lowest digits of both planes, ON and OFF.
    fn lowest(&self) -> &[u8] {
        bytemuck::cast_slice(self.state.as_ref()).get(..2 * self.geometry.pixels()).unwrap_or_default()
    }

    /// One count.
    pub(super) fn count(&self, at: usize) -> u32 {
        let stride = Self::state_len(self.geometry) / DIGITS * size_of::<u32>();
        let bytes: &[u8] = bytemuck::cast_slice(self.state.as_ref());
        let digit = |place: usize| u32::from(bytes.get(place * stride + at).copied().unwrap_or_default());
        (0..DIGITS).fold(0, |count, place| count | digit(place) << (8 * place))
    }

    /// Writes a function of each count from that of number `from` on.
    pub(super) fn map<T: Copy>(&self, from: usize, out: &mut [T], function: impl Fn(u32) -> T) {
        let table: [T; 256] = core::array::from_fn(|count| function(count as u32));
        let lowest = self.lowest().get(from..).unwrap_or_default();
        let (words, rest) = lowest.as_chunks::<8>();
        let (eights, last) = out.as_chunks_mut::<8>();
        let done = words.len().min(eights.len());
        for (out, word) in eights.iter_mut().zip(words) {
            // Most pixels have no event: eight at once are told by one comparison.
            if u64::from_ne_bytes(*word) == 0 {
                *out = [table[0]; 8];
            } else {
                *out = word.map(|digit| table[usize::from(digit)]);
            }
        }
        let after = eights.get_mut(done..).unwrap_or_default().as_flattened_mut().iter_mut().chain(last);
        let digits = words.get(done..).unwrap_or_default().as_flattened().iter().chain(rest);
        for (out, digit) in after.zip(digits) {
            *out = table[usize::from(*digit)];
        }
        self.map_large(from, out, function);
    }

    /// The same for counts of more than one digit.
    fn map_large<T>(&self, from: usize, out: &mut [T], function: impl Fn(u32) -> T) {
        if !self.carried {
            return;
        }
        let to = 2 * self.geometry.pixels();
        for (out, count) in out.iter_mut().zip((from..to).map(|at| self.count(at))) {
            if count > u8::MAX.into() {
                *out = function(count);
            }
        }
    }

    /// Writes a function of each pixel's pair of levels (ON, OFF), which are functions of the counts.
    pub(super) fn map_pairs<T: Copy>(
        &self,
        out: &mut [u8],
        [on_level, off_level]: [impl Fn(u32) -> T; 2],
        function: impl Fn(T, T) -> u8,
    ) {
        let pixels = self.geometry.pixels();
        let on_table: [T; 256] = core::array::from_fn(|count| on_level(count as u32));
        let off_table: [T; 256] = core::array::from_fn(|count| off_level(count as u32));
        let (ons, offs) = self.lowest().split_at_checked(pixels).unwrap_or_default();
        let nothing = function(on_table[0], off_table[0]);
        for ((out, ons), offs) in out.chunks_mut(8).zip(ons.chunks(8)).zip(offs.chunks(8)) {
            if ons.iter().chain(offs).fold(0, |any, digit| any | digit) == 0 {
                out.iter_mut().zip(ons).for_each(|(out, _)| *out = nothing);
                continue;
            }
            for (out, (on, off)) in out.iter_mut().zip(ons.iter().zip(offs)) {
                *out = function(on_table[usize::from(*on)], off_table[usize::from(*off)]);
            }
        }
        if self.carried {
            for (at, out) in out.iter_mut().take(pixels).enumerate() {
                *out = function(on_level(self.count(at)), off_level(self.count(pixels + at)));
            }
        }
    }

    /// Writes which of two a pixel is: without an event, with one.
    pub(super) fn any(&self, out: &mut [u8], [none, some]: [u8; 2]) {
        let pixels = self.geometry.pixels();
        let (ons, offs) = self.lowest().split_at_checked(pixels).unwrap_or_default();
        widest(
            #[inline(always)]
            || {
                for (out, (on, off)) in out.iter_mut().zip(ons.iter().zip(offs)) {
                    *out = if on | off == 0 { none } else { some };
                }
            },
        );
        if self.carried {
            for (at, out) in out.iter_mut().take(pixels).enumerate() {
                *out = if self.count(at) | self.count(pixels + at) == 0 { none } else { some };
            }
        }
    }

    /// The greatest count.
    pub(super) fn max(&self) -> u32 {
        if self.carried {
            return (0..2 * self.geometry.pixels()).map(|at| self.count(at)).max().unwrap_or_default();
        }
        let lowest = self.lowest();
        widest(
            #[inline(always)]
            || lowest.iter().fold(0, |most, digit| most.max(*digit)),
        )
        .into()
    }

    /// The percentile of the counts that are not 0 among those numbered by `cells`, linear between two as numpy's
    /// default is; 1 where there is none.
    pub(super) fn percentile(&self, cells: Range<usize>, percent: u8) -> f64 {
        let len = cells.len() as u64;
        let lowest = self.lowest().get(cells.clone()).unwrap_or_default();
        let histogram = (!self.carried).then(|| Histogram::of(lowest));
        let zeros = match &histogram {
            Some(histogram) => u64::from(histogram.0[0]),
            None => cells.clone().filter(|at| self.count(*at) == 0).count() as u64,
        };
        let Some(last) = len.saturating_sub(zeros).checked_sub(1) else { return 1.0 };
        let position = f64::from(percent) / 100.0 * last as f64;
        let (below, fraction) = (position as u64, position - position as u64 as f64);
        let at = |rank: u64| match &histogram {
            Some(histogram) => histogram.rank(zeros + rank).0,
            None => self.rank(cells.clone(), zeros + rank),
        };
        let (low, high) = (f64::from(at(below)), f64::from(at((below + 1).min(last))));
        // As numpy has it: from the nearer end.
        if fraction >= 0.5 { high - (high - low) * (1.0 - fraction) } else { low + (high - low) * fraction }
    }

    /// The count that has `rank` counts before it in order: digit by digit, the highest first.
    fn rank(&self, cells: Range<usize>, rank: u64) -> u32 {
        let (mut prefix, mut rank) = (0u64, rank);
        for place in (0..DIGITS).rev() {
            let mut histogram = Histogram([0; 256]);
            for count in cells.clone().map(|at| u64::from(self.count(at))) {
                if count >> (8 * (place + 1)) == prefix {
                    histogram.add((count >> (8 * place)) as u8);
                }
            }
            let (digit, before) = histogram.rank(rank);
            (prefix, rank) = (prefix << 8 | u64::from(digit), rank - before);
        }
        prefix as u32
    }
}

/// How often each digit is there.
struct Histogram([u32; 256]);

impl Histogram {
    /// Most bytes are 0: eight at once are skipped.
    fn of(digits: &[u8]) -> Self {
        let (mut odd, mut even) = (Self([0; 256]), Self([0; 256]));
        let (words, rest) = digits.as_chunks::<8>();
        let mut empty = 0;
        for word in words {
            if u64::from_ne_bytes(*word) == 0 {
                empty += 8;
                continue;
            }
            for [a, b] in word.as_chunks::<2>().0 {
                odd.add(*a);
                even.add(*b);
            }
        }
        rest.iter().for_each(|digit| odd.add(*digit));
        odd.0.iter_mut().zip(even.0).for_each(|(sum, more)| *sum += more);
        odd.0[0] += empty;
        odd
    }

    fn add(&mut self, digit: u8) {
        let entry = &mut self.0[usize::from(digit)];
        *entry = entry.wrapping_add(1);
    }

    /// The digit that has `rank` digits before it in order, and how many are less than it.
    fn rank(&self, rank: u64) -> (u32, u64) {
        let mut before = 0;
        for (digit, count) in (0u32..).zip(self.0) {
            if before + u64::from(count) > rank {
                return (digit, before);
            }
            before += u64::from(count);
        }
        (u8::MAX.into(), before)
    }
}

/// Counts in the lowest digits, and carries.
struct Counting<'a> {
    higher: &'a mut [u8],
    stride: usize,
    carried: bool,
    saturated: u64,
}

impl Counting<'_> {
    /// The lowest digit of the element went over: how many it had is back in it only when all digits are full.
    #[cold]
    #[inline(never)]
    fn carry(&mut self, lowest: &mut u8, at: usize) {
        self.carried = true;
        let places = (0..DIGITS - 1).map(|place| place * self.stride + at);
        for place in places.clone() {
            let Some(digit) = self.higher.get_mut(place) else { return };
            let (more, full) = digit.overflowing_add(1);
            *digit = more;
            if !full {
                return;
            }
        }
        for place in places {
            if let Some(digit) = self.higher.get_mut(place) {
                *digit = u8::MAX;
            }
        }
        *lowest = u8::MAX;
        self.saturated += 1;
    }
}

impl Draw for Counting<'_> {
    type Pixel = u8;
    type Value = ();

    #[inline(always)]
    fn prepare(&self, _: Event, _: &mut u32) {}

    #[inline(always)]
    fn draw(&mut self, out: &mut [u8], at: usize, (): ()) {
        if let Some(digit) = out.get_mut(at) {
            let (more, full) = digit.overflowing_add(1);
            *digit = more;
            if full {
                self.carry(digit, at);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polarity;

    const GEOMETRY: Geometry = Geometry::new(5, 3);

    fn counted(counts: &[usize]) -> Digits<Vec<u32>> {
        let state = vec![0xA5A5_A5A5; Digits::<Vec<u32>>::state_len(GEOMETRY)];
        let mut digits = Digits::try_new(GEOMETRY, state).unwrap();
        digits.clear();
        for (at, count) in counts.iter().enumerate() {
            let polarity = Polarity::from_bit(u16::from(at < GEOMETRY.pixels()));
            let (x, y) = (at % GEOMETRY.pixels() % 5, at % GEOMETRY.pixels() / 5);
            digits.accumulate(&vec![Event::new(0, x as u16, y as u16, polarity); *count]);
        }
        digits
    }

    /// numpy's definition over the sorted counts.
    fn percentile(counts: &[usize], percent: u8) -> f64 {
        let mut counts: Vec<_> = counts.iter().filter(|count| **count > 0).collect();
        counts.sort_unstable();
        let Some(last) = counts.len().checked_sub(1) else { return 1.0 };
        let position = last as f64 * f64::from(percent) / 100.0;
        let (low, high) = (*counts[position.floor() as usize], *counts[position.ceil() as usize]);
        low as f64 + (high - low) as f64 * position.fract()
    }

    #[test]
    fn counts_of_any_size_and_their_percentiles() {
        for largest in [0, 1, 5, 255, 256, 257, 70_000] {
            let counts: Vec<usize> = (0..30).map(|i| i * i * 7919 % (largest + 1)).collect();
            let mut digits = counted(&counts);
            let found: Vec<_> = (0..30).map(|at| digits.count(at) as usize).collect();
            assert_eq!(found, counts);
            assert_eq!(digits.max() as usize, *counts.iter().max().unwrap());
            let mut mapped = [0; 28];
            digits.map(2, &mut mapped, |count| count * 3);
            assert!(mapped.iter().zip(&counts[2..]).all(|(found, count)| *found as usize == count * 3));
            for percent in [0, 1, 50, 75, 99, 100] {
                for cells in [0..30, 0..15, 15..30] {
                    let expected = percentile(&counts[cells.clone()], percent);
                    let found = digits.percentile(cells, percent);
                    assert!((found - expected).abs() < 1e-9 * expected, "{found} {expected}");
                }
            }
            digits.clear();
            assert!(digits.state.iter().all(|word| *word == 0) && digits.percentile(0..30, 50) == 1.0);
        }
    }

    #[test]
    fn the_greatest_count_stays() {
        let mut digits = counted(&[3]);
        digits.state.fill(u32::MAX);
        digits.accumulate(&[Event::new(0, 1, 1, Polarity::On); 2]);
        assert_eq!((digits.count(6), digits.count(0), digits.saturated()), (u32::MAX, u32::MAX, 2));
    }
}
