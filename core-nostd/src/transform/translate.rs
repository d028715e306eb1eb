//! Translation by whole pixels, on a sensor that stays as it is.

use super::crop::shift;
use crate::{Block, Geometry, Transform, Unfit};

/// Parameters of [`Translate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct TranslateParams {
    /// Columns to the right.
    pub dx: i32,
    /// Rows down.
    pub dy: i32,
}

/// Moves (x, y) to (x + dx, y + dy) and drops what leaves the sensor.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::{Translate, TranslateParams}};
/// let mut translate = Translate::new(Geometry::new(4, 3), TranslateParams { dx: 2, dy: -1 });
/// let mut events = [Event::new(0, 1, 1, Polarity::On), Event::new(1, 2, 1, Polarity::On)];
/// let mut block = Block::new(0, 1, Geometry::new(4, 3), &mut events);
/// assert_eq!(translate.apply(&mut block)?, 1);
/// assert_eq!((block.span().events[0].x(), block.span().events[0].y()), (3, 0));
/// # Ok::<(), lobula_core::Unfit>(())
/// ```
#[derive(Clone, Debug)]
pub struct Translate {
    geometry: Geometry,
    params: TranslateParams,
}

impl Translate {
    /// A translation of a sensor's events.
    pub const fn new(geometry: Geometry, params: TranslateParams) -> Self {
        Self { geometry, params }
    }
}

impl Transform for Translate {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let TranslateParams { dx, dy } = self.params;
        // The least i32 has no negative, but as far off the sensor is off the sensor.
        Ok(shift(block, self.geometry, self.geometry, (dx.saturating_neg(), dy.saturating_neg()))?)
    }
}
