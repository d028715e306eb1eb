//! Rate limit: no more than so many events a period, shared fairly between tiles of the sensor.
//!
//! Rule. Stream time is cut into periods of `period_us`, from multiples of it. In each at most `events` events are kept,
//! and of each tile at most its quota: the largest number `q` with `sum(min(n, q)) <= events` over the numbers `n` of
//! events that came in the tiles in the period before, 1 at least; `events` itself after a period that needed no limit, a
//! silent one or a restart of the camera's clock. So a flickering lamp in one corner takes nothing from the rest. An event
//! that steps back over the period's start counts in the open one.

use super::periods::{Ended, Periods};
use super::tiles::Tiles;
use super::{FilterError, cleared, in_range};
use crate::compact::compact_all;
use crate::{Block, Event, Filter, Geometry, WrongGeometry, full_time};
use core::num::NonZeroU64;

/// Parameters of [`RateLimit`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct RateLimitParams {
    /// The most events that are kept in a period, 1 at least.
    pub events: u32,
    /// The period in µs, 1 to 2^30. By default 1000.
    #[cfg_attr(feature = "serde", serde(default = "period_us"))]
    pub period_us: u32,
    /// Tiles are squares of 2^shift pixels, 0 to 15. By default 5.
    #[cfg_attr(feature = "serde", serde(default = "tile_shift"))]
    pub tile_shift: u8,
}

#[cfg(feature = "serde")]
const fn period_us() -> u32 {
    1000
}

#[cfg(feature = "serde")]
const fn tile_shift() -> u8 {
    5
}

/// Keeps at most so many events a period, of all parts of the sensor.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{RateLimit, RateLimitParams}};
/// let geometry = Geometry::new(64, 32);
/// let params = RateLimitParams { events: 4, period_us: 1000, tile_shift: 5 };
/// let memory = vec![0u32; RateLimit::<()>::required_len(geometry, 5)];
/// let mut filter = RateLimit::try_new(geometry, params, memory)?;
/// let mut kept = |t, x, n| (0..n).filter(|_| filter.keep(Event::new(t, x, 0, Polarity::On))).count();
/// assert_eq!((kept(0, 0, 9), kept(500, 32, 2)), (4, 0)); // the budget is spent by the left tile
/// assert_eq!((kept(1000, 0, 9), kept(1500, 32, 2)), (2, 2)); // and now shared
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct RateLimit<S> {
    geometry: Geometry,
    tiles: Tiles,
    periods: Periods,
    events_max: u32,
    quota: u32,
    /// Events kept in this period.
    kept: u32,
    /// Events that came in this period, by tile.
    counts: S,
}

impl<S> RateLimit<S> {
    /// Words of memory it needs: one for each tile of 2^`tile_shift` pixels a side.
    pub const fn required_len(geometry: Geometry, tile_shift: u8) -> usize {
        Tiles::count(geometry, tile_shift)
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> RateLimit<S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) words.
    pub fn try_new(geometry: Geometry, params: RateLimitParams, mut memory: S) -> Result<Self, FilterError> {
        let events_max = in_range("events", params.events, (1, u32::MAX))?;
        let period_us = in_range("period_us", params.period_us, (1, 1 << 30))?;
        let tiles = Tiles::try_new(geometry, params.tile_shift)?;
        cleared(memory.as_mut(), Self::required_len(geometry, params.tile_shift))?;
        let periods = Periods::new(NonZeroU64::new(period_us as u64).unwrap_or(NonZeroU64::MIN));
        Ok(Self { geometry, tiles, periods, events_max, quota: events_max, kept: 0, counts: memory })
    }

    #[inline(always)]
    fn reach(&mut self, t: u64) {
        if let Some(ended) = self.periods.ended(t) {
            self.share(ended);
        }
    }

    #[cold]
    fn share(&mut self, ended: Ended) {
        let counts = self.counts.as_mut();
        self.quota = match ended {
            Ended::Periods(1) => quota(counts, self.events_max).max(1),
            _ => self.events_max,
        };
        self.kept = 0;
        counts.fill(0);
    }

    #[inline(always)]
    fn is_within(&mut self, event: Event) -> bool {
        let Some(count) = self.counts.as_mut().get_mut(self.tiles.of(event)) else { return false };
        let keep = (*count < self.quota) & (self.kept < self.events_max);
        *count = count.saturating_add(1);
        self.kept = self.kept.wrapping_add(keep as u32);
        keep
    }
}

/// The largest quota up to `events_max` with which tiles of these counts give no more than `events_max` together.
fn quota(counts: &[u32], events_max: u32) -> u32 {
    let fits =
        |quota: u32| counts.iter().map(|count| (*count).min(quota) as u64).sum::<u64>() <= events_max as u64;
    let (mut low, mut high) = (0, events_max);
    if fits(high) {
        return high;
    }
    while low < high {
        let middle = high - (high - low) / 2;
        (low, high) = if fits(middle) { (middle, high) } else { (low, middle - 1) };
    }
    low
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Filter for RateLimit<S> {
    fn advance(&mut self, now: u64) {
        self.reach(now);
    }

    fn keep(&mut self, event: Event) -> bool {
        self.reach(self.periods.time(event));
        self.is_within(event)
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        self.geometry.check(block.geometry)?;
        let anchor = block.t_first;
        let kept = compact_all(block.events_mut(), |event| {
            self.reach(full_time(anchor, event.t()));
            self.is_within(event)
        });
        block.truncate(kept);
        Ok(kept)
    }
}
