//! How many events each tile of pixels had.

use core::marker::PhantomData;

use crate::representation::{BadRepresentation, Build, Overlap, Parameters, Tally, check};
use crate::{Event, Geometry, Representation, Shape, Span, WrongGeometry};

/// Number of events of each square tile, of either polarity: 1 x ceil(H / tile) x ceil(W / tile) of u16 or f32.
///
/// A picture that fits a microcontroller of 16 KiB: 320x320 pixels in tiles of 16 are 800 bytes. Tiles begin at pixel
/// (0, 0); those at the right and bottom edge may lie partly off the sensor. A tile that reaches the greatest number of
/// its type stays there (u16: 65535, f32: 2^24); the events it could not count are in [`saturated`](Build::saturated).
///
/// ```
/// use lobula_core::representation::TileCount;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(40, 10);
/// let events = [Event::new(5, 15, 0, Polarity::On), Event::new(6, 16, 9, Polarity::Off)];
/// let mut out = [0xFFFF; 3]; // whatever was there
/// let mut count = TileCount::<u16>::try_new(geometry, 16)?;
/// count.begin(Window { t0: 0, t1: 10 }, &mut out);
/// count.accumulate(Span { t_first: 5, t_last: 6, geometry, events: &events }, &mut out)?;
/// count.finish(&mut out);
/// assert_eq!(out, [1, 1, 0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct TileCount<P> {
    geometry: Geometry,
    /// A tile is 2^shift pixels wide and high: a Cortex-M0 cannot divide.
    shift: u32,
    saturated: u64,
    pixel: PhantomData<P>,
}

impl<P: Tally> TileCount<P> {
    /// For a sensor of this size and tiles of `tile_px` pixels, a power of two.
    pub const fn try_new(geometry: Geometry, tile_px: u16) -> Result<Self, BadRepresentation> {
        if !tile_px.is_power_of_two() {
            let range = "a power of two, in pixels";
            return Err(BadRepresentation::Parameter { key: "tile_px", found: tile_px as u64, range });
        }
        Ok(Self { geometry, shift: tile_px.trailing_zeros(), saturated: 0, pixel: PhantomData })
    }

    /// Tiles that cover so many pixels.
    const fn tiles(&self, pixels: u16) -> usize {
        ((pixels as u32 + (1 << self.shift) - 1) >> self.shift) as usize
    }

    /// Changes the tile of each event.
    #[inline(always)]
    fn each(&self, events: &[Event], out: &mut [P], mut change: impl FnMut(&mut P)) {
        let tiles_in_row = self.tiles(self.geometry.width);
        for event in events {
            let (row, column) = (event.y() >> self.shift, event.x() >> self.shift);
            let at = usize::from(row).wrapping_mul(tiles_in_row).wrapping_add(column.into());
            if let Some(tile) = out.get_mut(at) {
                change(tile);
            }
        }
    }
}

impl<P: Tally> Representation for TileCount<P> {
    type Pixel = P;

    fn shape(&self) -> Shape {
        let Geometry { width, height } = self.geometry;
        Shape { channels: 1, height: self.tiles(height), width: self.tiles(width) }
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [P]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let mut saturated = 0;
        self.each(span.events, out, |tile| tile.count(&mut saturated));
        self.saturated += saturated;
        Ok(())
    }

    fn finish(&mut self, _: &mut [P]) {}

    fn overlap(&self) -> Overlap {
        Overlap::Sum
    }

    fn take_away(&mut self, span: Span<'_>, out: &mut [P]) -> Result<bool, WrongGeometry> {
        check(self.geometry, &span)?;
        let mut sure = true;
        self.each(span.events, out, |tile| sure &= tile.uncount());
        Ok(sure)
    }
}

impl<P: Tally, S> Build<S> for TileCount<P> {
    fn state_len(_: &Parameters, _: Geometry) -> usize {
        0
    }

    fn build(parameters: &Parameters, geometry: Geometry, _: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.tile_px)
    }

    fn saturated(&self) -> u64 {
        self.saturated
    }
}
