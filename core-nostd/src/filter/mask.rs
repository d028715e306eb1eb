//! A set of pixels, one bit each, and the filter that keeps the events of its pixels or of all others.

use super::FilterError;
use crate::compact::select_tiles;
use crate::vector::gather;
use crate::{Block, Event, Filter, Geometry, WrongGeometry};

/// A set of pixels of a sensor in the caller's memory: bit `i % 32` of word `i / 32` for the row-major index `i`.
///
/// ```
/// use lobula_core::{Geometry, filter::PixelMask};
/// let geometry = Geometry::new(1280, 720);
/// let mut mask = PixelMask::empty(geometry, vec![0u32; PixelMask::<()>::required_len(geometry)])?;
/// assert!(mask.insert(3, 4) && !mask.insert(1280, 0)); // the second is off the sensor
/// assert!(mask.contains(3, 4) && !mask.contains(4, 3));
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct PixelMask<S> {
    geometry: Geometry,
    words: S,
}

impl<S> PixelMask<S> {
    /// Words of memory that a mask of this sensor needs.
    pub const fn required_len(geometry: Geometry) -> usize {
        geometry.pixels().div_ceil(32)
    }

    /// The sensor's size.
    pub const fn geometry(&self) -> Geometry {
        self.geometry
    }
}

impl<S: AsRef<[u32]>> PixelMask<S> {
    /// The mask that is in `words` already (from flash, say).
    pub fn try_from_words(geometry: Geometry, words: S) -> Result<Self, FilterError> {
        let (needed, found) = (Self::required_len(geometry), words.as_ref().len());
        if found < needed {
            return Err(FilterError::MemoryTooShort { needed, found });
        }
        Ok(Self { geometry, words })
    }

    /// Whether the pixel is in the set; no pixel off the sensor is.
    pub fn contains(&self, x: u16, y: u16) -> bool {
        self.geometry.contains(x, y) && !self.spares(Event::new(0, x, y, crate::Polarity::Off))
    }

    /// Keeps the events of the mask's pixels or of all others; returns how many are left at the start.
    pub(super) fn thin(&self, events: &mut [Event], keep: MaskKeep) -> usize {
        let (geometry, mask) = (self.geometry, self.words.as_ref());
        let outside = u64::from(keep == MaskKeep::Outside);
        select_tiles(
            events,
            #[inline(always)]
            move |words, places, _| {
                let index = |word| {
                    let event = Event::from_word(word);
                    geometry.index(event.x(), event.y()) as u64
                };
                for (place, word) in places.iter_mut().zip(&*words) {
                    *place = index(*word) / 32;
                }
                gather(mask, places, !0);
                for (place, word) in places.iter_mut().zip(words) {
                    *place = (*place >> (index(*word) % 32) ^ outside) & 1;
                }
            },
        )
    }

    /// 1 where the mask has this pixel or ends before it.
    #[inline(always)]
    fn bit(&self, i: usize) -> u32 {
        self.words.as_ref().get(i / 32).copied().unwrap_or(!0) >> (i % 32) & 1
    }

    /// Whether the event's pixel, which is on the sensor, is not in the set.
    #[inline(always)]
    pub(crate) fn spares(&self, event: Event) -> bool {
        self.bit(self.geometry.index(event.x(), event.y())) == 0
    }

    /// The pixels in the set as (x, y), row by row.
    pub fn iter(&self) -> impl Iterator<Item = (u16, u16)> + '_ {
        let Geometry { width, height } = self.geometry;
        let pixels = (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)));
        pixels.filter(|(x, y)| self.contains(*x, *y))
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> PixelMask<S> {
    /// A mask of no pixel, in `words` of at least [`required_len`](Self::required_len), whatever they hold.
    pub fn empty(geometry: Geometry, words: S) -> Result<Self, FilterError> {
        let mut mask = Self::try_from_words(geometry, words)?;
        mask.words.as_mut().fill(0);
        Ok(mask)
    }

    /// Takes the words of all its pixels.
    #[inline(always)]
    pub(super) fn fill(&mut self, words: impl Iterator<Item = u32>) {
        self.words.as_mut().iter_mut().zip(words).for_each(|(old, word)| *old = word);
    }

    /// Adds a pixel; false, and nothing is done, off the sensor.
    pub fn insert(&mut self, x: u16, y: u16) -> bool {
        let i = self.geometry.index(x, y);
        let on_sensor = self.geometry.contains(x, y);
        match self.words.as_mut().get_mut(i / 32) {
            Some(word) if on_sensor => *word |= 1 << (i % 32),
            _ => return false,
        }
        true
    }
}

/// Which events a [`MaskFilter`] keeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum MaskKeep {
    /// Those of the mask's pixels.
    #[default]
    Inside,
    /// Those of all other pixels.
    Outside,
}

/// Keeps the events of a mask's pixels, or of all others. The sensor's size stays.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{MaskFilter, MaskKeep, PixelMask}};
/// let geometry = Geometry::new(640, 480);
/// let mut mask = PixelMask::empty(geometry, vec![0u32; PixelMask::<()>::required_len(geometry)])?;
/// mask.insert(3, 4);
/// let mut filter = MaskFilter::new(mask, MaskKeep::Inside);
/// assert!(filter.keep(Event::new(0, 3, 4, Polarity::On)));
/// assert!(!filter.keep(Event::new(0, 4, 3, Polarity::On)));
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct MaskFilter<S> {
    mask: PixelMask<S>,
    keep: MaskKeep,
}

impl<S: AsRef<[u32]>> MaskFilter<S> {
    /// A filter of this mask.
    pub const fn new(mask: PixelMask<S>, keep: MaskKeep) -> Self {
        Self { mask, keep }
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> MaskFilter<S> {
    /// Adds a pixel to the mask; false, and nothing is done, off the sensor.
    pub fn insert(&mut self, x: u16, y: u16) -> bool {
        self.mask.insert(x, y)
    }
}

impl<S: AsRef<[u32]>> Filter for MaskFilter<S> {
    #[inline]
    fn keep(&mut self, event: Event) -> bool {
        self.mask.spares(event) == (self.keep == MaskKeep::Outside)
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        self.mask.geometry().check(block.geometry)?;
        let kept = self.mask.thin(block.events_mut(), self.keep);
        block.truncate(kept);
        Ok(kept)
    }
}
