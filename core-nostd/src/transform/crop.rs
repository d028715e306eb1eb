//! Crop: a rectangle of pixels becomes the sensor. (A region of interest, which keeps the size, is a filter.)

use super::pixels::{at, select, x_of, y_of};
use super::{TransformError, sensor};
use crate::{Block, Geometry, Transform, Unfit};

/// Parameters of [`Crop`]: a rectangle, which may reach beyond the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct CropParams {
    /// First column.
    pub x: i32,
    /// First row.
    pub y: i32,
    /// Columns.
    pub width: u16,
    /// Rows, at most 32768.
    pub height: u16,
}

/// Moves (x, y) to (x - x0, y - y0) on a sensor of `width` x `height`, and drops what is off that.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::{Crop, CropParams}};
/// let mut crop = Crop::try_new(Geometry::new(640, 480), CropParams { x: 160, y: 120, width: 320, height: 240 })?;
/// let mut events = [Event::new(0, 160, 121, Polarity::On), Event::new(1, 480, 121, Polarity::On)];
/// let mut block = Block::new(0, 1, Geometry::new(640, 480), &mut events);
/// assert_eq!(crop.apply(&mut block)?, 1);
/// assert_eq!((block.span().events[0].x(), block.span().events[0].y()), (0, 1));
/// assert_eq!(block.geometry, Geometry::new(320, 240));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Crop {
    geometry: Geometry,
    output: Geometry,
    x: i32,
    y: i32,
}

impl Crop {
    /// A crop of a sensor's events.
    pub const fn try_new(geometry: Geometry, params: CropParams) -> Result<Self, TransformError> {
        match sensor(params.width as u32, params.height as u32) {
            Ok(output) => Ok(Self { geometry, output, x: params.x, y: params.y }),
            Err(error) => Err(error),
        }
    }
}

impl Transform for Crop {
    fn output_geometry(&self) -> Geometry {
        self.output
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        Ok(shift(block, self.geometry, self.output, (self.x, self.y))?)
    }
}

/// Moves the events so that the pixel `origin` becomes (0, 0) of sensor `to`.
pub(super) fn shift(
    block: &mut Block<'_>,
    from: Geometry,
    to: Geometry,
    origin: (i32, i32),
) -> Result<usize, crate::WrongGeometry> {
    // Two's complement: less than 0 becomes more than any sensor has.
    let (x0, y0) = (i64::from(origin.0) as u64, i64::from(origin.1) as u64);
    let (width, height) = (u64::from(to.width), u64::from(to.height));
    select(
        block,
        from,
        to,
        #[inline(always)]
        move |word, _| {
            let (x, y) = (x_of(word).wrapping_sub(x0), y_of(word).wrapping_sub(y0));
            (at(word, x & super::pixels::X_MAX, y & super::pixels::Y_MAX), (x < width) & (y < height))
        },
    )
}
