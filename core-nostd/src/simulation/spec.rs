//! What a synthetic camera is made from.

use crate::Geometry;

/// A synthetic scene in numbers. The same spec gives the same events, bit for bit, on every machine.
///
/// ```
/// use lobula_core::simulation::SceneSpec;
/// let spec = SceneSpec { rate_evs: 10_000_000, ..SceneSpec::default() };
/// assert!(spec.check().is_ok());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct SceneSpec {
    /// The sensor's size; at most 2048x2048, at least 32x32. Default 1280x720.
    pub geometry: Geometry,
    /// Chooses the scene and its noise. Default 1.
    pub seed: u64,
    /// Events per second, signal and noise together; the scene moves as fast as that takes. 10 thousand to 50 million;
    /// default 1 million.
    pub rate_evs: u32,
    /// Leak of a pixel in thousandths of an event per second: lone ON events. Default 50.
    pub leak_mhz: u32,
    /// Shot noise of a pixel in thousandths of an event per second: lone events of either polarity. Default 250.
    pub shot_mhz: u32,
    /// Number of hot pixels. Default 20, at most 10 thousand.
    pub hot_pixels: u32,
    /// Events per second of a hot pixel. Default 1000.
    pub hot_hz: u32,
    /// Largest share of noise in the rate, in percent: beyond it all three kinds are scaled down, as more light would.
    /// Default 30, at most 90.
    pub noise_percent_max: u32,
}

impl Default for SceneSpec {
    fn default() -> Self {
        Self {
            geometry: Geometry::new(1280, 720),
            seed: 1,
            rate_evs: 1_000_000,
            leak_mhz: 50,
            shot_mhz: 250,
            hot_pixels: 20,
            hot_hz: 1000,
            noise_percent_max: 30,
        }
    }
}

impl SceneSpec {
    /// Whether a scene can be made from it.
    pub const fn check(&self) -> Result<(), SpecError> {
        let Geometry { width, height } = self.geometry;
        if width < 32 || height < 32 || width > 2048 || height > 2048 {
            return Err(SpecError::Geometry(self.geometry));
        }
        if self.rate_evs < 10_000 || self.rate_evs > 50_000_000 {
            return Err(SpecError::Rate(self.rate_evs));
        }
        if self.hot_pixels > 10_000 {
            return Err(SpecError::HotPixels(self.hot_pixels));
        }
        if self.noise_percent_max > 90 {
            return Err(SpecError::NoisePercent(self.noise_percent_max));
        }
        Ok(())
    }
}

/// Why no scene can be made from a spec.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpecError {
    /// The sensor is too small or too large.
    Geometry(Geometry),
    /// The rate is out of range.
    Rate(u32),
    /// Too many hot pixels.
    HotPixels(u32),
    /// Too much noise.
    NoisePercent(u32),
}

impl core::fmt::Display for SpecError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Geometry(geometry) => {
                write!(f, "a synthetic sensor of {geometry} is out of range: give 32x32 to 2048x2048")
            }
            Self::Rate(rate) => {
                write!(f, "a rate of {rate} events per second is out of range: give 10000 to 50000000")
            }
            Self::HotPixels(n) => write!(f, "{n} hot pixels are out of range: give at most 10000"),
            Self::NoisePercent(n) => write!(f, "{n} percent of noise is out of range: give at most 90"),
        }
    }
}

impl core::error::Error for SpecError {}
