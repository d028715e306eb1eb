//! Event trail filters, as in Prophesee's sensors: Trail and STC (spatio-temporal contrast), in their three modes.
//!
//! Rule. A burst is events of one pixel and one polarity, each less than `dt` after the one before; another polarity or
//! a longer pause begins a new one. Of each burst is kept
//!
//! - [`TrailMode::Trail`]: the first event;
//! - [`TrailMode::StcCutTrail`]: the second, so that lone events, which noise mostly is, go too;
//! - [`TrailMode::StcKeepTrail`]: all but the first.
//!
//! Every event counts as its pixel's last, the dropped included. Where time stepped back, an event of the same polarity
//! goes on with the burst. Source: Prophesee, "Event Signal Processing" (docs.prophesee.ai, hardware manuals).

use super::FilterError;
use super::burst::{Bursts, Place};
use crate::time_map::Stamp;
use crate::{Block, Event, Filter, Geometry, WrongGeometry};

/// What is kept of a burst.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum TrailMode {
    /// The first event.
    #[default]
    Trail,
    /// The second event.
    StcCutTrail,
    /// All events but the first.
    StcKeepTrail,
}

/// Parameters of [`Trail`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default)
)]
pub struct TrailParams {
    /// The pause that ends a burst, in µs; below 2^30 (`u32` map) or 2^14 ticks (`u16`), rounded down to ticks. By
    /// default 10000.
    pub dt_us: u32,
    /// What is kept of a burst; by default its first event.
    pub mode: TrailMode,
    /// Ticks of 2^shift µs; 0 for a `u32` map.
    pub shift: u8,
}

impl Default for TrailParams {
    fn default() -> Self {
        Self { dt_us: 10_000, mode: TrailMode::Trail, shift: 0 }
    }
}

/// Keeps one event of each burst, or all but one.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{Trail, TrailMode, TrailParams}};
/// let geometry = Geometry::new(640, 480);
/// let memory = vec![0u32; Trail::<u32, ()>::required_len(geometry)];
/// let params = TrailParams { dt_us: 1000, mode: TrailMode::StcCutTrail, shift: 0 };
/// let mut filter = Trail::<u32, _>::try_new(geometry, params, memory)?;
/// let mut keep = |t, polarity| filter.keep(Event::new(t, 3, 4, polarity));
/// assert_eq!([0, 999, 1998, 2998].map(|t| keep(t, Polarity::On)), [false, true, false, false]);
/// assert_eq!([3000, 3001].map(|t| keep(t, Polarity::Off)), [false, true]);
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Trail<T, S> {
    bursts: Bursts<T, S>,
    mode: TrailMode,
}

impl<T: Stamp, S> Trail<T, S> {
    /// Entries of memory it needs: a time map and two bits for each of its entries.
    pub const fn required_len(geometry: Geometry) -> usize {
        Bursts::<T, S>::required_len(geometry)
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Trail<T, S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) entries.
    pub fn try_new(geometry: Geometry, params: TrailParams, memory: S) -> Result<Self, FilterError> {
        let bursts = Bursts::try_new(geometry, (params.dt_us, false), params.shift, memory)?;
        Ok(Self { bursts, mode: params.mode })
    }
}

impl TrailMode {
    #[inline(always)]
    fn keeps(self, place: Place) -> bool {
        match self {
            Self::Trail => place == Place::First,
            Self::StcCutTrail => place == Place::Second,
            Self::StcKeepTrail => place != Place::First,
        }
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Filter for Trail<T, S> {
    fn advance(&mut self, now: u64) {
        self.bursts.advance(now);
    }

    fn keep(&mut self, event: Event) -> bool {
        let mode = self.mode;
        self.bursts.keep(event, |place| mode.keeps(place))
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        let mode = self.mode;
        self.bursts.retain(block, |place| mode.keeps(place))
    }
}
