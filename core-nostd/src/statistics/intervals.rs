//! How often each pixel fires, and how long it is silent in between.

use bytemuck::{Pod, Zeroable};

use crate::statistics::BadStatistic;
use crate::{Geometry, Span, WrongGeometry};

/// When a pixel fired, of either polarity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct PixelTimes {
    /// Time of its first event in the stream, in µs.
    pub first: u64,
    /// Time of its last event in the stream, in µs.
    pub last: u64,
    /// Its events.
    pub events: u64,
}

impl PixelTimes {
    /// Mean time from one event to the next in µs; none for fewer than two events, or where the clock restarted.
    pub fn mean_interval_us(self) -> Option<f64> {
        let intervals = self.events.checked_sub(1).filter(|intervals| *intervals > 0)?;
        let span = self.last.checked_sub(self.first)?;
        Some(span as f64 / intervals as f64)
    }

    /// Events a second, where the pixel was looked at for so many µs; 0 for none.
    pub fn per_second(self, us: u64) -> f64 {
        if us == 0 { 0.0 } else { self.events as f64 / (us as f64 / 1e6) }
    }
}

/// Times from each event to the next at its pixel: a histogram over all pixels, and each pixel's own figures.
///
/// Bin 0 counts intervals of 0 µs, bin `k` those of `[2^(k - 1), 2^k)` µs. A step back in time is no interval: it is in
/// [`backward`](Self::backward).
///
/// ```
/// use lobula_core::statistics::{Intervals, PixelTimes};
/// use lobula_core::{Event, Geometry, Polarity, Span};
/// let geometry = Geometry::new(2, 1);
/// let events = [10, 15, 25].map(|t| Event::new(t, 1, 0, Polarity::On));
/// let mut intervals = Intervals::try_new(geometry, [PixelTimes::default(); 2])?;
/// intervals.push(Span { t_first: 10, t_last: 25, geometry, events: &events })?;
/// assert_eq!(intervals.histogram()[3], 1); // 5 µs
/// assert_eq!(intervals.histogram()[4], 1); // 10 µs
/// assert_eq!(intervals.pixels()[1].mean_interval_us(), Some(7.5));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Intervals<S> {
    geometry: Geometry,
    pixels: S,
    histogram: [u64; BINS],
    backward: u64,
}

/// Enough for any difference of two times.
const BINS: usize = 65;

impl<S: AsRef<[PixelTimes]> + AsMut<[PixelTimes]>> Intervals<S> {
    /// Elements of the state.
    pub const fn state_len(geometry: Geometry) -> usize {
        geometry.pixels()
    }

    /// For a sensor of this size, and state of [`state_len`](Self::state_len) elements, whatever they hold.
    pub fn try_new(geometry: Geometry, mut pixels: S) -> Result<Self, BadStatistic> {
        let (expected, found) = (Self::state_len(geometry), pixels.as_ref().len());
        if expected != found {
            return Err(BadStatistic::StateLen { expected, found });
        }
        pixels.as_mut().fill(PixelTimes::default());
        Ok(Self { geometry, pixels, histogram: [0; BINS], backward: 0 })
    }

    /// Takes note of the events of a block.
    pub fn push(&mut self, span: Span<'_>) -> Result<(), WrongGeometry> {
        self.push_each(span, |_, _| {})
    }

    /// The same, and tells the pixel and the bin of each interval.
    pub(super) fn push_each(
        &mut self,
        span: Span<'_>,
        mut each: impl FnMut(usize, usize),
    ) -> Result<(), WrongGeometry> {
        self.geometry.check(span.geometry)?;
        for event in span.events {
            let (at, t) = (self.geometry.index(event.x(), event.y()), span.time(*event));
            let Some(pixel) = self.pixels.as_mut().get_mut(at) else { continue };
            let before = core::mem::replace(&mut pixel.last, t);
            pixel.events = pixel.events.wrapping_add(1);
            if pixel.events == 1 {
                pixel.first = t;
                continue;
            }
            let bin = t.checked_sub(before).map(|interval| (u64::BITS - interval.leading_zeros()) as usize);
            if let Some(bin) = bin {
                each(at, bin);
            }
            let count = bin.and_then(|bin| self.histogram.get_mut(bin)).unwrap_or(&mut self.backward);
            *count = count.wrapping_add(1);
        }
        Ok(())
    }

    /// The sensor's size.
    pub const fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// Intervals of all pixels by length, see the type.
    pub const fn histogram(&self) -> &[u64; BINS] {
        &self.histogram
    }

    /// Each pixel's times, row-major.
    pub fn pixels(&self) -> &[PixelTimes] {
        self.pixels.as_ref()
    }

    /// Steps back in time at a pixel.
    pub const fn backward(&self) -> u64 {
        self.backward
    }
}
