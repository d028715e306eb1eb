//! Spatiotemporal correlation filter (STCF): drops events that too few neighbours support (Guo and Delbruck, "Low Cost
//! and Latency Event Camera Background Activity Denoising", TPAMI 2022).
//!
//! Rule: keep an event if of its 8 neighbours, its own pixel excluded, at least `support` have a last event that is at
//! most `dt` ago and, with [`PolarityMatch::Same`], of the event's polarity. Every event is its pixel's last, the dropped
//! included. Where time stepped back, a neighbour's event of a later time counts as recent.
//!
//! With `support` of 1 and either polarity it is [background activity](super::BackgroundActivity) with 8 neighbours.

use super::plane::{self, Plane};
use super::support::{PolarityMatch, recent, recent_alike};
use super::{FilterError, check_support, cleared};
use crate::time_map::{Pixels, Reach, Stamp, TimeMap};
use crate::{Block, Event, Filter, Geometry, WrongGeometry};

/// Parameters of [`Stcf`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default)
)]
pub struct StcfParams {
    /// How long ago is recent, in µs; below 2^30 (`u32` map) or 2^14 ticks (`u16`), rounded down to ticks. By default
    /// 10000.
    pub dt_us: u32,
    /// How many neighbours must support, 0 (none need) to 8. By default 2.
    pub support: u8,
    /// Which neighbours' events support; by default those of either polarity.
    pub polarity_match: PolarityMatch,
    /// Ticks of 2^shift µs; 0 for a `u32` map.
    pub shift: u8,
}

impl Default for StcfParams {
    fn default() -> Self {
        Self { dt_us: 10_000, support: 2, polarity_match: PolarityMatch::Any, shift: 0 }
    }
}

/// Drops events that fewer than `support` neighbours support.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{Stcf, StcfParams}};
/// let geometry = Geometry::new(640, 480);
/// let memory = vec![0u16; Stcf::<u16, ()>::required_len(geometry)];
/// let params = StcfParams { dt_us: 8000, support: 2, shift: 3, ..StcfParams::default() };
/// let mut filter = Stcf::<u16, _>::try_new(geometry, params, memory)?;
/// let mut keep = |t, x, y| filter.keep(Event::new(t, x, y, Polarity::On));
/// assert!(!keep(0, 3, 3)); // alone
/// assert!(!keep(1000, 4, 3)); // one neighbour
/// assert!(keep(2000, 4, 4)); // two
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Stcf<T, S> {
    map: TimeMap<T, S>,
    dt: i32,
    support: u32,
    polarity_match: PolarityMatch,
}

impl<T: Stamp, S> Stcf<T, S> {
    /// Entries of memory it needs: a time map and a bit for each of its entries.
    pub const fn required_len(geometry: Geometry) -> usize {
        TimeMap::<T, S>::required_len(geometry).saturating_add(plane::words::<T>(geometry))
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Stcf<T, S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) entries.
    pub fn try_new(geometry: Geometry, params: StcfParams, mut memory: S) -> Result<Self, FilterError> {
        check_support(params.support)?;
        cleared(memory.as_mut(), Self::required_len(geometry))?;
        let map = TimeMap::try_new(geometry, params.shift, memory)?;
        let (dt, support) = (map.ticks(params.dt_us)?, params.support as u32);
        Ok(Self { map, dt, support, polarity_match: params.polarity_match })
    }
}

#[inline(always)]
fn supported<T: Stamp>(
    pixels: &Pixels<'_, T>,
    place: usize,
    now: T,
    (dt, least): (i32, u32),
) -> Option<bool> {
    let (pixel, neighbours) = pixels.neighbourhood(place)?;
    pixel.set(now);
    Some(recent(neighbours, now, dt) >= least)
}

#[inline(always)]
fn supported_alike<T: Stamp>(
    pixels: &Pixels<'_, T>,
    place: usize,
    event: Event,
    now: T,
    (dt, least): (i32, u32),
) -> Option<bool> {
    let (pixel, neighbours) = pixels.neighbourhood(place)?;
    let on = Plane::only(pixels);
    let support = recent_alike(neighbours, now, dt, on.around(place)? ^ !event.on_mask());
    pixel.set(now);
    on.bit(place)?.set(event.is_on());
    Some(support >= least)
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Filter for Stcf<T, S> {
    fn advance(&mut self, now: u64) {
        self.map.advance(now);
    }

    fn keep(&mut self, event: Event) -> bool {
        let rule = (self.dt, self.support);
        match self.polarity_match {
            PolarityMatch::Any => self
                .map
                .keep(event, |pixels, place, _, now| supported(pixels, place, now, rule).unwrap_or(false)),
            PolarityMatch::Same => self.map.keep(event, |pixels, place, event, now| {
                supported_alike(pixels, place, event, now, rule).unwrap_or(false)
            }),
        }
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        let rule = (self.dt, self.support);
        match self.polarity_match {
            PolarityMatch::Any => self.map.retain(block, Reach::Neighbourhood, |pixels, place, _, now| {
                supported(pixels, place, now, rule).unwrap_or(false)
            }),
            PolarityMatch::Same => {
                self.map.retain(block, Reach::Neighbourhood, |pixels, place, event, now| {
                    supported_alike(pixels, place, event, now, rule).unwrap_or(false)
                })
            }
        }
    }
}
