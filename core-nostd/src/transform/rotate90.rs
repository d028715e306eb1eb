//! Quarter turns.

use super::flip::mirror;
use super::pixels::{X_MAX, Y_MAX, at, move_all, x_of, y_of};
use super::{TransformError, sensor};
use crate::{Block, Geometry, Transform, Unfit};

/// Parameters of [`Rotate90`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Rotate90Params {
    /// Quarter turns clockwise; negative ones turn the other way, and four are none.
    pub k: i32,
}

/// Turns the picture clockwise by k quarters: one moves (x, y) to (H - 1 - y, x), and width and height change places.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::{Rotate90, Rotate90Params}};
/// let mut events = [Event::new(0, 10, 2, Polarity::On)];
/// let mut block = Block::new(0, 0, Geometry::new(640, 480), &mut events);
/// Rotate90::try_new(block.geometry, Rotate90Params { k: 1 })?.apply(&mut block)?;
/// assert_eq!((block.span().events[0].x(), block.span().events[0].y()), (477, 10));
/// assert_eq!(block.geometry, Geometry::new(480, 640));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Rotate90 {
    geometry: Geometry,
    output: Geometry,
    turns: u8,
}

impl Rotate90 {
    /// A rotation of a sensor's events.
    pub fn try_new(geometry: Geometry, params: Rotate90Params) -> Result<Self, TransformError> {
        let turns = (params.k & 3) as u8;
        let output = if turns & 1 == 0 { geometry } else { turned(geometry)? };
        Ok(Self { geometry, output, turns })
    }
}

impl Transform for Rotate90 {
    fn output_geometry(&self) -> Geometry {
        self.output
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let (from, to) = (self.geometry, self.output);
        let (right, bottom) = (mirror(from.width), mirror(from.height));
        let moved = match self.turns {
            0 => from.check(block.geometry).map(|()| block.len()),
            1 => move_all(
                block,
                from,
                to,
                #[inline(always)]
                move |word| at(word, bottom.wrapping_sub(y_of(word)) & X_MAX, row_of(x_of(word))),
            ),
            2 => move_all(
                block,
                from,
                to,
                #[inline(always)]
                move |word| {
                    let (x, y) = (right.wrapping_sub(x_of(word)), bottom.wrapping_sub(y_of(word)));
                    at(word, x & X_MAX, y & Y_MAX)
                },
            ),
            _ => move_all(
                block,
                from,
                to,
                #[inline(always)]
                move |word| at(word, y_of(word), row_of(right.wrapping_sub(x_of(word)) & X_MAX)),
            ),
        };
        Ok(moved?)
    }
}

/// The sensor with width and height in exchange.
pub(super) fn turned(geometry: Geometry) -> Result<Geometry, TransformError> {
    sensor(geometry.height.into(), geometry.width.into())
}

/// A column as a row. One beyond what rows can tell was off the sensor, and stays so as the last.
#[inline(always)]
pub(super) const fn row_of(x: u64) -> u64 {
    if x < Y_MAX { x } else { Y_MAX }
}
