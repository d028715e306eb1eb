//! A change of the whole slice, or none.

use super::chance::Chance;
use super::{ChanceParams, Kind, Seed};
use crate::transform::{FlipX, FlipY, InvertPolarity, TransformError};
use crate::{Block, Geometry, Transform, Unfit};

/// A transform that is done to a slice, or is not: that is settled when it is made.
#[derive(Clone, Debug)]
pub struct Sometimes<T> {
    geometry: Geometry,
    transform: Option<T>,
}

impl<T> Sometimes<T> {
    fn of(
        geometry: Geometry,
        params: ChanceParams,
        seed: Seed,
        kind: Kind,
        transform: T,
    ) -> Result<Self, TransformError> {
        let fires = Chance::try_new(params)?.hits(seed.random(kind).next());
        Ok(Self { geometry, transform: fires.then_some(transform) })
    }

    /// Whether it is done to this slice.
    pub const fn fires(&self) -> bool {
        self.transform.is_some()
    }
}

impl<T: Transform> Transform for Sometimes<T> {
    fn output_geometry(&self) -> Geometry {
        self.transform.as_ref().map_or(self.geometry, T::output_geometry)
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        match &mut self.transform {
            Some(transform) => transform.apply(block),
            None => Ok(self.geometry.check(block.geometry).map(|()| block.len())?),
        }
    }
}

/// [`FlipX`] with probability p.
///
/// ```
/// use lobula_core::{Geometry, augmentation::{ChanceParams, RandomFlipX, Seed}};
/// let flips = |slice| RandomFlipX::try_new(Geometry::new(640, 480), ChanceParams { p: 0.25 }, Seed { seed: 7, slice });
/// let count = (0..1000).filter(|slice| flips(*slice).is_ok_and(|flip| flip.fires())).count();
/// assert!((200..300).contains(&count));
/// ```
pub type RandomFlipX = Sometimes<FlipX>;

/// [`FlipY`] with probability p.
pub type RandomFlipY = Sometimes<FlipY>;

/// [`InvertPolarity`] with probability p: of the whole slice, as of a scene lit the other way round.
pub type RandomPolarityFlip = Sometimes<InvertPolarity>;

impl RandomFlipX {
    /// For a slice of a sensor's events.
    pub fn try_new(geometry: Geometry, params: ChanceParams, seed: Seed) -> Result<Self, TransformError> {
        Self::of(geometry, params, seed, Kind::FlipX, FlipX::new(geometry))
    }
}

impl RandomFlipY {
    /// For a slice of a sensor's events.
    pub fn try_new(geometry: Geometry, params: ChanceParams, seed: Seed) -> Result<Self, TransformError> {
        Self::of(geometry, params, seed, Kind::FlipY, FlipY::new(geometry))
    }
}

impl RandomPolarityFlip {
    /// For a slice of a sensor's events.
    pub fn try_new(geometry: Geometry, params: ChanceParams, seed: Seed) -> Result<Self, TransformError> {
        Self::of(geometry, params, seed, Kind::PolarityFlip, InvertPolarity::new(geometry))
    }
}
