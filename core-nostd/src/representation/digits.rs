//! How many events each element had, as digits to the base of 256, each digit in a plane of its own.
//!
//! Few pixels have more than 255 events in a window, so that nearly all the work is in one plane of bytes, a quarter of
//! what 32-bit counts take; and with few different counts there are, a table does for any function of them.

mod lines;

use core::ops::Range;

use crate::representation::index::{Places, change_each};
use crate::representation::pixel::uncount_each;
use crate::representation::{BadRepresentation, check};
use crate::vector::{in_order, widest};
use crate::{Geometry, Shape, Span, WrongGeometry};

/// Digits of a count.
const DIGITS: usize = 4;

/// Pixels whose counts, and what is made of them, fit into the nearest cache.
const RUN: usize = 4096;

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

    /// The extent of so many planes of the sensor.
    pub(super) const fn shape(&self, channels: usize) -> Shape {
        Shape { channels, height: self.geometry.height as usize, width: self.geometry.width as usize }
    }

    /// Numbers of all counts.
    pub(super) const fn all(&self) -> Range<usize> {
        0..2 * self.geometry.pixels()
    }

    /// Numbers of those of ON, and of OFF.
    pub(super) const fn by_polarity(&self) -> [Range<usize>; 2] {
        let pixels = self.geometry.pixels();
        [0..pixels, pixels..2 * pixels]
    }

    /// The first, second and third plane of a tensor.
    pub(super) fn planes<'a, T>(&self, out: &'a mut [T]) -> [&'a mut [T]; 3] {
        let pixels = self.geometry.pixels();
        let (first, rest) = out.split_at_mut(pixels.min(out.len()));
        let (second, third) = rest.split_at_mut(pixels.min(rest.len()));
        [first, second, third]
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

    pub(super) fn accumulate(&mut self, span: Span<'_>) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let stride = Self::state_len(self.geometry) / DIGITS * size_of::<u32>();
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(self.state.as_mut());
        let (lowest, higher) = bytes.split_at_mut_checked(stride).unwrap_or_default();
        let mut carrying = Carrying { higher, stride, carried: false, saturated: 0 };
        let places = Places::by_polarity(self.geometry);
        widest(
            #[inline(always)]
            || {
                change_each(places, span.events, lowest, |digit: &mut u8, at| {
                    let (more, full) = digit.overflowing_add(1);
                    *digit = more;
                    if full {
                        carrying.carry(digit, at);
                    }
                });
            },
        );
        self.carried |= carrying.carried;
        self.saturated += carrying.saturated;
        self.counted = true;
        Ok(())
    }

    /// Takes back what counting these events did; returns whether the counts are then those of the others. Where there
    /// is a digit but the lowest they are not, and all have to be cleared.
    pub(super) fn take_away(&mut self, span: Span<'_>) -> Result<bool, WrongGeometry> {
        check(self.geometry, &span)?;
        let digits: &mut [u8] = bytemuck::cast_slice_mut(self.state.as_mut());
        let lowest = digits.get_mut(..2 * self.geometry.pixels()).unwrap_or_default();
        Ok(!self.carried && uncount_each(Places::by_polarity(self.geometry), span.events, lowest))
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

    /// The pixel of a count.
    const fn pixel(&self, at: usize) -> usize {
        let pixels = self.geometry.pixels();
        if at < pixels { at } else { at - pixels }
    }

    /// Numbers of the counts that have more than one digit.
    fn large(&self) -> impl Iterator<Item = usize> {
        let (words, stride) = (self.state.as_ref(), Self::state_len(self.geometry) / DIGITS);
        let higher = |place: usize| words.get(place * stride..).unwrap_or_default().iter();
        let digits = higher(1).zip(higher(2)).zip(higher(3)).map(|((a, b), c)| a | b | c);
        let words = (0..if self.carried { stride } else { 0 }).zip(digits).filter(|(_, digits)| *digits != 0);
        words
            .flat_map(|(word, _)| (0..4).map(move |i| 4 * word + i))
            .filter(|at| self.count(*at) > u8::MAX.into())
    }

    /// Writes a function of each count from that of number `from` on.
    pub(super) fn map<T: Copy>(&self, from: usize, out: &mut [T], function: impl Fn(u32) -> T) {
        lines::look_up(self.lowest().get(from..).unwrap_or_default(), out, &table(&function));
        self.map_large(from, out, function);
    }

    /// The same for counts of more than one digit.
    fn map_large<T>(&self, from: usize, out: &mut [T], function: impl Fn(u32) -> T) {
        for at in self.large() {
            if let Some(out) = at.checked_sub(from).and_then(|at| out.get_mut(at)) {
                *out = function(self.count(at));
            }
        }
    }

    /// Writes a function of each pixel's ON events, which of two it is, without an event or with one, and the function
    /// of its OFF events. A few pixels after the other, so that their counts are fetched once.
    pub(super) fn map_planes(
        &self,
        [on, any, off]: [&mut [u8]; 3],
        [none, some]: [u8; 2],
        function: impl Fn(u32) -> u8,
    ) {
        let (pixels, table) = (self.geometry.pixels(), table(&function));
        let (ons, offs) = self.lowest().split_at_checked(pixels).unwrap_or_default();
        for from in (0..pixels).step_by(RUN) {
            let [ons, offs] = [ons, offs].map(|counts| counts.get(from..).unwrap_or_default());
            lines::look_up_bytes(ons, run(on, from), &table);
            lines::look_up_bytes(offs, run(off, from), &table);
            let any = run(any, from);
            in_order(
                #[inline(always)]
                || {
                    for (any, (on, off)) in any.iter_mut().zip(ons.iter().zip(offs)) {
                        // With an `if` the compiler chooses between two addresses, and does one byte at a time.
                        let has = u8::from(on | off != 0).wrapping_neg();
                        *any = none ^ has & (none ^ some);
                    }
                },
            );
        }
        self.map_large(0, on, &function);
        self.map_large(pixels, off, &function);
        for at in self.large() {
            if let Some(any) = any.get_mut(self.pixel(at)) {
                *any = some;
            }
        }
    }

    /// Compares each pixel's levels of ON and OFF events, which grow with the counts. `on` and `off` get the shade of their
    /// level where it is the greater one (that of ON at a tie) and 255 elsewhere, `greater` that of the greater level. A
    /// greater level has no greater shade.
    pub(super) fn map_greater(
        &self,
        [on, off]: [&mut [u8]; 2],
        greater: &mut [u8],
        levels: [impl Fn(u32) -> f32; 2],
        shade: impl Fn(f32) -> u8,
    ) {
        let (pixels, [on_level, off_level]) = (self.geometry.pixels(), &levels);
        let shades = [table(&|count| shade(on_level(count))), table(&|count| shade(off_level(count)))];
        // ON prevails over as many OFF events or fewer.
        let mut most = 0;
        let beaten = core::array::from_fn(|count| {
            while most < u8::MAX && off_level(u32::from(most) + 1) <= on_level(count as u32) {
                most += 1;
            }
            most
        });
        let (ons, offs) = self.lowest().split_at_checked(pixels).unwrap_or_default();
        for from in (0..pixels).step_by(RUN) {
            let [ons, offs] = [ons, offs].map(|counts| counts.get(from..).unwrap_or_default());
            let (on, off, greater) = (run(on, from), run(off, from), run(greater, from));
            lines::look_up_bytes(ons, on, &shades[0]);
            lines::look_up_bytes(offs, off, &shades[1]);
            lines::look_up_bytes(ons, greater, &beaten);
            in_order(
                #[inline(always)]
                || {
                    for (((on, off), greater), count) in on.iter_mut().zip(off).zip(greater).zip(offs) {
                        let is_on = u8::from(*count <= *greater).wrapping_neg();
                        (*on, *off) = (*on | !is_on, *off | is_on);
                        *greater = *on & *off;
                    }
                },
            );
        }
        for at in self.large().map(|at| self.pixel(at)) {
            let (on_level, off_level) = (on_level(self.count(at)), off_level(self.count(pixels + at)));
            let is_on = on_level >= off_level;
            let shade = shade(if is_on { on_level } else { off_level });
            let [on_shade, off_shade] = if is_on { [shade, u8::MAX] } else { [u8::MAX, shade] };
            for (plane, shade) in [(&mut *on, on_shade), (&mut *off, off_shade), (&mut *greater, shade)] {
                if let Some(out) = plane.get_mut(at) {
                    *out = shade;
                }
            }
        }
    }

    /// The greatest count.
    pub(super) fn max(&self) -> u32 {
        let lowest = self.lowest();
        let most = widest(
            #[inline(always)]
            || lowest.iter().fold(0, |most, digit| most.max(*digit)),
        );
        self.large().map(|at| self.count(at)).max().unwrap_or(most.into())
    }

    /// The percentile of the counts that are not 0 among those numbered by `cells`, linear between two as numpy's
    /// default is; 1 where there is none.
    pub(super) fn percentile(&self, cells: Range<usize>, percent: u8) -> f64 {
        let lowest = self.lowest().get(cells.clone()).unwrap_or_default();
        let (mut histogram, mut small) = (Histogram(lines::histogram(lowest)), cells.len() as u64);
        for at in self.large().filter(|at| cells.contains(at)) {
            histogram.remove(self.count(at) as u8);
            small -= 1;
        }
        let zeros = u64::from(histogram.0[0]);
        let Some(last) = (cells.len() as u64).saturating_sub(zeros).checked_sub(1) else { return 1.0 };
        let position = f64::from(percent) / 100.0 * last as f64;
        let (below, fraction) = (position as u64, position - position as u64 as f64);
        let at = |rank: u64| match zeros + rank {
            rank if rank < small => histogram.rank(rank).0,
            rank => self.rank(&cells, rank - small),
        };
        let (low, high) = (f64::from(at(below)), f64::from(at((below + 1).min(last))));
        // As numpy has it: from the nearer end.
        if fraction >= 0.5 { high - (high - low) * (1.0 - fraction) } else { low + (high - low) * fraction }
    }

    /// The count of more than one digit that has `rank` such before it in order: digit by digit, the highest first.
    fn rank(&self, cells: &Range<usize>, rank: u64) -> u32 {
        let (mut prefix, mut rank) = (0u64, rank);
        for place in (0..DIGITS).rev() {
            let mut histogram = Histogram([0; 256]);
            let large = self.large().filter(|at| cells.contains(at));
            for count in large.map(|at| u64::from(self.count(at))) {
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
    fn add(&mut self, digit: u8) {
        let entry = &mut self.0[usize::from(digit)];
        *entry = entry.wrapping_add(1);
    }

    fn remove(&mut self, digit: u8) {
        let entry = &mut self.0[usize::from(digit)];
        *entry = entry.wrapping_sub(1);
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

/// A plane's elements of the run that begins with number `from`, as far as there are any.
fn run(plane: &mut [u8], from: usize) -> &mut [u8] {
    let to = plane.len().min(from + RUN);
    plane.get_mut(from..to).unwrap_or_default()
}

/// A function of every count of one digit.
fn table<T>(function: &impl Fn(u32) -> T) -> [T; 256] {
    core::array::from_fn(|count| function(count as u32))
}

/// What becomes of a lowest digit that is full.
struct Carrying<'a> {
    higher: &'a mut [u8],
    stride: usize,
    carried: bool,
    saturated: u64,
}

impl Carrying<'_> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Event, Polarity};

    const GEOMETRY: Geometry = Geometry::new(5, 3);

    fn accumulate(digits: &mut Digits<Vec<u32>>, events: &[Event]) {
        digits.accumulate(Span { t_first: 0, t_last: 0, geometry: GEOMETRY, events }).unwrap();
    }

    fn counted(counts: &[usize]) -> Digits<Vec<u32>> {
        let state = vec![0xA5A5_A5A5; Digits::<Vec<u32>>::state_len(GEOMETRY)];
        let mut digits = Digits::try_new(GEOMETRY, state).unwrap();
        digits.clear();
        for (at, count) in counts.iter().enumerate() {
            let polarity = Polarity::from_bit(u16::from(at < GEOMETRY.pixels()));
            let (x, y) = (at % GEOMETRY.pixels() % 5, at % GEOMETRY.pixels() / 5);
            accumulate(&mut digits, &vec![Event::new(0, x as u16, y as u16, polarity); *count]);
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
    fn the_greater_level_prevails() {
        let counts: Vec<usize> = (0..30).map(|i| [0, 1, 2, 3, 15, 16, 255, 256, 300][i * 7 % 9]).collect();
        let digits = counted(&counts);
        for (on_full, off_full) in
            [(1.0, 1.0), (2.0, 3.0), (3.0, 3.0), (17.0, 2.5), (300.0, 256.0), (2.0, 400.0)]
        {
            let levels = [on_full, off_full].map(|full| move |count: u32| (count as f32).min(full) / full);
            let shade = |level: f32| ((1.0 - level) * 255.0) as u8;
            let [mut on, mut off, mut greater] = [[0xA5; 15]; 3];
            digits.map_greater([&mut on, &mut off], &mut greater, levels, shade);
            for pixel in 0..15 {
                let [is, is_not] = [levels[0](counts[pixel] as u32), levels[1](counts[pixel + 15] as u32)];
                let expected = if is >= is_not { [shade(is), 255] } else { [255, shade(is_not)] };
                let found = ([on[pixel], off[pixel]], greater[pixel]);
                assert_eq!(found, (expected, shade(is.max(is_not))), "{is} {is_not}");
            }
        }
    }

    #[test]
    fn the_greatest_count_stays() {
        let mut digits = counted(&[3]);
        digits.state.fill(u32::MAX);
        accumulate(&mut digits, &[Event::new(0, 1, 1, Polarity::On); 2]);
        assert_eq!((digits.count(6), digits.count(0), digits.saturated()), (u32::MAX, u32::MAX, 2));
    }
}
