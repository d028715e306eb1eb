//! How long each pixel is silent between two events.

use crate::statistics::{BadStatistic, Intervals, PixelTimes};
use crate::{Geometry, Span, WrongGeometry};

/// Times from each event to the next at its pixel: a histogram for each pixel, besides [`Intervals`].
///
/// The bins are those of [`Intervals`]: bin 0 counts intervals of 0 µs, bin `k` those of `[2^(k - 1), 2^k)` µs; the last
/// bin counts all longer ones too. A count stops at 2^32 - 1.
///
/// ```
/// use lobula_core::statistics::{PixelIntervals, PixelTimes};
/// use lobula_core::{Event, Geometry, Polarity, Span};
/// let geometry = Geometry::new(2, 1);
/// let events = [10, 15, 25].map(|t| Event::new(t, 1, 0, Polarity::On));
/// let mut intervals = PixelIntervals::try_new(geometry, [PixelTimes::default(); 2], [0; 2 * 24])?;
/// intervals.push(Span { t_first: 10, t_last: 25, geometry, events: &events })?;
/// assert_eq!(intervals.histogram(1, 0)[3], 1); // 5 µs
/// assert_eq!(intervals.histogram(1, 0)[4], 1); // 10 µs
/// assert_eq!(intervals.histogram(0, 0), [0; 24]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct PixelIntervals<S, C> {
    intervals: Intervals<S>,
    counts: C,
    /// Bins of a pixel.
    bins: usize,
}

impl<S: AsRef<[PixelTimes]> + AsMut<[PixelTimes]>, C: AsRef<[u32]> + AsMut<[u32]>> PixelIntervals<S, C> {
    /// For a sensor of this size, state of [`Intervals::state_len`] elements, and for each pixel as many bins as `counts`
    /// holds, 1 at least. What they held is zeroed.
    pub fn try_new(geometry: Geometry, pixels: S, mut counts: C) -> Result<Self, BadStatistic> {
        let (intervals, found) = (Intervals::try_new(geometry, pixels)?, counts.as_ref().len());
        let bins = found.checked_div(geometry.pixels()).unwrap_or_default();
        if bins == 0 || bins * geometry.pixels() != found {
            return Err(BadStatistic::StateLen { expected: bins.max(1) * geometry.pixels(), found });
        }
        counts.as_mut().fill(0);
        Ok(Self { intervals, counts, bins })
    }

    /// Takes note of the events of a block.
    pub fn push(&mut self, span: Span<'_>) -> Result<(), WrongGeometry> {
        let (bins, counts) = (self.bins, self.counts.as_mut());
        self.intervals.push_each(span, |pixel, bin| {
            let at = pixel.wrapping_mul(bins).wrapping_add(bin.min(bins.wrapping_sub(1)));
            if let Some(count) = counts.get_mut(at) {
                *count = count.saturating_add(1);
            }
        })
    }

    /// A pixel's intervals by length, see the type; none off the sensor.
    pub fn histogram(&self, x: u16, y: u16) -> &[u32] {
        let geometry = self.intervals.geometry();
        let start = geometry.index(x, y).wrapping_mul(self.bins);
        let counts = self.counts.as_ref().get(start..).filter(|_| geometry.contains(x, y));
        counts.and_then(|counts| counts.get(..self.bins)).unwrap_or_default()
    }

    /// Every pixel's histogram: H x W x bins, row-major.
    pub fn counts(&self) -> &[u32] {
        self.counts.as_ref()
    }

    /// The intervals of all pixels together.
    pub const fn intervals(&self) -> &Intervals<S> {
        &self.intervals
    }
}
