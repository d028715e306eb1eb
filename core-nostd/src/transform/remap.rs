//! A table of where each pixel's events go: any map, once computed, at the price of one look-up.

use super::TransformError;
use super::pixels::{X_MAX, Y_MAX, at, x_of, y_of};
use super::real::{ends, place, real};
use crate::compact::select_tiles;
use crate::vector::gather;
use crate::{Block, Geometry, Transform, Unfit};

/// Entry of a pixel whose events are dropped: bit 31 is no pixel's, an entry being the upper half of an event's word.
const OFF: u32 = 1 << 31;

/// Moves events by a table with an entry for each pixel, in the caller's memory: 4 bytes a pixel.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::Remap};
/// let geometry = Geometry::new(4, 3);
/// let memory = vec![0; Remap::<()>::required_len(geometry)];
/// let mut twice = Remap::try_new(geometry, memory, |x, y| (2.0 * x, y))?;
/// let mut events = [Event::new(0, 1, 2, Polarity::On), Event::new(0, 2, 2, Polarity::On)];
/// let mut block = Block::new(0, 0, geometry, &mut events);
/// assert_eq!(twice.apply(&mut block)?, 1); // (4, 2) is off the sensor
/// assert_eq!(block.span().events, [Event::new(0, 2, 2, Polarity::On)]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Remap<S> {
    geometry: Geometry,
    table: S,
}

impl<S> Remap<S> {
    /// Entries of memory it needs.
    pub const fn required_len(geometry: Geometry) -> usize {
        geometry.pixels()
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Remap<S> {
    /// The table of where `map` moves each pixel, in real coordinates, rounded half away from zero; what it moves off
    /// the sensor, or to no number, is dropped. In `memory` of at least [`required_len`](Self::required_len) entries.
    pub fn try_new(
        geometry: Geometry,
        mut memory: S,
        map: impl Fn(f64, f64) -> (f64, f64),
    ) -> Result<Self, TransformError> {
        let (needed, found) = (Self::required_len(geometry), memory.as_ref().len());
        let table = memory.as_mut().get_mut(..needed);
        let table = table.ok_or(TransformError::MemoryTooShort { needed, found })?;
        let ends = ends(geometry);
        for (y, row) in table.chunks_exact_mut(usize::from(geometry.width).max(1)).enumerate() {
            for (x, entry) in row.iter_mut().enumerate() {
                let (word, on) = place(0, map(real(x as u64), real(y as u64)), ends);
                *entry = if on { (word >> 32) as u32 } else { OFF };
            }
        }
        Ok(Self { geometry, table: memory })
    }
}

impl<S: AsRef<[u32]>> Remap<S> {
    /// Where the events of pixel (x, y) go; `None` if they are dropped.
    pub fn of(&self, x: u16, y: u16) -> Option<(u16, u16)> {
        let on = self.geometry.contains(x, y);
        let entry =
            self.table.as_ref().get(self.geometry.index(x, y)).filter(|entry| on && **entry & OFF == 0)?;
        Some(((*entry & X_MAX as u32) as u16, (*entry >> 16) as u16))
    }
}

impl<S: AsRef<[u32]>> Transform for Remap<S> {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let table = self.table.as_ref().get(..self.geometry.pixels()).unwrap_or_default();
        let width = u64::from(self.geometry.width);
        self.geometry.check(block.geometry)?;
        let kept = select_tiles(
            block.events_mut(),
            #[inline(always)]
            move |words, places, _| {
                // One off the sensor's width finds the entry of another pixel, if any: no decoder gives such events.
                for (place, word) in places.iter_mut().zip(&*words) {
                    *place = y_of(*word) * width + x_of(*word);
                }
                gather(table, places, OFF);
                for (place, word) in places.iter_mut().zip(words) {
                    let on = (*place & u64::from(OFF) == 0) & (x_of(*word) < width);
                    *word = at(*word, *place & X_MAX, *place >> 16 & Y_MAX);
                    *place = on.into();
                }
            },
        );
        block.truncate(kept);
        Ok(kept)
    }
}
