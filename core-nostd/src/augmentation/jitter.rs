//! Jitter of pixels and of times.

use super::normal::{LARGEST, normal};
use super::{Kind, Seed};
use crate::random::Random;
use crate::transform::{TransformError, at_time, place_near, select};
use crate::{Block, Geometry, SPAN_MAX_US, Transform, Unfit};

/// Parameters of [`SpatialJitter`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct SpatialJitterParams {
    /// Standard deviation in pixels, along each side; 0 to 65535.
    pub sigma_px: f64,
}

/// Moves each event by normal deviates in x and y, rounded, and drops what leaves the sensor.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform};
/// use lobula_core::augmentation::{Seed, SpatialJitter, SpatialJitterParams};
/// let geometry = Geometry::new(640, 480);
/// let params = SpatialJitterParams { sigma_px: 2.0 };
/// let mut jitter = SpatialJitter::try_new(geometry, params, Seed { seed: 7, slice: 3 })?;
/// let mut events: Vec<_> = (0..1000).map(|t| Event::new(t, 300, 200, Polarity::On)).collect();
/// assert_eq!(jitter.apply(&mut Block::new(0, 999, geometry, &mut events))?, 1000);
/// assert!(events.iter().all(|event| event.x().abs_diff(300) <= 16 && event.y().abs_diff(200) <= 16));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SpatialJitter {
    geometry: Geometry,
    sigma: f64,
    random: Random,
    seen: u64,
}

impl SpatialJitter {
    /// For a slice of a sensor's events.
    pub fn try_new(
        geometry: Geometry,
        params: SpatialJitterParams,
        seed: Seed,
    ) -> Result<Self, TransformError> {
        let sigma = params.sigma_px;
        match (0.0..=65_535.0).contains(&sigma) {
            true => Ok(Self { geometry, sigma, random: seed.random(Kind::SpatialJitter), seen: 0 }),
            false => Err(TransformError::OutOfRange { key: "sigma_px", range: "0 to 65535" }),
        }
    }
}

impl Transform for SpatialJitter {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let (seen, len) = (self.seen, block.len() as u64);
        let (sigma, random, geometry) = (self.sigma, self.random.clone(), self.geometry);
        let left = select(
            block,
            geometry,
            geometry,
            #[inline(always)]
            move |word, i| {
                let n = seen.wrapping_add(i as u64).wrapping_mul(3);
                let fill = random.at(n);
                let dx = sigma * normal(random.at(n.wrapping_add(1)), fill as u32);
                let dy = sigma * normal(random.at(n.wrapping_add(2)), (fill >> 32) as u32);
                place_near(word, (dx, dy), geometry)
            },
        )?;
        self.seen = seen.wrapping_add(len);
        Ok(left)
    }
}

/// Parameters of [`TimeJitter`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct TimeJitterParams {
    /// Standard deviation in µs, 0 to 10^7.
    pub sigma_us: f64,
}

/// Moves each event in time by a normal deviate, rounded, at most 8.21 standard deviations; what comes before time 0 is
/// dropped. Events stay in their order and so are no longer in that of time: where it matters,
/// [`SliceSort`](crate::slice::SliceSort) them.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform};
/// use lobula_core::augmentation::{Seed, TimeJitter, TimeJitterParams};
/// let geometry = Geometry::new(640, 480);
/// let mut jitter = TimeJitter::try_new(geometry, TimeJitterParams { sigma_us: 10.0 }, Seed { seed: 7, slice: 3 })?;
/// let mut events: Vec<_> = (0..100).map(|i| Event::new(1000 + i, 1, 2, Polarity::On)).collect();
/// assert_eq!(jitter.apply(&mut Block::new(1000, 1099, geometry, &mut events))?, 100);
/// assert!(events.iter().enumerate().all(|(i, event)| event.t().abs_diff(1000 + i as u32) <= 83));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct TimeJitter {
    geometry: Geometry,
    sigma: f64,
    random: Random,
    seen: u64,
}

impl TimeJitter {
    /// For a slice of a sensor's events.
    pub fn try_new(geometry: Geometry, params: TimeJitterParams, seed: Seed) -> Result<Self, TransformError> {
        let sigma = params.sigma_us;
        match (0.0..=1e7).contains(&sigma) {
            true => Ok(Self { geometry, sigma, random: seed.random(Kind::TimeJitter), seen: 0 }),
            false => Err(TransformError::OutOfRange { key: "sigma_us", range: "0 to 10000000" }),
        }
    }
}

impl Transform for TimeJitter {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn reach_max(&self, after: u64) -> u64 {
        after.saturating_sub((self.sigma * LARGEST) as u64 + 1)
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        self.geometry.check(block.geometry)?;
        let reach_max = self.reach_max(SPAN_MAX_US - 1);
        if block.span().reach() > reach_max {
            return Err(Unfit::Reach { reach_max });
        }
        let (seen, len, anchor) = (self.seen, block.len() as u64, block.t_first);
        let before_anchor = -(anchor.min(SPAN_MAX_US) as i64);
        let (sigma, random) = (self.sigma, self.random.clone());
        let left = select(
            block,
            self.geometry,
            self.geometry,
            #[inline(always)]
            move |word, i| {
                let n = seen.wrapping_add(i as u64).wrapping_mul(2);
                let dt = rounded(sigma * normal(random.at(n), random.at(n.wrapping_add(1)) as u32));
                let offset = i64::from((word as u32).wrapping_sub(anchor as u32) as i32) + i64::from(dt);
                (at_time(word, (word as u32).wrapping_add(dt as u32)), offset >= before_anchor)
            },
        )?;
        self.seen = seen.wrapping_add(len);
        Ok(left)
    }
}

/// The nearest whole number, halves away from zero.
#[inline(always)]
fn rounded(value: f64) -> i32 {
    (value + if value < 0.0 { -0.5 } else { 0.5 }) as i32
}
