//! Dead pixels.

use super::chance::Chance;
use super::{ChanceParams, Kind, Seed};
use crate::random::Random;
use crate::transform::{TransformError, select};
use crate::{Block, Event, Geometry, Transform, Unfit};

/// Drops all events of each pixel with probability p. Takes no memory: whether a pixel is dead is worked out anew.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform};
/// use lobula_core::augmentation::{ChanceParams, PixelDropout, Seed};
/// let geometry = Geometry::new(100, 1);
/// let mut dropout = PixelDropout::try_new(geometry, ChanceParams { p: 0.1 }, Seed { seed: 7, slice: 3 })?;
/// let mut events: Vec<_> = (0..1000).map(|t| Event::new(t, t as u16 % 100, 0, Polarity::On)).collect();
/// let left = dropout.apply(&mut Block::new(0, 999, geometry, &mut events))?;
/// assert!(left % 10 == 0 && (800..1000).contains(&left));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct PixelDropout {
    geometry: Geometry,
    chance: Chance,
    random: Random,
}

impl PixelDropout {
    /// For a slice of a sensor's events.
    pub fn try_new(geometry: Geometry, params: ChanceParams, seed: Seed) -> Result<Self, TransformError> {
        Ok(Self { geometry, chance: Chance::try_new(params)?, random: seed.random(Kind::PixelDropout) })
    }
}

impl Transform for PixelDropout {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let (chance, random, geometry) = (self.chance, self.random.clone(), self.geometry);
        Ok(select(
            block,
            geometry,
            geometry,
            #[inline(always)]
            move |word, _| {
                let event = Event::from_word(word);
                (word, !chance.hits(random.at(geometry.index(event.x(), event.y()) as u64)))
            },
        )?)
    }
}
