//! Fewer events.

use super::chance::Chance;
use super::{ChanceParams, Kind, Seed};
use crate::random::Random;
use crate::transform::{TransformError, select};
use crate::{Block, Geometry, Transform, Unfit};

/// Drops each event with probability p, whatever becomes of the others (Random Drop of Gu et al. 2021, EventDrop,
/// 10.24963/ijcai.2021/97).
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform};
/// use lobula_core::augmentation::{ChanceParams, EventDrop, Seed};
/// let geometry = Geometry::new(640, 480);
/// let drop = || EventDrop::try_new(geometry, ChanceParams { p: 0.5 }, Seed { seed: 7, slice: 3 });
/// let events: Vec<_> = (0..1000).map(|t| Event::new(t, 1, 2, Polarity::On)).collect();
/// let (mut once, mut again) = (events.clone(), events);
/// let left = drop()?.apply(&mut Block::new(0, 999, geometry, &mut once))?;
/// assert!((450..550).contains(&left));
/// assert_eq!(drop()?.apply(&mut Block::new(0, 999, geometry, &mut again))?, left);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct EventDrop {
    geometry: Geometry,
    chance: Chance,
    random: Random,
    seen: u64,
}

impl EventDrop {
    /// For a slice of a sensor's events.
    pub fn try_new(geometry: Geometry, params: ChanceParams, seed: Seed) -> Result<Self, TransformError> {
        Ok(Self { geometry, chance: Chance::try_new(params)?, random: seed.random(Kind::EventDrop), seen: 0 })
    }
}

impl Transform for EventDrop {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let (seen, len) = (self.seen, block.len() as u64);
        let (chance, random) = (self.chance, self.random.clone());
        let left = select(
            block,
            self.geometry,
            self.geometry,
            #[inline(always)]
            move |word, i| (word, !chance.hits(random.at(seen.wrapping_add(i as u64)))),
        )?;
        self.seen = seen.wrapping_add(len);
        Ok(left)
    }
}
