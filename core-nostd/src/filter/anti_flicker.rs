//! Anti-flicker: drops the events of tiles that lamps make flicker, by the period of their changes.
//!
//! Rule. A tile has a level from 0 to `burst`; each ON event of its pixels adds 1, each OFF event takes 1. It is dark once
//! the level is 0 and bright once it is `burst`; from dark to bright is a rise, at that event's time. A rise whose distance
//! `d` from the one before is in the band, `f_low <= 1 / d <= f_high` with `frequency_hz` minus and plus `band_hz`, adds 1
//! to the tile's score; any other distance sets it to 0. The tile flickers while the score is at least `cycles` and the
//! last rise is no longer ago than two periods of `f_low`. Events are judged once they are counted.
//!
//! Light on mains of 50 Hz flickers at 100 Hz, on 60 Hz at 120. Tiles of 8x8 pixels take 8 bytes for 64 pixels, so that a
//! microcontroller has room for them; of 1x1 (`tile_shift` 0, `burst` 1) each pixel is judged by itself. Whatever moves in
//! a tile that flickers is dropped with it. Prophesee's sensors do the same in 4x4 tiles (docs.prophesee.ai, "Event Signal
//! Processing"), by a method they do not tell. A restart of the camera's clock begins anew.

use super::periods::{Ended, Periods};
use super::tiles::Tiles;
use super::{FilterError, cleared, in_range};
use crate::compact::compact_all;
use crate::{Block, Event, Filter, Geometry, WrongGeometry, full_time};
use core::num::NonZeroU64;

/// Which events are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum FlickerKeep {
    /// Those of tiles that do not flicker.
    #[default]
    Steady,
    /// Those of tiles that do, to find lamps.
    Flickering,
}

/// Parameters of [`AntiFlicker`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default)
)]
pub struct AntiFlickerParams {
    /// The middle of the band in Hz, 2 to 50000. By default 100.
    pub frequency_hz: u32,
    /// How far the band reaches to either side in Hz, less than the frequency. By default 10.
    pub band_hz: u32,
    /// Tiles are squares of 2^shift pixels, 0 to 15. By default 3.
    pub tile_shift: u8,
    /// Events of one polarity, less those of the other, that make a dark tile bright, 1 at least. By default 16.
    pub burst: u8,
    /// Periods in the band, one after the other, until a tile is said to flicker, 1 at least. By default 3.
    pub cycles: u8,
    /// Which events are kept; by default those of tiles that do not flicker.
    pub keep: FlickerKeep,
}

impl Default for AntiFlickerParams {
    fn default() -> Self {
        let keep = FlickerKeep::Steady;
        Self { frequency_hz: 100, band_hz: 10, tile_shift: 3, burst: 16, cycles: 3, keep }
    }
}

/// Drops the events of tiles that flicker in a band of frequencies.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{AntiFlicker, AntiFlickerParams}};
/// let geometry = Geometry::new(640, 480);
/// let params = AntiFlickerParams { burst: 1, cycles: 2, tile_shift: 0, ..AntiFlickerParams::default() };
/// let memory = vec![0u32; AntiFlicker::<()>::required_len(geometry, 0)];
/// let mut filter = AntiFlicker::try_new(geometry, params, memory)?;
/// let mut keep = |t, polarity| filter.keep(Event::new(t, 3, 4, polarity));
/// for cycle in 0..5 {
///     let on = keep(cycle * 10_000, Polarity::On);
///     let off = keep(cycle * 10_000 + 5_000, Polarity::Off);
///     assert_eq!((on, off), if cycle < 2 { (true, true) } else { (false, false) });
/// }
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct AntiFlicker<S> {
    geometry: Geometry,
    tiles: Tiles,
    band: Band,
    burst: u8,
    cycles: u8,
    keeps_flicker: bool,
    epochs: Periods,
    /// Two words for each tile: the time of its last rise in µs, modulo 2^32, and its [`Tile`].
    memory: S,
}

/// Periods in the band in µs, and how long after its last rise a tile may still flicker.
#[derive(Clone, Copy, Debug)]
struct Band {
    shortest: i32,
    longest: i32,
    patience: i32,
}

impl Band {
    fn try_new(frequency: u32, reach: u32) -> Result<Self, FilterError> {
        const SECOND: u32 = 1_000_000;
        let frequency = in_range("frequency_hz", frequency, (2, 50_000))?;
        let reach = in_range("band_hz", reach, (0, frequency - 1))?;
        let (low, high) = (frequency - reach, frequency + reach);
        let longest = SECOND.checked_div(low).unwrap_or(SECOND);
        let shortest = SECOND.checked_add(high - 1).and_then(|sum| sum.checked_div(high)).unwrap_or(1);
        let (shortest, longest) = (shortest as i32, longest as i32);
        Ok(Self { shortest, longest, patience: 2 * longest })
    }
}

/// Stream time at the end of which old rises are forgotten, so that their age in 32 bits stays what it is.
const EPOCH_US: NonZeroU64 = NonZeroU64::MIN.saturating_add((1 << 30) - 1);

/// What is known of a tile, in one word: level, score, whether it is bright and whether it ever rose.
#[derive(Clone, Copy)]
struct Tile {
    level: u8,
    score: u8,
    bright: bool,
    rose: bool,
}

impl Tile {
    #[inline(always)]
    const fn unpack(word: u32) -> Self {
        Self {
            level: word as u8,
            score: (word >> 8) as u8,
            bright: word >> 16 & 1 == 1,
            rose: word >> 17 & 1 == 1,
        }
    }

    #[inline(always)]
    const fn pack(self) -> u32 {
        self.level as u32 | (self.score as u32) << 8 | (self.bright as u32) << 16 | (self.rose as u32) << 17
    }
}

/// Time since `then` in µs; negative where it stepped back.
#[inline(always)]
const fn age(now: u32, then: u32) -> i32 {
    now.wrapping_sub(then) as i32
}

impl<S> AntiFlicker<S> {
    /// Words of memory it needs: two for each tile of 2^`tile_shift` pixels a side.
    pub const fn required_len(geometry: Geometry, tile_shift: u8) -> usize {
        2 * Tiles::count(geometry, tile_shift)
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> AntiFlicker<S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) words.
    pub fn try_new(
        geometry: Geometry,
        params: AntiFlickerParams,
        mut memory: S,
    ) -> Result<Self, FilterError> {
        let band = Band::try_new(params.frequency_hz, params.band_hz)?;
        in_range("burst", params.burst as u32, (1, 255))?;
        in_range("cycles", params.cycles as u32, (1, 255))?;
        let tiles = Tiles::try_new(geometry, params.tile_shift)?;
        cleared(memory.as_mut(), Self::required_len(geometry, params.tile_shift))?;
        let (burst, cycles) = (params.burst, params.cycles);
        let keeps_flicker = params.keep == FlickerKeep::Flickering;
        Ok(Self {
            geometry,
            tiles,
            band,
            burst,
            cycles,
            keeps_flicker,
            epochs: Periods::new(EPOCH_US),
            memory,
        })
    }

    #[inline(always)]
    fn reach(&mut self, t: u64) {
        if let Some(ended) = self.epochs.ended(t) {
            self.forget(ended, t);
        }
    }

    #[cold]
    fn forget(&mut self, ended: Ended, now: u64) {
        if ended == Ended::All {
            return self.memory.as_mut().fill(0);
        }
        let long = ended != Ended::Periods(1);
        for tile in self.memory.as_mut().as_chunks_mut::<2>().0 {
            let [rise, word] = tile;
            if long || age(now as u32, *rise) > self.band.patience {
                *word = Tile { score: 0, rose: false, ..Tile::unpack(*word) }.pack();
            }
        }
    }

    #[inline(always)]
    fn flickers(&mut self, event: Event) -> bool {
        let tiles = self.memory.as_mut().as_chunks_mut::<2>().0;
        let Some([rise, word]) = tiles.get_mut(self.tiles.of(event)) else { return false };
        let mut tile = Tile::unpack(*word);
        let since = age(event.t(), *rise);
        if event.is_on() {
            tile.level = tile.level.saturating_add(1).min(self.burst);
            if tile.level == self.burst && !tile.bright {
                let in_band = tile.rose & (since >= self.band.shortest) & (since <= self.band.longest);
                tile.score = if in_band { tile.score.saturating_add(1) } else { 0 };
                (tile.bright, tile.rose) = (true, true);
                *rise = event.t();
            }
        } else {
            tile.level = tile.level.saturating_sub(1);
            tile.bright &= tile.level > 0;
        }
        *word = tile.pack();
        (tile.score >= self.cycles) & (age(event.t(), *rise) <= self.band.patience)
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Filter for AntiFlicker<S> {
    fn advance(&mut self, now: u64) {
        self.reach(now);
    }

    fn keep(&mut self, event: Event) -> bool {
        self.reach(self.epochs.time(event));
        self.flickers(event) == self.keeps_flicker
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        self.geometry.check(block.geometry)?;
        let anchor = block.t_first;
        let kept = compact_all(block.events_mut(), |event| {
            self.reach(full_time(anchor, event.t()));
            self.flickers(event) == self.keeps_flicker
        });
        block.truncate(kept);
        Ok(kept)
    }
}
