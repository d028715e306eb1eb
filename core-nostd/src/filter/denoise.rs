//! Denoising in one pass: hot pixels, refractory period, support by neighbours and trails, over one time map.
//!
//! Rule. An event at time `t` of a hot pixel is dropped and leaves no trace. Of any other, with `last` the time of its
//! pixel's last event and `n` the number of its 8 neighbours whose last event is at most `support_us` ago and, with
//! [`PolarityMatch::Same`], of the same polarity:
//!
//! - it is too soon if `t - last < refractory_us`;
//! - it is noise if `n < support` (1: background activity; 2 and more: the spatiotemporal correlation filter of Guo
//!   and Delbruck, "Low Cost and Latency Event Camera Background Activity Denoising", TPAMI 2022);
//! - it is a trail if `t - last < trail_us` and its pixel's last event had the same polarity;
//!
//! and it is kept if it is none of these. "Last events" are those of the stream but for hot pixels: kept or dropped.
//! This is not the same as single filters in a row, where each remembers only what the ones before it kept; it reads
//! each neighbourhood once.

use super::plane::{self, Plane};
use super::support::{PolarityMatch, recent, recent_alike};
use super::{FilterError, check_support, cleared};
use crate::time_map::{Pixels, Reach, Stamp, TimeMap};
use crate::vector::SMALL_CORE;
use crate::{Block, Event, Filter, Geometry, Polarity, WrongGeometry};

/// Parameters of [`Denoise`]. Times in µs are below 2^30 (`u32` map) or 2^14 ticks (`u16`), rounded down to ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DenoiseParams {
    /// Least time between events of a pixel, in µs; 0: any. By default 200.
    pub refractory_us: u32,
    /// How long ago a neighbour's event still supports, in µs. By default 20000.
    pub support_us: u32,
    /// How many of the 8 neighbours must support, 0 (none need) to 8. By default 2.
    pub support: u8,
    /// Which neighbours' events support; by default those of either polarity.
    pub polarity_match: PolarityMatch,
    /// How long an event of a pixel is followed by a trail of the same polarity, in µs; 0 (the default): none.
    pub trail_us: u32,
    /// Ticks of 2^shift µs; 0 for a `u32` map.
    pub shift: u8,
}

impl Default for DenoiseParams {
    fn default() -> Self {
        let polarity_match = PolarityMatch::Any;
        Self { refractory_us: 200, support_us: 20_000, support: 2, polarity_match, trail_us: 0, shift: 0 }
    }
}

/// Drops hot pixels, events that come too soon, noise, and trails, in one pass.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{Denoise, DenoiseParams}};
/// let geometry = Geometry::new(640, 480);
/// let memory = vec![0u32; Denoise::<u32, ()>::required_len(geometry)];
/// let params = DenoiseParams { support: 1, ..DenoiseParams::default() };
/// let mut denoise = Denoise::<u32, _>::try_new(geometry, params, memory)?;
/// denoise.mask(5, 5);
/// let mut keep = |t, x, y| denoise.keep(Event::new(t, x, y, Polarity::On));
/// assert!(!keep(0, 3, 3)); // alone
/// assert!(keep(100, 4, 4)); // supported
/// assert!(!keep(250, 4, 4)); // too soon
/// assert!(!keep(300, 5, 5)); // hot
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Denoise<T, S> {
    map: TimeMap<T, S>,
    rules: Rules,
}

/// The age that every event has reached: the period of a rule that is off.
const OFF: i32 = i32::MIN;

/// The parameters in ticks.
#[derive(Clone, Copy, Debug)]
struct Rules {
    refractory: i32,
    support_dt: i32,
    support: u32,
    polarity_match: PolarityMatch,
    trail: i32,
}

impl<T: Stamp, S> Denoise<T, S> {
    /// Entries of memory it needs: a time map and two bits for each of its entries.
    pub const fn required_len(geometry: Geometry) -> usize {
        TimeMap::<T, S>::required_len(geometry).saturating_add(2 * plane::words::<T>(geometry))
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Denoise<T, S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) entries. No
    /// pixel is hot until [`mask`](Self::mask) says so.
    pub fn try_new(geometry: Geometry, params: DenoiseParams, mut memory: S) -> Result<Self, FilterError> {
        check_support(params.support)?;
        cleared(memory.as_mut(), Self::required_len(geometry))?;
        let map = TimeMap::try_new(geometry, params.shift, memory)?;
        let period = |dt_us| if dt_us == 0 { Ok(OFF) } else { map.ticks(dt_us) };
        let rules = Rules {
            refractory: period(params.refractory_us)?,
            support_dt: map.ticks(params.support_us)?,
            support: params.support as u32,
            polarity_match: params.polarity_match,
            trail: period(params.trail_us)?,
        };
        Ok(Self { map, rules })
    }

    /// From now on the pixel is hot; false, and nothing is done, off the sensor.
    pub fn mask(&mut self, x: u16, y: u16) -> bool {
        let on_sensor = self.map.geometry().contains(x, y);
        let Some(pixels) = self.map.pixels() else { return false };
        let [hot, _] = Plane::two(&pixels);
        match hot.bit(pixels.place(Event::new(0, x, y, Polarity::Off)) as usize) {
            Some(bit) if on_sensor => bit.set(true),
            _ => return false,
        }
        true
    }
}

/// The rule for one event. `TRAILS`, `ALIKE`: whether polarities are looked at for either.
#[inline(always)]
fn is_signal<T: Stamp, const TRAILS: bool, const ALIKE: bool>(
    pixels: &Pixels<'_, T>,
    place: usize,
    event: Event,
    now: T,
    rules: Rules,
) -> Option<bool> {
    let [hot, on] = Plane::two(pixels);
    if hot.bit(place)?.get() {
        return None;
    }
    let (pixel, neighbours) = pixels.neighbourhood(place)?;
    // Where branches are cheap, it saves to count the neighbours of what is dropped anyway.
    if SMALL_CORE && !(TRAILS | ALIKE) && now.age(pixel.get()) < rules.refractory {
        pixel.set(now);
        return Some(false);
    }
    let support = if ALIKE {
        recent_alike(neighbours, now, rules.support_dt, on.around(place)? ^ !event.on_mask())
    } else {
        recent(neighbours, now, rules.support_dt)
    };
    let age = now.age(pixel.get());
    pixel.set(now);
    let mut signal = (age >= rules.refractory) & (support >= rules.support);
    if TRAILS | ALIKE {
        let last_on = on.bit(place)?;
        signal &= (age >= rules.trail) | (last_on.get() != event.is_on());
        last_on.set(event.is_on());
    }
    Some(signal)
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Denoise<T, S> {
    /// Compiled once for each answer to what of the polarities is looked at.
    #[inline(always)]
    fn thin<const TRAILS: bool, const ALIKE: bool>(
        &mut self,
        block: &mut Block<'_>,
    ) -> Result<usize, WrongGeometry> {
        let rules = self.rules;
        self.map.retain(block, Reach::Neighbourhood, |pixels, place, event, now| {
            is_signal::<T, TRAILS, ALIKE>(pixels, place, event, now, rules).unwrap_or(false)
        })
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Filter for Denoise<T, S> {
    fn advance(&mut self, now: u64) {
        self.map.advance(now);
    }

    fn keep(&mut self, event: Event) -> bool {
        let rules = self.rules;
        let answer = match rules.polarity_match {
            PolarityMatch::Any => is_signal::<T, true, false>,
            PolarityMatch::Same => is_signal::<T, true, true>,
        };
        self.map.keep(event, |pixels, place, event, now| {
            answer(pixels, place, event, now, rules).unwrap_or(false)
        })
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        match (self.rules.trail != OFF, self.rules.polarity_match) {
            (false, PolarityMatch::Any) => self.thin::<false, false>(block),
            (true, PolarityMatch::Any) => self.thin::<true, false>(block),
            // Without a period no event is a trail.
            (_, PolarityMatch::Same) => self.thin::<true, true>(block),
        }
    }
}
