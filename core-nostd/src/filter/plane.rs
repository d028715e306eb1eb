//! Bit planes: a bit for each entry of a time map, in the words behind it.

use crate::Geometry;
use crate::time_map::{Pixels, Stamp, TimeMap};
use core::cell::Cell;

/// Words of a plane for a sensor: one more than the bits need, so that any three bits lie in two words that are there.
pub(super) const fn words<T: Stamp>(geometry: Geometry) -> usize {
    TimeMap::<T, ()>::required_len(geometry).div_ceil(T::BITS as usize).saturating_add(1)
}

/// A plane. Its bits are those of the map's entries, as [`Pixels`] places them: the row above a pixel begins at its
/// place, and the pixel is one row and one bit further.
#[derive(Clone, Copy)]
pub(super) struct Plane<'a, T> {
    words: &'a [Cell<T>],
    stride: usize,
}

impl<'a, T: Stamp> Plane<'a, T> {
    /// The only plane of a map.
    #[inline(always)]
    pub(super) fn only(pixels: &Pixels<'a, T>) -> Self {
        Self { words: pixels.spare(), stride: pixels.stride() }
    }

    /// The two planes of a map.
    #[inline(always)]
    pub(super) fn two(pixels: &Pixels<'a, T>) -> [Self; 2] {
        let words = pixels.spare();
        let (first, second) = words.split_at_checked(words.len() / 2).unwrap_or_default();
        [first, second].map(|words| Self { words, stride: pixels.stride() })
    }

    /// The bit of the pixel at a place.
    #[inline(always)]
    pub(super) fn bit(self, place: usize) -> Option<Bit<'a, T>> {
        let bit = place + self.stride + 1;
        let word = self.words.get(bit / T::BITS as usize)?;
        Some(Bit { word, place: bit as u32 % T::BITS })
    }

    /// The bits around the pixel at a place and its own: three rows of three, the first the lowest.
    #[inline(always)]
    pub(super) fn around(self, place: usize) -> Option<u32> {
        let three = |bit: usize| {
            let word = bit / T::BITS as usize;
            let (word, next) = (self.words.get(word)?.get(), self.words.get(word + 1)?.get());
            Some(word.three_bits(next, bit as u32 % T::BITS))
        };
        let below = three(place + 2 * self.stride)?;
        Some(three(place)? | three(place + self.stride)? << 3 | below << 6)
    }
}

/// A bit of a plane.
pub(super) struct Bit<'a, T> {
    word: &'a Cell<T>,
    place: u32,
}

impl<T: Stamp> Bit<'_, T> {
    #[inline(always)]
    pub(super) fn get(&self) -> bool {
        self.word.get().bit(self.place)
    }

    #[inline(always)]
    pub(super) fn set(&self, bit: bool) {
        self.word.set(self.word.get().with_bit(self.place, bit));
    }
}
