//! Affine maps: any mix of translation, rotation, scale and shear.

use super::TransformError;
use super::real::{check_matrix, remap};
use crate::{Block, Geometry, Transform, Unfit};

/// Parameters of [`Affine`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct AffineParams {
    /// `[[a, b, c], [d, e, f]]`, in pixels; from where a pixel is to where it goes.
    pub matrix: [[f64; 3]; 2],
}

/// Moves (x, y) to (round(a x + b y + c), round(d x + e y + f)), halves away from zero, and drops what leaves the sensor.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::{Affine, AffineParams}};
/// let mut events = [Event::new(0, 10, 20, Polarity::On)];
/// let mut block = Block::new(0, 0, Geometry::new(640, 480), &mut events);
/// let half_and_down = AffineParams { matrix: [[0.5, 0.0, 0.0], [0.0, 0.5, 100.0]] };
/// Affine::try_new(block.geometry, half_and_down)?.apply(&mut block)?;
/// assert_eq!((block.span().events[0].x(), block.span().events[0].y()), (5, 110));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Affine {
    geometry: Geometry,
    params: AffineParams,
}

impl Affine {
    /// An affine map of a sensor's events.
    pub fn try_new(geometry: Geometry, params: AffineParams) -> Result<Self, TransformError> {
        check_matrix(&params.matrix)?;
        Ok(Self { geometry, params })
    }
}

impl Transform for Affine {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let [[a, b, c], [d, e, f]] = self.params.matrix;
        Ok(remap(
            block,
            self.geometry,
            #[inline(always)]
            |x, y| (a * x + b * y + c, d * x + e * y + f),
        )?)
    }
}
