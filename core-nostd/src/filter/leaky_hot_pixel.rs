//! Hot pixels found while events come: a leaky counter for each pixel.
//!
//! Rule. Each event adds 1 to its pixel's counter, up to 255; at each multiple of `period_us` of stream time every
//! counter loses `leak`, down to 0. An event is dropped if with it the counter is above `limit`. So a pixel that fires for
//! long more than `leak` times a period is hot until it has been quieter for a while, and a burst of up to `limit` events
//! passes. Dropped events count too.
//!
//! Nothing need be learned before, unlike with [`HotPixelLearner`](super::HotPixelLearner), at the cost of the first
//! `limit` events of each hot pixel and of a byte a pixel. A restart of the camera's clock empties the counters.

use super::periods::{Ended, Periods};
use super::{FilterError, cleared, in_range};
use crate::compact::compact_all;
use crate::{Block, Event, Filter, Geometry, WrongGeometry, full_time};
use core::num::NonZeroU64;

/// Parameters of [`LeakyHotPixel`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default)
)]
pub struct LeakyHotPixelParams {
    /// The counter above which a pixel is hot, 1 to 254. By default 100.
    pub limit: u8,
    /// What each counter loses a period, 1 at least. By default 20, with the default period 200 events a second.
    pub leak: u8,
    /// The period in µs, 1 to 2^30. By default 100000. All counters are visited at its end: a short one costs time.
    pub period_us: u32,
}

impl Default for LeakyHotPixelParams {
    fn default() -> Self {
        Self { limit: 100, leak: 20, period_us: 100_000 }
    }
}

/// Drops the events of pixels that fire too often for long.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{LeakyHotPixel, LeakyHotPixelParams}};
/// let geometry = Geometry::new(640, 480);
/// let memory = vec![0u8; LeakyHotPixel::<()>::required_len(geometry)];
/// let params = LeakyHotPixelParams { limit: 2, leak: 1, period_us: 1000 };
/// let mut filter = LeakyHotPixel::try_new(geometry, params, memory)?;
/// let mut keep = |t| filter.keep(Event::new(t, 3, 4, Polarity::On));
/// assert_eq!([0, 10, 20].map(|t| keep(t)), [true, true, false]);
/// assert!(!keep(1000)); // 3 - 1 + 1
/// assert!(keep(3000)); // 3 - 2 + 1
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct LeakyHotPixel<S> {
    geometry: Geometry,
    params: LeakyHotPixelParams,
    periods: Periods,
    counters: S,
}

impl<S> LeakyHotPixel<S> {
    /// Counters of memory it needs.
    pub const fn required_len(geometry: Geometry) -> usize {
        geometry.pixels()
    }
}

impl<S: AsRef<[u8]> + AsMut<[u8]>> LeakyHotPixel<S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) bytes.
    pub fn try_new(
        geometry: Geometry,
        params: LeakyHotPixelParams,
        mut memory: S,
    ) -> Result<Self, FilterError> {
        in_range("limit", params.limit as u32, (1, 254))?;
        in_range("leak", params.leak as u32, (1, 255))?;
        let period_us = in_range("period_us", params.period_us, (1, 1 << 30))?;
        cleared(memory.as_mut(), Self::required_len(geometry))?;
        let periods = Periods::new(NonZeroU64::new(period_us as u64).unwrap_or(NonZeroU64::MIN));
        Ok(Self { geometry, params, periods, counters: memory })
    }

    #[inline(always)]
    fn reach(&mut self, t: u64) {
        if let Some(ended) = self.periods.ended(t) {
            self.leak(ended);
        }
    }

    #[cold]
    fn leak(&mut self, ended: Ended) {
        let lost = match ended {
            Ended::Periods(n) => n.saturating_mul(self.params.leak as u64).min(u8::MAX as u64) as u8,
            Ended::All => u8::MAX,
        };
        for counter in self.counters.as_mut() {
            *counter = counter.saturating_sub(lost);
        }
    }

    #[inline(always)]
    fn is_quiet(&mut self, event: Event) -> bool {
        let index = self.geometry.index(event.x(), event.y());
        let Some(counter) = self.counters.as_mut().get_mut(index) else { return false };
        *counter = counter.saturating_add(1);
        *counter <= self.params.limit
    }
}

impl<S: AsRef<[u8]> + AsMut<[u8]>> Filter for LeakyHotPixel<S> {
    fn advance(&mut self, now: u64) {
        self.reach(now);
    }

    fn keep(&mut self, event: Event) -> bool {
        self.reach(self.periods.time(event));
        self.is_quiet(event)
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        self.geometry.check(block.geometry)?;
        let anchor = block.t_first;
        let kept = compact_all(block.events_mut(), |event| {
            self.reach(full_time(anchor, event.t()));
            self.is_quiet(event)
        });
        block.truncate(kept);
        Ok(kept)
    }
}
