//! Refractory period: after a pixel fired, its events are dropped for a while.
//!
//! Rule: keep an event if `t - last >= dt`, with `last` the time of the pixel's last kept event ([`Refresh::Kept`],
//! as in the pixel's own circuit) or of its last event, dropped ones included ([`Refresh::All`]: the pixel must be
//! silent for `dt`). Both polarities share `last`. Where time stepped back, `t - last` is negative and the event is
//! dropped.

use super::{FilterError, Refresh};
use crate::time_map::{Pixels, Reach, Stamp, TimeMap};
use crate::{Block, Event, Filter, Geometry, WrongGeometry};

/// Parameters of [`Refractory`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct RefractoryParams {
    /// The period in µs; below 2^30 (`u32` map) or 2^14 ticks (`u16`), rounded down to ticks.
    pub dt_us: u32,
    /// Which events start it anew; by default those kept.
    #[cfg_attr(feature = "serde", serde(default))]
    pub refresh: Refresh,
    /// Ticks of 2^shift µs; 0 for a `u32` map.
    #[cfg_attr(feature = "serde", serde(default))]
    pub shift: u8,
}

/// Drops the events of a pixel within `dt` of its last.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{Refractory, RefractoryParams, Refresh}};
/// let geometry = Geometry::new(640, 480);
/// let memory = vec![0u32; Refractory::<u32, ()>::required_len(geometry)];
/// let params = RefractoryParams { dt_us: 1000, refresh: Refresh::Kept, shift: 0 };
/// let mut filter = Refractory::<u32, _>::try_new(geometry, params, memory)?;
/// let at = |t| Event::new(t, 3, 4, Polarity::On);
/// assert_eq!([0, 999, 1000, 1999].map(|t| filter.keep(at(t))), [true, false, true, false]);
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Refractory<T, S> {
    map: TimeMap<T, S>,
    dt: i32,
    refresh: Refresh,
}

impl<T, S> Refractory<T, S> {
    /// Entries of memory it needs.
    pub const fn required_len(geometry: Geometry) -> usize {
        TimeMap::<T, S>::required_len(geometry)
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Refractory<T, S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) entries.
    pub fn try_new(geometry: Geometry, params: RefractoryParams, memory: S) -> Result<Self, FilterError> {
        let map = TimeMap::try_new(geometry, params.shift, memory)?;
        Ok(Self { dt: map.ticks(params.dt_us)?, refresh: params.refresh, map })
    }
}

#[inline(always)]
fn rested<T: Stamp>(pixels: &Pixels<'_, T>, place: usize, now: T, dt: i32, refresh: Refresh) -> bool {
    let Some(pixel) = pixels.pixel(place) else { return false };
    let last = pixel.get();
    let keep = now.age(last) >= dt;
    pixel.set(if keep | matches!(refresh, Refresh::All) { now } else { last });
    keep
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Filter for Refractory<T, S> {
    fn advance(&mut self, now: u64) {
        self.map.advance(now);
    }

    fn keep(&mut self, event: Event) -> bool {
        let (dt, refresh) = (self.dt, self.refresh);
        self.map.keep(event, |pixels, place, _, now| rested(pixels, place, now, dt, refresh))
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        let dt = self.dt;
        match self.refresh {
            Refresh::Kept => self.map.retain(block, Reach::Pixel, |pixels, place, _, now| {
                rested(pixels, place, now, dt, Refresh::Kept)
            }),
            Refresh::All => self.map.retain(block, Reach::Pixel, |pixels, place, _, now| {
                rested(pixels, place, now, dt, Refresh::All)
            }),
        }
    }
}
