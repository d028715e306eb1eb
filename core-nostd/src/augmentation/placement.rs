//! The slice elsewhere: turned, shifted, or a part of it.

use super::{Kind, Seed};
use crate::math::sin_cos_f64;
use crate::random::Random;
use crate::transform::{Affine, AffineParams, Crop, CropParams, TransformError, Translate, TranslateParams};
use crate::{Block, Geometry, Transform, Unfit};

/// Parameters of [`RandomRotation`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct RandomRotationParams {
    /// Largest angle, in degrees, either way; 0 to 180.
    pub degrees_max: f64,
}

/// Turns the slice about the middle of the sensor, by an angle of -max to max, and drops what leaves the sensor.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform};
/// use lobula_core::augmentation::{RandomRotation, RandomRotationParams, Seed};
/// let geometry = Geometry::new(641, 481);
/// let params = RandomRotationParams { degrees_max: 15.0 };
/// let mut rotation = RandomRotation::try_new(geometry, params, Seed { seed: 7, slice: 3 })?;
/// let mut events = [Event::new(0, 320, 240, Polarity::On)];
/// rotation.apply(&mut Block::new(0, 0, geometry, &mut events))?;
/// assert_eq!(events, [Event::new(0, 320, 240, Polarity::On)]); // the middle stays
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct RandomRotation(Affine);

impl RandomRotation {
    /// For a slice of a sensor's events.
    pub fn try_new(
        geometry: Geometry,
        params: RandomRotationParams,
        seed: Seed,
    ) -> Result<Self, TransformError> {
        let degrees_max = params.degrees_max;
        if !(0.0..=180.0).contains(&degrees_max) {
            return Err(TransformError::OutOfRange { key: "degrees_max", range: "0 to 180" });
        }
        let angle = symmetric(&mut seed.random(Kind::Rotation)) * degrees_max;
        let (sin, cos) = sin_cos_f64(angle * (core::f64::consts::PI / 180.0));
        let middle = |len: u16| (f64::from(len) - 1.0) / 2.0;
        let (x, y) = (middle(geometry.width), middle(geometry.height));
        let matrix = [[cos, -sin, x - cos * x + sin * y], [sin, cos, y - sin * x - cos * y]];
        Affine::try_new(geometry, AffineParams { matrix }).map(Self)
    }
}

impl Transform for RandomRotation {
    fn output_geometry(&self) -> Geometry {
        self.0.output_geometry()
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        self.0.apply(block)
    }
}

/// Uniform in -1..1.
fn symmetric(random: &mut Random) -> f64 {
    (random.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Parameters of [`RandomTranslation`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct RandomTranslationParams {
    /// Most columns, either way.
    pub dx_max: u16,
    /// Most rows, either way.
    pub dy_max: u16,
}

/// Moves the slice by -max to max whole pixels in x and y, each as likely, and drops what leaves the sensor.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform};
/// use lobula_core::augmentation::{RandomTranslation, RandomTranslationParams, Seed};
/// let geometry = Geometry::new(640, 480);
/// let params = RandomTranslationParams { dx_max: 20, dy_max: 0 };
/// let mut translation = RandomTranslation::try_new(geometry, params, Seed { seed: 7, slice: 3 })?;
/// let mut events = [Event::new(0, 320, 240, Polarity::On)];
/// translation.apply(&mut Block::new(0, 0, geometry, &mut events))?;
/// assert!(events[0].x().abs_diff(320) <= 20 && events[0].y() == 240);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct RandomTranslation(Translate);

impl RandomTranslation {
    /// For a slice of a sensor's events.
    pub fn try_new(
        geometry: Geometry,
        params: RandomTranslationParams,
        seed: Seed,
    ) -> Result<Self, TransformError> {
        let mut random = seed.random(Kind::Translation);
        let mut offset = |max: u16| random.between(-i32::from(max), i32::from(max));
        let (dx, dy) = (offset(params.dx_max), offset(params.dy_max));
        Ok(Self(Translate::new(geometry, TranslateParams { dx, dy })))
    }
}

impl Transform for RandomTranslation {
    fn output_geometry(&self) -> Geometry {
        self.0.output_geometry()
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        self.0.apply(block)
    }
}

/// Parameters of [`RandomCrop`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct RandomCropParams {
    /// Columns; as many as there are, where the sensor has fewer.
    pub width: u16,
    /// Rows; as many as there are, where the sensor has fewer.
    pub height: u16,
}

/// Crops to a rectangle of that size anywhere on the sensor, each as likely.
///
/// ```
/// use lobula_core::{Geometry, Transform};
/// use lobula_core::augmentation::{RandomCrop, RandomCropParams, Seed};
/// let params = RandomCropParams { width: 128, height: 1000 };
/// let crop = RandomCrop::try_new(Geometry::new(640, 480), params, Seed { seed: 7, slice: 3 })?;
/// assert_eq!(crop.output_geometry(), Geometry::new(128, 480));
/// # Ok::<(), lobula_core::transform::TransformError>(())
/// ```
#[derive(Clone, Debug)]
pub struct RandomCrop(Crop);

impl RandomCrop {
    /// For a slice of a sensor's events.
    pub fn try_new(geometry: Geometry, params: RandomCropParams, seed: Seed) -> Result<Self, TransformError> {
        let mut random = seed.random(Kind::Crop);
        let mut side = |len: u16, side: u16| {
            let side = side.min(len);
            (random.below(u32::from(len - side) + 1) as i32, side)
        };
        let (x, width) = side(geometry.width, params.width);
        let (y, height) = side(geometry.height, params.height);
        Crop::try_new(geometry, CropParams { x, y, width, height }).map(Self)
    }
}

impl Transform for RandomCrop {
    fn output_geometry(&self) -> Geometry {
        self.0.output_geometry()
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        self.0.apply(block)
    }
}
