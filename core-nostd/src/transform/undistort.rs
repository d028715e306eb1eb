//! Undistortion: events where an ideal pinhole camera would have seen them.
//!
//! A lens moves the ideal point (a, b) on the plane at distance 1 to another, the camera sees it at pixel
//! (fx x + cx, fy y + cy). [`Undistort`] goes back, for each pixel once, into a table.

use super::{Remap, TransformError};
use crate::math::{sqrt_f64, tan_f64};
use crate::{Block, Geometry, Transform, Unfit};

/// A camera whose lens bends as Brown (1971) and Conrady (1919) tell, which OpenCV calls its plain model:
///
/// x = a (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 a b + p2 (r² + 2 a²), y = b (...) + p1 (r² + 2 b²) + 2 p2 a b, r² = a² + b².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct BrownConrady {
    /// Focal length in columns.
    pub fx: f64,
    /// Focal length in rows.
    pub fy: f64,
    /// Column of the optical axis.
    pub cx: f64,
    /// Row of the optical axis.
    pub cy: f64,
    /// Radial, second power.
    #[cfg_attr(feature = "serde", serde(default))]
    pub k1: f64,
    /// Radial, fourth power.
    #[cfg_attr(feature = "serde", serde(default))]
    pub k2: f64,
    /// Tangential, along rows.
    #[cfg_attr(feature = "serde", serde(default))]
    pub p1: f64,
    /// Tangential, along columns.
    #[cfg_attr(feature = "serde", serde(default))]
    pub p2: f64,
    /// Radial, sixth power.
    #[cfg_attr(feature = "serde", serde(default))]
    pub k3: f64,
}

/// A fisheye camera as Kannala and Brandt (2006, 10.1109/TPAMI.2006.153) tell, with OpenCV's coefficients: a ray at
/// angle θ from the axis is seen at radius θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Fisheye {
    /// Focal length in columns.
    pub fx: f64,
    /// Focal length in rows.
    pub fy: f64,
    /// Column of the optical axis.
    pub cx: f64,
    /// Row of the optical axis.
    pub cy: f64,
    /// Second power.
    #[cfg_attr(feature = "serde", serde(default))]
    pub k1: f64,
    /// Fourth power.
    #[cfg_attr(feature = "serde", serde(default))]
    pub k2: f64,
    /// Sixth power.
    #[cfg_attr(feature = "serde", serde(default))]
    pub k3: f64,
    /// Eighth power.
    #[cfg_attr(feature = "serde", serde(default))]
    pub k4: f64,
}

/// A camera and its lens.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "model", rename_all = "snake_case"))]
#[non_exhaustive]
pub enum CameraModel {
    /// A lens of small or middling angle.
    BrownConrady(BrownConrady),
    /// A fisheye.
    Fisheye(Fisheye),
}

/// Steps of the iteration that goes back through the lens, as many as eventcv takes.
const STEPS: u32 = 20;

impl BrownConrady {
    /// Where pixel (u, v) would be without the lens: 20 steps of (a, b) = ((x, y) - tangential) / radial, from (x, y).
    pub fn undistorted(&self, u: f64, v: f64) -> (f64, f64) {
        let Self { fx, fy, cx, cy, k1, k2, p1, p2, k3 } = *self;
        let (x, y) = ((u - cx) / fx, (v - cy) / fy);
        let (mut a, mut b) = (x, y);
        for _ in 0..STEPS {
            let r2 = a * a + b * b;
            let radial = 1.0 + ((k3 * r2 + k2) * r2 + k1) * r2;
            let across = 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a);
            let down = p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b;
            (a, b) = ((x - across) / radial, (y - down) / radial);
        }
        (a * fx + cx, b * fy + cy)
    }
}

impl Fisheye {
    /// Where pixel (u, v) would be without the lens: 20 of Newton's steps to the angle θ, then its tangent. No number for
    /// a ray at 90° or more from the axis, which no plane before the camera meets.
    pub fn undistorted(&self, u: f64, v: f64) -> (f64, f64) {
        let Self { fx, fy, cx, cy, k1, k2, k3, k4 } = *self;
        let (x, y) = ((u - cx) / fx, (v - cy) / fy);
        let radius = sqrt_f64(x * x + y * y);
        let mut angle = radius;
        for _ in 0..STEPS {
            let t2 = angle * angle;
            let seen = angle * (1.0 + (((k4 * t2 + k3) * t2 + k2) * t2 + k1) * t2);
            let slope = 1.0 + (((9.0 * k4 * t2 + 7.0 * k3) * t2 + 5.0 * k2) * t2 + 3.0 * k1) * t2;
            angle -= (seen - radius) / slope;
        }
        // Near the axis radius and tangent are both next to nothing, and one.
        let stretch = match angle {
            angle if radius < 1e-12 && angle < 1e-6 => 1.0,
            angle if angle > 0.0 && angle < core::f64::consts::FRAC_PI_2 => tan_f64(angle) / radius,
            _ => f64::NAN,
        };
        (x * stretch * fx + cx, y * stretch * fy + cy)
    }
}

impl CameraModel {
    /// Where pixel (u, v) would be without the lens.
    pub fn undistorted(&self, u: f64, v: f64) -> (f64, f64) {
        match self {
            Self::BrownConrady(camera) => camera.undistorted(u, v),
            Self::Fisheye(camera) => camera.undistorted(u, v),
        }
    }

    fn check(&self) -> Result<(), TransformError> {
        let (fx, fy, rest) = match *self {
            Self::BrownConrady(BrownConrady { fx, fy, cx, cy, k1, k2, p1, p2, k3 }) => {
                (fx, fy, [cx, cy, k1, k2, p1, p2, k3])
            }
            Self::Fisheye(Fisheye { fx, fy, cx, cy, k1, k2, k3, k4 }) => {
                (fx, fy, [cx, cy, k1, k2, k3, k4, 0.0])
            }
        };
        for (key, focal) in [("fx", fx), ("fy", fy)] {
            if !(focal > 0.0 && focal.is_finite()) {
                return Err(TransformError::OutOfRange {
                    key,
                    range: "a focal length in pixels, more than 0",
                });
            }
        }
        match rest.iter().all(|number| number.is_finite()) {
            true => Ok(()),
            false => Err(TransformError::NotFinite { key: "a coefficient of the camera" }),
        }
    }
}

/// Moves events to where the same camera without its lens's distortion would have seen them, rounded; drops what is off
/// the sensor there. The table is computed once and takes 4 bytes a pixel.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform};
/// use lobula_core::transform::{BrownConrady, CameraModel, Undistort};
/// let geometry = Geometry::new(640, 480);
/// let lens = BrownConrady { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, k1: -0.3, ..BrownConrady::default() };
/// let memory = vec![0; Undistort::<()>::required_len(geometry)];
/// let mut undistort = Undistort::try_new(geometry, CameraModel::BrownConrady(lens), memory)?;
/// let mut events = [Event::new(0, 420, 240, Polarity::On)];
/// let mut block = Block::new(0, 0, geometry, &mut events);
/// assert_eq!(undistort.apply(&mut block)?, 1);
/// assert_eq!((block.span().events[0].x(), block.span().events[0].y()), (421, 240));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Undistort<S>(Remap<S>);

impl<S> Undistort<S> {
    /// Entries of memory it needs.
    pub const fn required_len(geometry: Geometry) -> usize {
        Remap::<S>::required_len(geometry)
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Undistort<S> {
    /// Computes the table for a camera, in `memory` of at least [`required_len`](Self::required_len) entries.
    pub fn try_new(geometry: Geometry, camera: CameraModel, memory: S) -> Result<Self, TransformError> {
        camera.check()?;
        Remap::try_new(geometry, memory, |u, v| camera.undistorted(u, v)).map(Self)
    }
}

impl<S: AsRef<[u32]>> Transform for Undistort<S> {
    fn output_geometry(&self) -> Geometry {
        self.0.output_geometry()
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        self.0.apply(block)
    }
}
