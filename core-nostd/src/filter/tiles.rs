//! Tiles: squares of pixels that share a counter, for what is known of regions and not of pixels.

use super::FilterError;
use super::in_range;
use crate::{Event, Geometry};

/// A sensor cut into squares of 2^shift pixels, row by row.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tiles {
    shift: u32,
    columns: usize,
}

/// Largest shift: squares of 2^15 pixels, which no sensor has.
const SHIFT_MAX: u8 = 15;

impl Tiles {
    pub(super) const fn try_new(geometry: Geometry, shift: u8) -> Result<Self, FilterError> {
        match in_range("tile_shift", shift as u32, (0, SHIFT_MAX as u32)) {
            Ok(shift) => Ok(Self { shift, columns: along(geometry.width, shift) }),
            Err(error) => Err(error),
        }
    }

    /// How many tiles there are; none with a shift that is out of range.
    pub(super) const fn count(geometry: Geometry, shift: u8) -> usize {
        if shift > SHIFT_MAX {
            return 0;
        }
        along(geometry.width, shift as u32) * along(geometry.height, shift as u32)
    }

    /// The tile of the event's pixel.
    #[inline(always)]
    pub(super) fn of(&self, event: Event) -> usize {
        let (x, y) = (event.x() as usize, event.y() as usize);
        y.wrapping_shr(self.shift).wrapping_mul(self.columns).wrapping_add(x.wrapping_shr(self.shift))
    }
}

/// Tiles in a row or column of so many pixels, the last perhaps cut.
const fn along(pixels: u16, shift: u32) -> usize {
    (pixels as usize + (1usize.wrapping_shl(shift) - 1)).wrapping_shr(shift)
}
