//! Slow motion and quick motion: another speed of time.

use super::TransformError;
use super::pixels::{at_time, move_all};
use super::real::{REAL_MAX, nearest, real, scaled};
use crate::{Block, Geometry, SPAN_MAX_US, Transform, Unfit, full_time};

/// Parameters of [`TimeScale`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct TimeScaleParams {
    /// What every time is multiplied with, above 0; more than 1 is slow motion.
    pub factor: f64,
}

/// Moves t to round(t f), t in full from time 0, halves up; a block's own times too.
///
/// With f > 1 a block may come to span 2^31 µs or more, which no block does: it is then refused whole and not touched
/// ([`Unfit::Reach`]), and the caller gives it in shorter ones, [`reach_max`](Transform::reach_max) of `2^31 - 1` long: for
/// f = 10 that is 214 s. However it is cut, what comes out is the same.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::{TimeScale, TimeScaleParams}};
/// let mut events = [Event::new(100, 1, 2, Polarity::On), Event::new(151, 1, 2, Polarity::On)];
/// let mut block = Block::new(100, 151, Geometry::new(640, 480), &mut events);
/// TimeScale::try_new(block.geometry, TimeScaleParams { factor: 2.5 })?.apply(&mut block)?;
/// assert_eq!(block.span().events.iter().map(|event| event.t()).collect::<Vec<_>>(), [250, 378]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct TimeScale {
    geometry: Geometry,
    factor: f64,
}

impl TimeScale {
    /// Another speed for a sensor's events.
    pub fn try_new(geometry: Geometry, params: TimeScaleParams) -> Result<Self, TransformError> {
        let factor = params.factor;
        if !factor.is_finite() {
            Err(TransformError::NotFinite { key: "factor" })
        } else if factor <= 0.0 {
            Err(TransformError::OutOfRange { key: "factor", range: "more than 0" })
        } else {
            Ok(Self { geometry, factor })
        }
    }
}

/// Both ends of a reach are rounded, so that it may grow by so many µs.
const ROUNDED_US: u64 = 4;

impl Transform for TimeScale {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn reach_max(&self, after: u64) -> u64 {
        // Too large a quotient becomes the largest number.
        ((after.saturating_sub(ROUNDED_US) as f64 / self.factor) as u64).min(after)
    }

    fn time(&self, t: u64) -> Option<u64> {
        Some(scaled(t, self.factor))
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        self.geometry.check(block.geometry)?;
        let reach_max = self.reach_max(SPAN_MAX_US - 1);
        if self.factor > 1.0 && block.span().reach() > reach_max {
            return Err(Unfit::Reach { reach_max });
        }
        let (anchor, factor, geometry) = (block.t_first, self.factor, self.geometry);
        let latest = anchor.saturating_add(SPAN_MAX_US);
        // Up to 71 years the conversions are of the kind that vectorises; both round alike.
        let left = if latest.max(scaled(latest, factor)) < REAL_MAX {
            move_all(
                block,
                geometry,
                geometry,
                #[inline(always)]
                move |word| at_time(word, nearest(real(full_time(anchor, word as u32)) * factor) as u32),
            )?
        } else {
            move_all(block, geometry, geometry, |word| {
                at_time(word, scaled(full_time(anchor, word as u32), factor) as u32)
            })?
        };
        (block.t_first, block.t_last) = (scaled(anchor, factor), scaled(block.t_last, factor));
        Ok(left)
    }
}
