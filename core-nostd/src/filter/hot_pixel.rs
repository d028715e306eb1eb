//! Hot pixels: pixels that fire without light changing. A [`HotPixelLearner`] counts and gives a mask; the
//! [`HotPixelFilter`] drops the events of a mask's pixels.
//!
//! Rule of the learner: a pixel is hot if `count > mean + n sigma`, mean and (population) standard deviation taken
//! once over the pixels that fired at all. Its weakness: hot pixels raise the bar that they are measured by. A single
//! outlier among N active pixels lies at most (N - 1) / sqrt(N) sigma above the mean, so with n = 3 none is found
//! among 10 pixels or fewer, and many hot pixels hide each other. So learn over a whole quiet scene, and where that
//! is not enough, learn again behind the filter that applies the first mask.

use super::{FilterError, MaskKeep, PixelMask, cleared};
use crate::representation::index::{Places, change_each};
use crate::vector::widest;
use crate::{Block, Event, Filter, Geometry, Span, WrongGeometry};

/// Drops the events of a mask's pixels.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{HotPixelFilter, PixelMask}};
/// let geometry = Geometry::new(640, 480);
/// let mut mask = PixelMask::empty(geometry, vec![0u32; PixelMask::<()>::required_len(geometry)])?;
/// mask.insert(3, 4);
/// let mut filter = HotPixelFilter::new(mask);
/// assert!(!filter.keep(Event::new(0, 3, 4, Polarity::On)));
/// assert!(filter.keep(Event::new(0, 4, 3, Polarity::On)));
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct HotPixelFilter<S> {
    mask: PixelMask<S>,
}

impl<S: AsRef<[u32]>> HotPixelFilter<S> {
    /// A filter that drops the events of these pixels.
    pub const fn new(mask: PixelMask<S>) -> Self {
        Self { mask }
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> HotPixelFilter<S> {
    /// From now on the pixel is hot; false, and nothing is done, off the sensor.
    pub fn mask(&mut self, x: u16, y: u16) -> bool {
        self.mask.insert(x, y)
    }
}

impl<S: AsRef<[u32]>> Filter for HotPixelFilter<S> {
    #[inline]
    fn keep(&mut self, event: Event) -> bool {
        self.mask.spares(event)
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        self.mask.geometry().check(block.geometry)?;
        let kept = self.mask.thin(block.events_mut(), MaskKeep::Outside);
        block.truncate(kept);
        Ok(kept)
    }
}

/// Counts each pixel's events, and tells from them which are hot.
///
/// ```
/// use lobula_core::{Event, Geometry, Polarity, Span};
/// use lobula_core::filter::{HotPixelLearner, PixelMask};
/// let geometry = Geometry::new(5, 4);
/// let mut learner = HotPixelLearner::try_new(geometry, vec![0u32; HotPixelLearner::<()>::required_len(geometry)])?;
/// let quiet = (0..20).map(|i| Event::new(i, i as u16 % 5, i as u16 / 5, Polarity::On));
/// let hot = (20..60).map(|i| Event::new(i, 2, 3, Polarity::On));
/// let events: Vec<Event> = quiet.chain(hot).collect();
/// learner.learn(Span { t_first: 0, t_last: 59, geometry, events: &events })?;
/// let mask = learner.mask(3.0, vec![0u32; PixelMask::<()>::required_len(geometry)])?;
/// assert_eq!(mask.iter().collect::<Vec<_>>(), [(2, 3)]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct HotPixelLearner<S> {
    geometry: Geometry,
    counts: S,
}

impl<S> HotPixelLearner<S> {
    /// Counters of memory it needs.
    pub const fn required_len(geometry: Geometry) -> usize {
        geometry.pixels()
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> HotPixelLearner<S> {
    /// A learner that has seen nothing, in `memory` of at least [`required_len`](Self::required_len) counters.
    pub fn try_new(geometry: Geometry, mut memory: S) -> Result<Self, FilterError> {
        cleared(memory.as_mut(), Self::required_len(geometry))?;
        Ok(Self { geometry, counts: memory })
    }

    /// Counts the events.
    pub fn learn(&mut self, span: Span<'_>) -> Result<(), WrongGeometry> {
        self.geometry.check(span.geometry)?;
        let (places, counts) = (Places::by_pixel(self.geometry), self.counts.as_mut());
        change_each(places, span.events, counts, |count, _| *count = count.saturating_add(1));
        Ok(())
    }

    /// Events counted of each pixel, row by row.
    pub fn counts(&self) -> &[u32] {
        self.counts.as_ref().get(..Self::required_len(self.geometry)).unwrap_or_default()
    }

    /// The pixels counted more than `sigmas` standard deviations above the mean, as a mask in `words`.
    pub fn mask<M: AsRef<[u32]> + AsMut<[u32]>>(
        &self,
        sigmas: f32,
        words: M,
    ) -> Result<PixelMask<M>, FilterError> {
        let mut mask = PixelMask::empty(self.geometry, words)?;
        let count_max = self.count_max(sigmas)?;
        let counts = self.counts();
        widest(
            #[inline(always)]
            || mask.fill(counts.chunks(32).map(|counts| bits(counts, |count| count > count_max))),
        );
        Ok(mask)
    }

    /// The largest count that is not hot.
    ///
    /// With N active pixels and the sums S of counts and Q of their squares, `count > S/N + n sqrt(Q/N - (S/N)^2)`
    /// is `(N count - S)^2 > n^2 (N Q - S^2)` above the mean: no division, no square root.
    fn count_max(&self, sigmas: f32) -> Result<u32, FilterError> {
        if !(0.0..f32::MAX).contains(&sigmas) {
            return Err(FilterError::SigmasOutOfRange);
        }
        let counts = self.counts();
        let (active, sum, squares) = widest(
            #[inline(always)]
            || sums(counts),
        );
        let spread =
            (active as u128).wrapping_mul(squares).wrapping_sub((sum as u128).wrapping_mul(sum as u128));
        let bar = spread as f64 * (sigmas as f64 * sigmas as f64);
        let is_hot = |count: u32| {
            let above = (active as u128).wrapping_mul(count as u128).saturating_sub(sum as u128) as f64;
            above * above > bar
        };
        Ok(largest_where_not(is_hot))
    }
}

/// How many counts are above 0, their sum and that of their squares. A sensor's pixels number less than 2^31.
#[inline(always)]
fn sums(counts: &[u32]) -> (u64, u64, u128) {
    let (mut active, mut sum, mut low, mut high) = (0u64, 0u64, 0u64, 0u64);
    for count in counts {
        let (count, square) = (u64::from(*count), u64::from(*count).wrapping_mul(u64::from(*count)));
        active = active.wrapping_add((count > 0) as u64);
        sum = sum.wrapping_add(count);
        // In halves, which vectors add.
        low = low.wrapping_add(square & 0xFFFF_FFFF);
        high = high.wrapping_add(square >> 32);
    }
    (active, sum, (u128::from(high) << 32).wrapping_add(u128::from(low)))
}

/// A bit for each of at most 32 counts.
#[inline(always)]
fn bits(counts: &[u32], is: impl Fn(u32) -> bool) -> u32 {
    match counts.first_chunk::<32>() {
        Some(counts) => counts.iter().enumerate().fold(0, |bits, (i, count)| bits | (is(*count) as u32) << i),
        None => counts.iter().rev().fold(0, |bits, count| bits << 1 | is(*count) as u32),
    }
}

/// The largest number of which `is` is false, where it is false up to some number and true beyond; the largest of all
/// where it is never true.
fn largest_where_not(is: impl Fn(u32) -> bool) -> u32 {
    let (mut low, mut high) = (0, u32::MAX);
    while low < high {
        let middle = high - (high - low) / 2;
        (low, high) = if is(middle) { (low, middle - 1) } else { (middle, high) };
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and deviation as one would write them.
    fn naive(counts: &[u32], sigmas: f32) -> Vec<bool> {
        let active: Vec<f64> = counts.iter().filter(|count| **count > 0).map(|count| *count as f64).collect();
        let mean = active.iter().sum::<f64>() / active.len().max(1) as f64;
        let variance =
            active.iter().map(|count| (count - mean).powi(2)).sum::<f64>() / active.len().max(1) as f64;
        counts.iter().map(|count| *count as f64 > mean + sigmas as f64 * variance.sqrt()).collect()
    }

    fn check(counts: &[u32], sigmas: f32) {
        let geometry = Geometry::new(counts.len() as u16, 1);
        let learner = HotPixelLearner { geometry, counts: counts.to_vec() };
        let mask = learner.mask(sigmas, vec![!0; counts.len().div_ceil(32)]).unwrap();
        let found: Vec<bool> = (0..counts.len()).map(|x| mask.contains(x as u16, 0)).collect();
        assert_eq!(found, naive(counts, sigmas), "{counts:?} {sigmas}");
    }

    #[test]
    fn agrees_with_the_textbook() {
        check(&[0; 40], 3.0);
        check(&[5; 40], 0.0);
        check(&[1, 0, 2, 1, 0, 900, 2, 3, 1, 1, 1, 1, 1, 1, 1, 1], 3.0);
        check(&[1, 1, 1, 1, 1, 1, 1, 1, 1, 1_000_000], 3.0); // of ten pixels none can be hot
        check(&[u32::MAX, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1], 2.5);
        let mut state = 1u32;
        for n in 1..200 {
            let mut random = || {
                state = state.wrapping_mul(1664525).wrapping_add(1013904223);
                state >> 8
            };
            let counts: Vec<u32> =
                (0..n).map(|_| if random() % 9 == 0 { random() % 997 } else { random() % 5 }).collect();
            check(&counts, (random() % 40) as f32 / 10.0);
        }
    }

    #[test]
    fn refuses_a_bar_that_is_none() {
        let learner = HotPixelLearner { geometry: Geometry::new(1, 1), counts: [1] };
        for sigmas in [-1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(learner.mask(sigmas, [0]).err(), Some(FilterError::SigmasOutOfRange));
        }
    }
}
