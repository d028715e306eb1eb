//! Background activity: drops events without a recent one beside them (Delbruck, "Frame-free dynamic digital
//! vision", 2008).
//!
//! Rule: keep an event if one of its 8 (or 4) neighbours, its own pixel excluded, fired at most `dt` ago, whatever
//! the polarities. Every event counts as a neighbour of later ones, the dropped included. Where time stepped back, a
//! neighbour's event of a later time counts as recent.

use super::{FilterError, Neighbours};
use crate::time_map::{Pixels, Reach, Stamp, TimeMap};
use crate::{Block, Event, Filter, Geometry, WrongGeometry};

/// Parameters of [`BackgroundActivity`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct BackgroundActivityParams {
    /// How long ago is recent, in µs; below 2^30 (`u32` map) or 2^14 ticks (`u16`), rounded down to ticks.
    pub dt_us: u32,
    /// Which pixels are neighbours; by default eight.
    #[cfg_attr(feature = "serde", serde(default))]
    pub neighbours: Neighbours,
    /// Ticks of 2^shift µs; 0 for a `u32` map.
    #[cfg_attr(feature = "serde", serde(default))]
    pub shift: u8,
}

/// Drops events that no neighbour supports.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity};
/// use lobula_core::filter::{BackgroundActivity, BackgroundActivityParams, Neighbours};
/// let geometry = Geometry::new(640, 480);
/// let memory = vec![0u32; BackgroundActivity::<u32, ()>::required_len(geometry)];
/// let params = BackgroundActivityParams { dt_us: 1000, neighbours: Neighbours::Eight, shift: 0 };
/// let mut filter = BackgroundActivity::<u32, _>::try_new(geometry, params, memory)?;
/// assert!(!filter.keep(Event::new(0, 3, 4, Polarity::On))); // alone
/// assert!(filter.keep(Event::new(1000, 4, 5, Polarity::Off))); // its neighbour fired 1000 µs ago
/// assert!(!filter.keep(Event::new(2001, 5, 5, Polarity::Off))); // 1001 µs ago
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct BackgroundActivity<T, S> {
    map: TimeMap<T, S>,
    dt: i32,
    neighbours: Neighbours,
}

impl<T, S> BackgroundActivity<T, S> {
    /// Entries of memory it needs.
    pub const fn required_len(geometry: Geometry) -> usize {
        TimeMap::<T, S>::required_len(geometry)
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> BackgroundActivity<T, S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) entries.
    pub fn try_new(
        geometry: Geometry,
        params: BackgroundActivityParams,
        memory: S,
    ) -> Result<Self, FilterError> {
        let map = TimeMap::try_new(geometry, params.shift, memory)?;
        Ok(Self { dt: map.ticks(params.dt_us)?, neighbours: params.neighbours, map })
    }
}

#[inline(always)]
fn supported<T: Stamp>(
    pixels: &Pixels<'_, T>,
    place: usize,
    now: T,
    dt: i32,
    neighbours: Neighbours,
) -> bool {
    let Some((pixel, [n, w, e, s, nw, ne, sw, se])) = pixels.neighbourhood(place) else { return false };
    pixel.set(now);
    let margin = |then| now.margin(dt, then);
    let cross = margin(n) & margin(w) & margin(e) & margin(s);
    let all = match neighbours {
        Neighbours::Four => cross,
        Neighbours::Eight => cross & margin(nw) & margin(ne) & margin(sw) & margin(se),
    };
    all >= 0
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Filter for BackgroundActivity<T, S> {
    fn advance(&mut self, now: u64) {
        self.map.advance(now);
    }

    fn keep(&mut self, event: Event) -> bool {
        let (dt, neighbours) = (self.dt, self.neighbours);
        self.map.keep(event, |pixels, place, _, now| supported(pixels, place, now, dt, neighbours))
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        let dt = self.dt;
        match self.neighbours {
            Neighbours::Four => self.map.retain(block, Reach::Neighbourhood, |pixels, place, _, now| {
                supported(pixels, place, now, dt, Neighbours::Four)
            }),
            Neighbours::Eight => self.map.retain(block, Reach::Neighbourhood, |pixels, place, _, now| {
                supported(pixels, place, now, dt, Neighbours::Eight)
            }),
        }
    }
}
