//! Perspective maps: what a plane does as a camera moves before it.

use super::TransformError;
use super::real::{check_matrix, remap};
use crate::{Block, Geometry, Transform, Unfit};

/// Parameters of [`Perspective`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct PerspectiveParams {
    /// `[[a, b, c], [d, e, f], [g, h, i]]`, in pixels; from where a pixel is to where it goes.
    pub matrix: [[f64; 3]; 3],
}

/// Moves (x, y) to (round((a x + b y + c) / w), round((d x + e y + f) / w)), w = g x + h y + i, halves away from zero, and
/// drops what leaves the sensor and where w = 0.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::{Perspective, PerspectiveParams}};
/// let mut events = [Event::new(0, 100, 20, Polarity::On)];
/// let mut block = Block::new(0, 0, Geometry::new(640, 480), &mut events);
/// let lean = PerspectiveParams { matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.01, 0.0, 1.0]] };
/// Perspective::try_new(block.geometry, lean)?.apply(&mut block)?;
/// assert_eq!((block.span().events[0].x(), block.span().events[0].y()), (50, 10));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Perspective {
    geometry: Geometry,
    params: PerspectiveParams,
}

impl Perspective {
    /// A perspective map of a sensor's events.
    pub fn try_new(geometry: Geometry, params: PerspectiveParams) -> Result<Self, TransformError> {
        check_matrix(&params.matrix)?;
        Ok(Self { geometry, params })
    }
}

impl Transform for Perspective {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let [[a, b, c], [d, e, f], [g, h, i]] = self.params.matrix;
        Ok(remap(
            block,
            self.geometry,
            #[inline(always)]
            |x, y| {
                let w = g * x + h * y + i;
                // Where w is 0 the quotients are infinite, or no numbers: off the sensor.
                ((a * x + b * y + c) / w, (d * x + e * y + f) / w)
            },
        )?)
    }
}
