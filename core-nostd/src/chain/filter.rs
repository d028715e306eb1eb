//! One stage of a chain: any filter of the registry, in memory of its own.

use super::{ChainCause, transform};
use crate::filter::*;
use crate::transform::{
    AffineParams, CameraModel, CropParams, NoParams, PerspectiveParams, ResizeParams, Rotate90Params,
    ScaleParams, TimeScaleParams, TimeShiftParams, TimeWindowParams, TranslateParams,
};
use crate::{Block, Event, Filter, Geometry, WrongGeometry};
use alloc::boxed::Box;
use alloc::vec::Vec;

/// A stage, which is a filter or a transform, and its parameters.
///
/// A map's `shift` tells its entries: 0 (the default) for `u32` µs, n for `u16` ticks of 2^n µs, which halve the
/// memory and round times down.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum StageSpec {
    /// [`PolarityFilter`].
    Polarity(PolarityParams),
    /// [`RegionOfInterest`].
    RegionOfInterest(RegionParams),
    /// [`HotPixelFilter`].
    HotPixel(HotPixelSpec),
    /// [`Refractory`].
    Refractory(RefractoryParams),
    /// [`BackgroundActivity`].
    BackgroundActivity(BackgroundActivityParams),
    /// [`Denoise`].
    Denoise(DenoiseSpec),
    /// [`DoubleWindow`].
    DoubleWindow(DoubleWindowParams),
    /// [`Stcf`].
    Stcf(StcfParams),
    /// [`MaskFilter`].
    Mask(MaskSpec),
    /// [`LeakyHotPixel`].
    LeakyHotPixel(LeakyHotPixelParams),
    /// [`Trail`].
    Trail(TrailParams),
    /// [`Inceptive`].
    Inceptive(InceptiveParams),
    /// [`AntiFlicker`].
    AntiFlicker(AntiFlickerParams),
    /// [`Decimate`].
    Decimate(DecimateParams),
    /// [`RateLimit`].
    RateLimit(RateLimitParams),

    /// [`Crop`](crate::transform::Crop).
    Crop(CropParams),
    /// [`FlipX`](crate::transform::FlipX).
    FlipX(NoParams),
    /// [`FlipY`](crate::transform::FlipY).
    FlipY(NoParams),
    /// [`Rotate90`](crate::transform::Rotate90).
    Rotate90(Rotate90Params),
    /// [`Transpose`](crate::transform::Transpose).
    Transpose(NoParams),
    /// [`Translate`](crate::transform::Translate).
    Translate(TranslateParams),
    /// [`Resize`](crate::transform::Resize).
    Resize(ResizeParams),
    /// [`Scale`](crate::transform::Scale).
    Scale(ScaleParams),
    /// [`Affine`](crate::transform::Affine).
    Affine(AffineParams),
    /// [`Perspective`](crate::transform::Perspective).
    Perspective(PerspectiveParams),
    /// [`Undistort`](crate::transform::Undistort), with its `model`: `brown_conrady` or `fisheye`.
    Undistort(CameraModel),
    /// [`InvertPolarity`](crate::transform::InvertPolarity).
    InvertPolarity(NoParams),
    /// [`TimeShift`](crate::transform::TimeShift).
    TimeShift(TimeShiftParams),
    /// [`TimeScale`](crate::transform::TimeScale).
    TimeScale(TimeScaleParams),
    /// [`TimeWindow`](crate::transform::TimeWindow).
    TimeWindow(TimeWindowParams),
    /// [`NormalizeTime`](crate::transform::NormalizeTime).
    NormalizeTime(NoParams),
}

/// The pattern of every transform's spec.
macro_rules! any_transform_spec {
    ($($variant:ident $module:ident: $type:ty, $params:ty, $len:expr, $make:expr;)*) => {
        $(StageSpec::$variant(_))|*
    };
}

impl StageSpec {
    /// The kind's name, as in a config file.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Polarity(_) => "polarity",
            Self::RegionOfInterest(_) => "region_of_interest",
            Self::HotPixel(_) => "hot_pixel",
            Self::Refractory(_) => "refractory",
            Self::BackgroundActivity(_) => "background_activity",
            Self::Denoise(_) => "denoise",
            Self::DoubleWindow(_) => "double_window",
            Self::Stcf(_) => "stcf",
            Self::Mask(_) => "mask",
            Self::LeakyHotPixel(_) => "leaky_hot_pixel",
            Self::Trail(_) => "trail",
            Self::Inceptive(_) => "inceptive",
            Self::AntiFlicker(_) => "anti_flicker",
            Self::Decimate(_) => "decimate",
            Self::RateLimit(_) => "rate_limit",
            crate::transforms!(any_transform_spec) => transform::kind(self),
        }
    }

    /// Whether it gives events other times, or blocks: what a live stream's packets must not have.
    pub const fn moves_time(&self) -> bool {
        matches!(self, Self::TimeShift(_) | Self::TimeScale(_) | Self::NormalizeTime(_))
    }
}

macro_rules! any_filter {
    ($($variant:ident $module:ident: $type:ty, $params:ty, $word:ty, $len:expr, $make:expr;)*) => {
        $(mod $module {
            use super::*;
            #[allow(dead_code, reason = "a filter that remembers nothing has no storage")]
            type S = Box<[$word]>;
            pub(super) type Of = $type;

            pub(super) fn make(geometry: Geometry, params: $params) -> Result<AnyFilter, ChainCause> {
                let len: fn(Geometry, &$params) -> usize = $len;
                let make: fn(Geometry, $params, S) -> Result<Of, FilterError> = $make;
                Ok(AnyFilter::$variant(make(geometry, params, memory(len(geometry, &params))?)?))
            }
        })*

        /// Any filter of the [registry](crate::filters), on the heap.
        #[derive(Clone, Debug)]
        #[non_exhaustive]
        #[allow(missing_docs, reason = "each is named by its type")]
        #[allow(private_interfaces, reason = "the names of types of the registry")]
        pub enum AnyFilter {
            $($variant($module::Of),)*
        }

        impl Filter for AnyFilter {
            fn advance(&mut self, now: u64) {
                match self {
                    $(Self::$variant(filter) => filter.advance(now),)*
                }
            }

            fn keep(&mut self, event: Event) -> bool {
                match self {
                    $(Self::$variant(filter) => filter.keep(event),)*
                }
            }

            fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
                match self {
                    $(Self::$variant(filter) => filter.retain(block),)*
                }
            }
        }
    };
}

crate::filters!(any_filter);

impl AnyFilter {
    /// The filter that `spec` describes, for events of this sensor. A transform is none.
    pub fn try_new(spec: &StageSpec, geometry: Geometry) -> Result<Self, ChainCause> {
        match spec {
            StageSpec::Polarity(params) => polarity::make(geometry, *params),
            StageSpec::RegionOfInterest(params) => region_of_interest::make(geometry, *params),
            StageSpec::HotPixel(spec) => {
                check_hot_pixels(&spec.file, spec.sensor, geometry)?;
                hot_pixel::make(geometry, ())?.masking(&spec.pixels, geometry)
            }
            StageSpec::Refractory(params) if params.shift == 0 => refractory_u32::make(geometry, *params),
            StageSpec::Refractory(params) => refractory_u16::make(geometry, *params),
            StageSpec::BackgroundActivity(params) if params.shift == 0 => {
                background_activity_u32::make(geometry, *params)
            }
            StageSpec::BackgroundActivity(params) => background_activity_u16::make(geometry, *params),
            StageSpec::Denoise(spec) => {
                check_hot_pixels(&spec.hot_pixels_file, spec.hot_pixels_sensor, geometry)?;
                let make = if spec.shift == 0 { denoise_u32::make } else { denoise_u16::make };
                make(geometry, spec.params())?.masking(&spec.hot_pixels, geometry)
            }
            StageSpec::DoubleWindow(params) => double_window::make(geometry, *params),
            StageSpec::Stcf(params) if params.shift == 0 => stcf_u32::make(geometry, *params),
            StageSpec::Stcf(params) => stcf_u16::make(geometry, *params),
            StageSpec::Mask(spec) => mask::make(geometry, spec.keep)?.masking(&spec.pixels, geometry),
            StageSpec::LeakyHotPixel(params) => leaky_hot_pixel::make(geometry, *params),
            StageSpec::Trail(params) if params.shift == 0 => trail_u32::make(geometry, *params),
            StageSpec::Trail(params) => trail_u16::make(geometry, *params),
            StageSpec::Inceptive(params) if params.shift == 0 => inceptive_u32::make(geometry, *params),
            StageSpec::Inceptive(params) => inceptive_u16::make(geometry, *params),
            StageSpec::AntiFlicker(params) => anti_flicker::make(geometry, *params),
            StageSpec::Decimate(params) => decimate::make(geometry, *params),
            StageSpec::RateLimit(params) => rate_limit::make(geometry, *params),
            crate::transforms!(any_transform_spec) => Err(ChainCause::NoFilter),
        }
    }
}

impl AnyFilter {
    /// The same with these pixels hot. One off the sensor is an error: the list is of another sensor.
    fn masking(mut self, pixels: &[(u16, u16)], geometry: Geometry) -> Result<Self, ChainCause> {
        let mut mask = |x, y| match &mut self {
            Self::HotPixel(filter) => filter.mask(x, y),
            Self::Mask(filter) => filter.insert(x, y),
            Self::DenoiseU32(filter) => filter.mask(x, y),
            Self::DenoiseU16(filter) => filter.mask(x, y),
            _ => false,
        };
        match pixels.iter().find(|(x, y)| !mask(*x, *y)) {
            Some(&(x, y)) => Err(ChainCause::PixelOffSensor { x, y, geometry }),
            None => Ok(self),
        }
    }
}

/// Settings of a [`HotPixelFilter`].
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HotPixelSpec {
    /// The hot pixels, each `[x, y]`; by default none.
    pub pixels: Vec<(u16, u16)>,
    /// A file of more of them, as `lobula hot-pixels` writes it. The core reads no files: whoever reads the settings
    /// loads it first (see [`StageSpec::hot_pixels_mut`]), or the chain cannot be made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Columns and rows of the sensor whose pixels they are; another is refused. By default any will do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<(u16, u16)>,
}

/// The hot pixels in the settings of a filter, to be completed from a file.
#[derive(Debug)]
pub struct HotPixelList<'a> {
    /// Each as (x, y).
    pub pixels: &'a mut Vec<(u16, u16)>,
    /// The file that was not loaded yet.
    pub file: &'a mut Option<String>,
    /// Columns and rows of their sensor, if they are known.
    pub sensor: &'a mut Option<(u16, u16)>,
}

impl StageSpec {
    /// The hot pixels of a filter that has some: load what [`file`](HotPixelList::file) names into the others and leave
    /// `None` there.
    pub fn hot_pixels_mut(&mut self) -> Option<HotPixelList<'_>> {
        match self {
            Self::HotPixel(HotPixelSpec { pixels, file, sensor }) => {
                Some(HotPixelList { pixels, file, sensor })
            }
            Self::Denoise(DenoiseSpec { hot_pixels, hot_pixels_file, hot_pixels_sensor, .. }) => {
                Some(HotPixelList { pixels: hot_pixels, file: hot_pixels_file, sensor: hot_pixels_sensor })
            }
            _ => None,
        }
    }
}

/// Refuses hot pixels of another sensor, and a file of them that was not loaded.
fn check_hot_pixels(
    file: &Option<String>,
    sensor: Option<(u16, u16)>,
    geometry: Geometry,
) -> Result<(), ChainCause> {
    if file.is_some() {
        return Err(ChainCause::FileNotLoaded);
    }
    match sensor.map(|(width, height)| Geometry::new(width, height)) {
        Some(expected) if expected != geometry => Err(ChainCause::OtherSensor { expected, geometry }),
        _ => Ok(()),
    }
}

/// Settings of a [`MaskFilter`].
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaskSpec {
    /// The mask's pixels, each `[x, y]`.
    pub pixels: Vec<(u16, u16)>,
    /// Which events are kept; by default those of the mask's pixels.
    #[serde(default)]
    pub keep: MaskKeep,
}

/// Settings of a [`Denoise`] stage: its [`DenoiseParams`] and its hot pixels. Every key has a default.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DenoiseSpec {
    /// [`DenoiseParams::refractory_us`].
    pub refractory_us: u32,
    /// [`DenoiseParams::support_us`].
    pub support_us: u32,
    /// [`DenoiseParams::support`].
    pub support: u8,
    /// [`DenoiseParams::polarity_match`].
    pub polarity_match: PolarityMatch,
    /// [`DenoiseParams::trail_us`].
    pub trail_us: u32,
    /// [`DenoiseParams::shift`].
    pub shift: u8,
    /// The hot pixels, each `[x, y]`; by default none.
    pub hot_pixels: Vec<(u16, u16)>,
    /// A file of more of them: see [`HotPixelSpec::file`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hot_pixels_file: Option<String>,
    /// Columns and rows of their sensor: see [`HotPixelSpec::sensor`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hot_pixels_sensor: Option<(u16, u16)>,
}

impl Default for DenoiseSpec {
    fn default() -> Self {
        DenoiseParams::default().into()
    }
}

impl From<DenoiseParams> for DenoiseSpec {
    fn from(params: DenoiseParams) -> Self {
        let DenoiseParams { refractory_us, support_us, support, polarity_match, trail_us, shift } = params;
        Self {
            refractory_us,
            support_us,
            support,
            polarity_match,
            trail_us,
            shift,
            hot_pixels: Vec::new(),
            hot_pixels_file: None,
            hot_pixels_sensor: None,
        }
    }
}

impl DenoiseSpec {
    fn params(&self) -> DenoiseParams {
        let Self { refractory_us, support_us, support, polarity_match, trail_us, shift, .. } = *self;
        DenoiseParams { refractory_us, support_us, support, polarity_match, trail_us, shift }
    }
}

/// Memory of its own for a filter; too much is an error and never an abort.
pub(super) fn memory<W: Clone + Default>(len: usize) -> Result<Box<[W]>, ChainCause> {
    let bytes = len.saturating_mul(size_of::<W>());
    let mut words = Vec::new();
    words.try_reserve_exact(len).map_err(|_| ChainCause::OutOfMemory { bytes })?;
    words.resize(len, W::default());
    Ok(words.into_boxed_slice())
}

impl From<FilterError> for ChainCause {
    fn from(error: FilterError) -> Self {
        Self::Filter(error)
    }
}
