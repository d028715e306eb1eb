//! Transforms: each moves the events of a block in place, to other pixels, times or polarities.
//!
//! | kind | pixel, time or polarity after it | sensor after it |
//! |---|---|---|
//! | [`Crop`] | x - x0, y - y0 | width x height |
//! | [`FlipX`], [`FlipY`] | W - 1 - x; H - 1 - y | W x H |
//! | [`Rotate90`] | k quarter turns clockwise; one: H - 1 - y, x | H x W for odd k |
//! | [`Transpose`] | y, x | H x W |
//! | [`Translate`] | x + dx, y + dy | W x H |
//! | [`Resize`], [`Scale`] | floor(x w / W), floor(y h / H) | w x h |
//! | [`Affine`] | round(a x + b y + c), round(d x + e y + f) | W x H |
//! | [`Perspective`] | the same, divided by g x + h y + i | W x H |
//! | [`Undistort`] | where the pixel would be without the lens's distortion, rounded | W x H |
//! | [`InvertPolarity`] | ON for OFF and OFF for ON | W x H |
//! | [`TimeShift`] | t + dt | W x H |
//! | [`TimeScale`] | round(t f) | W x H |
//! | [`TimeWindow`] | those with t0 <= t < t1 | W x H |
//! | [`NormalizeTime`] | t - time of the first event | W x H |
//!
//! Every transform is made for a sensor's size; what is in real numbers is computed in f64 by `+ - * /` alone and
//! rounded half away from zero, so that every machine gives the same bits. Events that leave the sensor, or time, are
//! dropped: how many is told by what [`apply`](crate::Transform::apply) returns, in a chain by its counts. Formulas are those
//! of eventcv 1.0, whose outcome is compared in `tests/parity`. What needs the whole slice is in [`slice`](crate::slice).

mod affine;
mod crop;
mod flip;
mod invert_polarity;
mod normalize_time;
mod perspective;
mod pixels;
mod real;
mod remap;
mod resize;
mod rotate90;
mod time_scale;
mod time_shift;
mod time_window;
mod translate;
mod transpose;
mod undistort;

pub use affine::{Affine, AffineParams};
pub use crop::{Crop, CropParams};
pub use flip::{FlipX, FlipY};
pub use invert_polarity::InvertPolarity;
pub use normalize_time::NormalizeTime;
pub use perspective::{Perspective, PerspectiveParams};
pub(crate) use pixels::{at_time, select};
pub(crate) use real::place_near;
pub use remap::Remap;
pub use resize::{Resize, ResizeParams, Scale, ScaleParams};
pub use rotate90::{Rotate90, Rotate90Params};
pub use time_scale::{TimeScale, TimeScaleParams};
pub use time_shift::{TimeShift, TimeShiftParams};
pub(crate) use time_window::keep_by_time;
pub use time_window::{TimeWindow, TimeWindowParams};
pub use translate::{Translate, TranslateParams};
pub use transpose::Transpose;
pub use undistort::{BrownConrady, CameraModel, Fisheye, Undistort};

/// The registry: every transform. Calls `$then!` with the list, from which the host's
/// [`AnyTransform`](crate::chain::AnyTransform) and the exports of the no-panic proof are made.
///
/// Each line: name, name of a module, type (where `S` stands for its storage), parameters, words of u32 memory needed
/// as a function of the [`Geometry`](crate::Geometry), and how to make it of geometry, parameters and memory (a
/// `Result` with [`TransformError`](crate::transform::TransformError)).
#[macro_export]
macro_rules! transforms {
    ($then:ident) => {
        $then! {
            Crop crop: $crate::transform::Crop, $crate::transform::CropParams,
                |_| 0, |geometry, params, _| $crate::transform::Crop::try_new(geometry, params);
            FlipX flip_x: $crate::transform::FlipX, $crate::transform::NoParams,
                |_| 0, |geometry, _, _| Ok($crate::transform::FlipX::new(geometry));
            FlipY flip_y: $crate::transform::FlipY, $crate::transform::NoParams,
                |_| 0, |geometry, _, _| Ok($crate::transform::FlipY::new(geometry));
            Rotate90 rotate90: $crate::transform::Rotate90, $crate::transform::Rotate90Params,
                |_| 0, |geometry, params, _| $crate::transform::Rotate90::try_new(geometry, params);
            Transpose transpose: $crate::transform::Transpose, $crate::transform::NoParams,
                |_| 0, |geometry, _, _| $crate::transform::Transpose::try_new(geometry);
            Translate translate: $crate::transform::Translate, $crate::transform::TranslateParams,
                |_| 0, |geometry, params, _| Ok($crate::transform::Translate::new(geometry, params));
            Resize resize: $crate::transform::Resize, $crate::transform::ResizeParams,
                |_| 0, |geometry, params, _| $crate::transform::Resize::try_new(geometry, params);
            Scale scale: $crate::transform::Scale, $crate::transform::ScaleParams,
                |_| 0, |geometry, params, _| $crate::transform::Scale::try_new(geometry, params);
            Affine affine: $crate::transform::Affine, $crate::transform::AffineParams,
                |_| 0, |geometry, params, _| $crate::transform::Affine::try_new(geometry, params);
            Perspective perspective: $crate::transform::Perspective, $crate::transform::PerspectiveParams,
                |_| 0, |geometry, params, _| $crate::transform::Perspective::try_new(geometry, params);
            Undistort undistort: $crate::transform::Undistort<S>, $crate::transform::CameraModel,
                $crate::transform::Undistort::<()>::required_len, $crate::transform::Undistort::try_new;
            InvertPolarity invert_polarity: $crate::transform::InvertPolarity, $crate::transform::NoParams,
                |_| 0, |geometry, _, _| Ok($crate::transform::InvertPolarity::new(geometry));
            TimeShift time_shift: $crate::transform::TimeShift, $crate::transform::TimeShiftParams,
                |_| 0, |geometry, params, _| Ok($crate::transform::TimeShift::new(geometry, params));
            TimeScale time_scale: $crate::transform::TimeScale, $crate::transform::TimeScaleParams,
                |_| 0, |geometry, params, _| $crate::transform::TimeScale::try_new(geometry, params);
            TimeWindow time_window: $crate::transform::TimeWindow, $crate::transform::TimeWindowParams,
                |_| 0, |geometry, params, _| $crate::transform::TimeWindow::try_new(geometry, params);
            NormalizeTime normalize_time: $crate::transform::NormalizeTime, $crate::transform::NoParams,
                |_| 0, |geometry, _, _| Ok($crate::transform::NormalizeTime::new(geometry));
        }
    };
}

use crate::Geometry;

/// Parameters of what has none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct NoParams {}

/// Why a transform, an augmentation or a slice operation cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransformError {
    /// The sensor after it would have no pixel.
    NoPixel,
    /// The sensor after it would be larger than events can tell.
    SensorTooLarge,
    /// A parameter is not a finite number.
    NotFinite {
        /// Its name in settings.
        key: &'static str,
    },
    /// A parameter must lie in a range and does not.
    OutOfRange {
        /// Its name in settings.
        key: &'static str,
        /// What it may be, in words.
        range: &'static str,
    },
    /// Its memory is too short.
    MemoryTooShort {
        /// Elements needed.
        needed: usize,
        /// Elements given.
        found: usize,
    },
}

impl core::fmt::Display for TransformError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NoPixel => f.write_str("no pixel would be left: give a width and a height of at least 1"),
            Self::SensorTooLarge => {
                f.write_str("the sensor would be too large: at most 65535 columns and 32768 rows")
            }
            Self::NotFinite { key } => write!(f, "{key} is not a finite number: give one"),
            Self::OutOfRange { key, range } => write!(f, "{key} is out of range: give {range}"),
            Self::MemoryTooShort { needed, found } => {
                write!(f, "memory of {found} elements is too short: give {needed}")
            }
        }
    }
}

impl core::error::Error for TransformError {}

/// Most rows of a sensor, since an event keeps 15 bits of y.
const HEIGHT_MAX: u16 = 1 << 15;

/// A sensor of this size, if events can be on it.
pub(crate) const fn sensor(width: u32, height: u32) -> Result<Geometry, TransformError> {
    if width == 0 || height == 0 {
        Err(TransformError::NoPixel)
    } else if width > u16::MAX as u32 || height > HEIGHT_MAX as u32 {
        Err(TransformError::SensorTooLarge)
    } else {
        Ok(Geometry::new(width as u16, height as u16))
    }
}
