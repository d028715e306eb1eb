//! A rectangle without events.

use super::chance::ratio;
use super::{Kind, Seed};
use crate::transform::{TransformError, select};
use crate::{Block, Event, Geometry, Transform, Unfit};

/// Parameters of [`DropByArea`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct DropByAreaParams {
    /// Share of each side of the sensor that the rectangle takes, 0 to 1.
    pub ratio: f64,
}

/// Drops the events of a rectangle, of a given share of each side, anywhere on the sensor (Drop by Area of Gu et al. 2021,
/// EventDrop, 10.24963/ijcai.2021/97, where shares are 0.05 to 0.3).
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform};
/// use lobula_core::augmentation::{DropByArea, DropByAreaParams, Seed};
/// let geometry = Geometry::new(100, 10);
/// let mut drop = DropByArea::try_new(geometry, DropByAreaParams { ratio: 0.5 }, Seed { seed: 7, slice: 3 })?;
/// let mut events: Vec<_> = (0..1000).map(|i| Event::new(i, i as u16 % 100, i as u16 / 100, Polarity::On)).collect();
/// assert_eq!(drop.apply(&mut Block::new(0, 999, geometry, &mut events))?, 750);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct DropByArea {
    geometry: Geometry,
    x: u16,
    y: u16,
    area: Geometry,
}

impl DropByArea {
    /// For a slice of a sensor's events.
    pub fn try_new(geometry: Geometry, params: DropByAreaParams, seed: Seed) -> Result<Self, TransformError> {
        let share = ratio("ratio", params.ratio)?;
        let mut random = seed.random(Kind::DropByArea);
        let side = |len: u16| ((f64::from(len) * share + 0.5) as u16).min(len);
        let area = Geometry::new(side(geometry.width), side(geometry.height));
        let mut start = |len: u16, side: u16| random.below(u32::from(len - side) + 1) as u16;
        let (x, y) = (start(geometry.width, area.width), start(geometry.height, area.height));
        Ok(Self { geometry, x, y, area })
    }
}

impl Transform for DropByArea {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let (x, y, area) = (self.x, self.y, self.area);
        Ok(select(
            block,
            self.geometry,
            self.geometry,
            #[inline(always)]
            move |word, _| {
                let event = Event::from_word(word);
                let (across, down) = (event.x().wrapping_sub(x), event.y().wrapping_sub(y));
                (word, (across >= area.width) | (down >= area.height))
            },
        )?)
    }
}
