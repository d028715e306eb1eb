//! Transposition: rows become columns.

use super::TransformError;
use super::pixels::{at, move_all, x_of, y_of};
use super::rotate90::{row_of, turned};
use crate::{Block, Geometry, Transform, Unfit};

/// Moves (x, y) to (y, x); width and height change places.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::Transpose};
/// let mut events = [Event::new(0, 10, 2, Polarity::On)];
/// let mut block = Block::new(0, 0, Geometry::new(640, 480), &mut events);
/// Transpose::try_new(block.geometry)?.apply(&mut block)?;
/// assert_eq!((block.span().events[0].x(), block.span().events[0].y()), (2, 10));
/// assert_eq!(block.geometry, Geometry::new(480, 640));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Transpose {
    geometry: Geometry,
    output: Geometry,
}

impl Transpose {
    /// A transposition of a sensor's events.
    pub fn try_new(geometry: Geometry) -> Result<Self, TransformError> {
        Ok(Self { geometry, output: turned(geometry)? })
    }
}

impl Transform for Transpose {
    fn output_geometry(&self) -> Geometry {
        self.output
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        Ok(move_all(
            block,
            self.geometry,
            self.output,
            #[inline(always)]
            move |word| at(word, y_of(word), row_of(x_of(word))),
        )?)
    }
}
