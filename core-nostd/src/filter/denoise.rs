//! Denoising in one pass: hot pixels, refractory period, support by neighbours and trails, over one time map.
//!
//! Rule. An event at time `t` of a hot pixel is dropped and leaves no trace. Of any other, with `last` the time of its
//! pixel's last event and `n` the number of its 8 neighbours whose last event is at most `support_us` ago:
//!
//! - it is too soon if `t - last < refractory_us`;
//! - it is noise if `n < support` (1: background activity; 2 and more: the spatiotemporal correlation filter of Guo
//!   and Delbruck, "Low Cost and Latency Event Camera Background Activity Denoising", TPAMI 2022, without regard to
//!   polarity);
//! - it is a trail if `t - last < trail_us` and its pixel's last event had the same polarity;
//!
//! and it is kept if it is none of these. "Last events" are those of the stream but for hot pixels: kept or dropped.
//! This is not the same as single filters in a row, where each remembers only what the ones before it kept; it reads
//! each neighbourhood once.

use super::FilterError;
use crate::time_map::{Pixels, Reach, Stamp, TimeMap};
use crate::{Block, Event, Filter, Geometry, Polarity, WrongGeometry};
use core::cell::Cell;

/// Parameters of [`Denoise`]. Times in µs are below 2^30 (`u32` map) or 2^14 ticks (`u16`), rounded down to ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DenoiseParams {
    /// Least time between events of a pixel, in µs; 0: any. By default 200.
    pub refractory_us: u32,
    /// How long ago a neighbour's event still supports, in µs. By default 20000.
    pub support_us: u32,
    /// How many of the 8 neighbours must support, 0 (none need) to 8. By default 2.
    pub support: u8,
    /// How long an event of a pixel is followed by a trail of the same polarity, in µs; 0 (the default): none.
    pub trail_us: u32,
    /// Ticks of 2^shift µs; 0 for a `u32` map.
    pub shift: u8,
}

impl Default for DenoiseParams {
    fn default() -> Self {
        Self { refractory_us: 200, support_us: 20_000, support: 2, trail_us: 0, shift: 0 }
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
    trail: i32,
}

impl<T: Stamp, S> Denoise<T, S> {
    /// Entries of memory it needs: a time map and two bits for each of its entries.
    pub const fn required_len(geometry: Geometry) -> usize {
        let entries = TimeMap::<T, S>::required_len(geometry);
        entries.saturating_add(2 * entries.div_ceil(T::BITS as usize))
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Denoise<T, S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) entries. No
    /// pixel is hot until [`mask`](Self::mask) says so.
    pub fn try_new(geometry: Geometry, params: DenoiseParams, mut memory: S) -> Result<Self, FilterError> {
        if params.support > 8 {
            return Err(FilterError::SupportOutOfRange { support: params.support });
        }
        let (needed, found) = (Self::required_len(geometry), memory.as_ref().len());
        memory
            .as_mut()
            .get_mut(..needed)
            .ok_or(FilterError::MemoryTooShort { needed, found })?
            .fill(T::default());
        let map = TimeMap::try_new(geometry, params.shift, memory)?;
        let period = |dt_us| if dt_us == 0 { Ok(OFF) } else { map.ticks(dt_us) };
        let rules = Rules {
            refractory: period(params.refractory_us)?,
            support_dt: map.ticks(params.support_us)?,
            support: params.support as u32,
            trail: period(params.trail_us)?,
        };
        Ok(Self { map, rules })
    }

    /// From now on the pixel is hot; false, and nothing is done, off the sensor.
    pub fn mask(&mut self, x: u16, y: u16) -> bool {
        let on_sensor = self.map.geometry().contains(x, y);
        let Some(pixels) = self.map.pixels() else { return false };
        let (hot, _) = planes(&pixels);
        match Bit::of(hot, pixels.place(Event::new(0, x, y, Polarity::Off)) as usize) {
            Some(bit) if on_sensor => bit.set(true),
            _ => return false,
        }
        true
    }
}

/// The words behind the map, a bit for each entry: whether the pixel is hot, and its last event's polarity.
#[inline(always)]
fn planes<'a, T: Stamp>(pixels: &Pixels<'a, T>) -> (&'a [Cell<T>], &'a [Cell<T>]) {
    let words = pixels.spare();
    words.split_at_checked(words.len() / 2).unwrap_or_default()
}

struct Bit<'a, T> {
    word: &'a Cell<T>,
    place: u32,
}

impl<'a, T: Stamp> Bit<'a, T> {
    #[inline(always)]
    fn of(plane: &'a [Cell<T>], place: usize) -> Option<Self> {
        let word = plane.get(place / T::BITS as usize)?;
        Some(Self { word, place: place as u32 % T::BITS })
    }

    #[inline(always)]
    fn get(&self) -> bool {
        self.word.get().bit(self.place)
    }

    #[inline(always)]
    fn set(&self, bit: bool) {
        self.word.set(self.word.get().with_bit(self.place, bit));
    }
}

/// The rule for one event. `trails`: whether polarities are looked at and remembered.
#[inline(always)]
fn is_signal<T: Stamp>(
    pixels: &Pixels<'_, T>,
    place: usize,
    event: Event,
    now: T,
    rules: Rules,
    trails: bool,
) -> Option<bool> {
    let (hot, on) = planes(pixels);
    if Bit::of(hot, place)?.get() {
        return None;
    }
    let (pixel, neighbours) = pixels.neighbourhood(place)?;
    // The sign of a margin, as 0 or 1, is whether the neighbour does not support.
    let alone = neighbours.map(|last| now.margin(rules.support_dt, last) as u32 >> 31);
    let support = 8 - alone.iter().sum::<u32>();
    let age = now.age(pixel.get());
    pixel.set(now);
    let mut signal = (age >= rules.refractory) & (support >= rules.support);
    if trails {
        let last_on = Bit::of(on, place)?;
        signal &= (age >= rules.trail) | (last_on.get() != event.is_on());
        last_on.set(event.is_on());
    }
    Some(signal)
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Filter for Denoise<T, S> {
    fn advance(&mut self, now: u64) {
        self.map.advance(now);
    }

    fn keep(&mut self, event: Event) -> bool {
        let rules = self.rules;
        self.map.keep(event, |pixels, place, event, now| {
            is_signal(pixels, place, event, now, rules, true).unwrap_or(false)
        })
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        let rules = self.rules;
        if rules.trail == OFF {
            self.map.retain(block, Reach::Neighbourhood, |pixels, place, event, now| {
                is_signal(pixels, place, event, now, rules, false).unwrap_or(false)
            })
        } else {
            self.map.retain(block, Reach::Neighbourhood, |pixels, place, event, now| {
                is_signal(pixels, place, event, now, rules, true).unwrap_or(false)
            })
        }
    }
}
