//! A stretch of time without events.

use super::chance::ratio;
use super::{Kind, Seed};
use crate::transform::{TransformError, keep_by_time};
use crate::{Block, Geometry, Transform, Unfit, Window};

/// Parameters of [`DropByTime`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct DropByTimeParams {
    /// Start of the slice in µs.
    pub t0_us: u64,
    /// End of the slice in µs, exclusive.
    pub t1_us: u64,
    /// Share of the slice's time that is dropped, 0 to 1.
    pub ratio: f64,
}

/// Drops the events of one stretch of the slice's time, of a given share, anywhere in it (Drop by Time of Gu et al. 2021,
/// EventDrop, 10.24963/ijcai.2021/97).
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform};
/// use lobula_core::augmentation::{DropByTime, DropByTimeParams, Seed};
/// let geometry = Geometry::new(640, 480);
/// let params = DropByTimeParams { t0_us: 0, t1_us: 1000, ratio: 0.25 };
/// let mut drop = DropByTime::try_new(geometry, params, Seed { seed: 7, slice: 3 })?;
/// let mut events: Vec<_> = (0..1000).map(|t| Event::new(t, 1, 2, Polarity::On)).collect();
/// assert_eq!(drop.apply(&mut Block::new(0, 999, geometry, &mut events))?, 750);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct DropByTime {
    geometry: Geometry,
    dropped: Window,
}

impl DropByTime {
    /// For a slice of a sensor's events.
    pub fn try_new(geometry: Geometry, params: DropByTimeParams, seed: Seed) -> Result<Self, TransformError> {
        let DropByTimeParams { t0_us, t1_us, ratio: share } = params;
        let Some(length) = t1_us.checked_sub(t0_us) else {
            return Err(TransformError::OutOfRange { key: "t1_us", range: "no less than t0_us" });
        };
        let dropped = ((length as f64 * ratio("ratio", share)?) as u64).min(length);
        let start =
            (u128::from(seed.random(Kind::DropByTime).next()) * (u128::from(length - dropped) + 1)) >> 64;
        let t0 = t0_us.saturating_add(start as u64);
        Ok(Self { geometry, dropped: Window { t0, t1: t0.saturating_add(dropped) } })
    }

    /// The stretch.
    pub const fn dropped(&self) -> Window {
        self.dropped
    }
}

impl Transform for DropByTime {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        keep_by_time(block, self.geometry, self.dropped, false)
    }
}
