//! Mirror images: left and right, or top and bottom, in exchange.

use super::pixels::{X_MAX, Y_MAX, at, move_all, x_of, y_of};
use crate::{Block, Geometry, Transform, Unfit};

/// Moves column x to W - 1 - x.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::FlipX};
/// let mut events = [Event::new(0, 0, 2, Polarity::On)];
/// let mut block = Block::new(0, 0, Geometry::new(640, 480), &mut events);
/// FlipX::new(block.geometry).apply(&mut block)?;
/// assert_eq!((block.span().events[0].x(), block.span().events[0].y()), (639, 2));
/// # Ok::<(), lobula_core::Unfit>(())
/// ```
#[derive(Clone, Debug)]
pub struct FlipX {
    geometry: Geometry,
}

impl FlipX {
    /// A mirror for a sensor's events.
    pub const fn new(geometry: Geometry) -> Self {
        Self { geometry }
    }
}

impl Transform for FlipX {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let last = mirror(self.geometry.width);
        Ok(move_all(
            block,
            self.geometry,
            self.geometry,
            #[inline(always)]
            move |word| at(word, last.wrapping_sub(x_of(word)) & X_MAX, y_of(word)),
        )?)
    }
}

/// Moves row y to H - 1 - y.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::FlipY};
/// let mut events = [Event::new(0, 0, 2, Polarity::On)];
/// let mut block = Block::new(0, 0, Geometry::new(640, 480), &mut events);
/// FlipY::new(block.geometry).apply(&mut block)?;
/// assert_eq!((block.span().events[0].x(), block.span().events[0].y()), (0, 477));
/// # Ok::<(), lobula_core::Unfit>(())
/// ```
#[derive(Clone, Debug)]
pub struct FlipY {
    geometry: Geometry,
}

impl FlipY {
    /// A mirror for a sensor's events.
    pub const fn new(geometry: Geometry) -> Self {
        Self { geometry }
    }
}

impl Transform for FlipY {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let last = mirror(self.geometry.height);
        Ok(move_all(
            block,
            self.geometry,
            self.geometry,
            #[inline(always)]
            move |word| at(word, x_of(word), last.wrapping_sub(y_of(word)) & Y_MAX),
        )?)
    }
}

/// The last of so many columns or rows. Taken from it modulo a power of two at least as large, what is on the sensor
/// is mirrored and what is off it stays off it.
pub(super) fn mirror(len: u16) -> u64 {
    u64::from(len).wrapping_sub(1)
}
