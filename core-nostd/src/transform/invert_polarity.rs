//! Inversion: brighter for darker and darker for brighter.

use super::pixels::move_all;
use crate::{Block, Geometry, Transform, Unfit};

/// Makes ON events OFF and OFF events ON.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::InvertPolarity};
/// let mut events = [Event::new(0, 1, 2, Polarity::On)];
/// let mut block = Block::new(0, 0, Geometry::new(640, 480), &mut events);
/// InvertPolarity::new(block.geometry).apply(&mut block)?;
/// assert_eq!(block.span().events[0], Event::new(0, 1, 2, Polarity::Off));
/// # Ok::<(), lobula_core::Unfit>(())
/// ```
#[derive(Clone, Debug)]
pub struct InvertPolarity {
    geometry: Geometry,
}

impl InvertPolarity {
    /// An inversion of a sensor's events.
    pub const fn new(geometry: Geometry) -> Self {
        Self { geometry }
    }
}

impl Transform for InvertPolarity {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        Ok(move_all(
            block,
            self.geometry,
            self.geometry,
            #[inline(always)]
            move |word| word ^ 1 << 63,
        )?)
    }
}
