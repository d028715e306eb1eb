//! Filters: each thins a block in place, in order, and leaves the events it keeps as they are.
//!
//! Every filter is made for a sensor's size from parameters and, if it remembers anything, memory that the caller
//! brings. All times are µs. A filter's answer depends on the events before it only, never on how they were cut into
//! blocks.

mod anti_flicker;
mod background_activity;
mod burst;
mod decimate;
mod denoise;
mod double_window;
mod hot_pixel;
mod inceptive;
mod leaky_hot_pixel;
mod mask;
mod periods;
mod plane;
mod polarity;
mod rate_limit;
mod refractory;
mod roi;
mod stcf;
mod support;
mod tiles;
mod trail;

pub use anti_flicker::{AntiFlicker, AntiFlickerParams, FlickerKeep};
pub use background_activity::{BackgroundActivity, BackgroundActivityParams};
pub use decimate::{Decimate, DecimateParams};
pub use denoise::{Denoise, DenoiseParams};
pub use double_window::{DoubleWindow, DoubleWindowParams};
pub use hot_pixel::{HotPixelFilter, HotPixelLearner};
pub use inceptive::{Inceptive, InceptiveKeep, InceptiveParams};
pub use leaky_hot_pixel::{LeakyHotPixel, LeakyHotPixelParams};
pub use mask::{MaskFilter, MaskKeep, PixelMask};
pub use polarity::{PolarityFilter, PolarityParams};
pub use rate_limit::{RateLimit, RateLimitParams};
pub use refractory::{Refractory, RefractoryParams};
pub use roi::{RegionOfInterest, RegionParams};
pub use stcf::{Stcf, StcfParams};
pub use support::PolarityMatch;
pub use trail::{Trail, TrailMode, TrailParams};

/// The registry: every filter. Calls `$then!` with the list, from which the host's
/// [`AnyFilter`](crate::chain::AnyFilter) and the exports of the no-panic proof are made.
///
/// Each line: name, name of a module, type (where `S` stands for its storage), parameters, word of its memory, words
/// needed as a function of the [`Geometry`](crate::Geometry) and a reference to the parameters, and how to make it of
/// geometry, parameters and memory (a `Result` with [`FilterError`](crate::filter::FilterError)).
#[macro_export]
macro_rules! filters {
    ($then:ident) => {
        $then! {
            Polarity polarity: $crate::filter::PolarityFilter, $crate::filter::PolarityParams, u8,
                |_, _| 0, |geometry, params, _| Ok($crate::filter::PolarityFilter::new(geometry, params));
            RegionOfInterest region_of_interest: $crate::filter::RegionOfInterest, $crate::filter::RegionParams, u8,
                |_, _| 0, |geometry, params, _| $crate::filter::RegionOfInterest::try_new(geometry, params);
            HotPixel hot_pixel: $crate::filter::HotPixelFilter<S>, (), u32,
                |geometry, ()| $crate::filter::PixelMask::<()>::required_len(geometry),
                |geometry, (), memory| $crate::filter::PixelMask::try_from_words(geometry, memory)
                    .map($crate::filter::HotPixelFilter::new);
            RefractoryU32 refractory_u32: $crate::filter::Refractory<u32, S>, $crate::filter::RefractoryParams, u32,
                |geometry, _| $crate::filter::Refractory::<u32, ()>::required_len(geometry), $crate::filter::Refractory::try_new;
            RefractoryU16 refractory_u16: $crate::filter::Refractory<u16, S>, $crate::filter::RefractoryParams, u16,
                |geometry, _| $crate::filter::Refractory::<u16, ()>::required_len(geometry), $crate::filter::Refractory::try_new;
            BackgroundActivityU32 background_activity_u32:
                $crate::filter::BackgroundActivity<u32, S>, $crate::filter::BackgroundActivityParams, u32,
                |geometry, _| $crate::filter::BackgroundActivity::<u32, ()>::required_len(geometry),
                $crate::filter::BackgroundActivity::try_new;
            BackgroundActivityU16 background_activity_u16:
                $crate::filter::BackgroundActivity<u16, S>, $crate::filter::BackgroundActivityParams, u16,
                |geometry, _| $crate::filter::BackgroundActivity::<u16, ()>::required_len(geometry),
                $crate::filter::BackgroundActivity::try_new;
            StcfU32 stcf_u32: $crate::filter::Stcf<u32, S>, $crate::filter::StcfParams, u32,
                |geometry, _| $crate::filter::Stcf::<u32, ()>::required_len(geometry), $crate::filter::Stcf::try_new;
            StcfU16 stcf_u16: $crate::filter::Stcf<u16, S>, $crate::filter::StcfParams, u16,
                |geometry, _| $crate::filter::Stcf::<u16, ()>::required_len(geometry), $crate::filter::Stcf::try_new;
            DenoiseU32 denoise_u32: $crate::filter::Denoise<u32, S>, $crate::filter::DenoiseParams, u32,
                |geometry, _| $crate::filter::Denoise::<u32, ()>::required_len(geometry), $crate::filter::Denoise::try_new;
            DenoiseU16 denoise_u16: $crate::filter::Denoise<u16, S>, $crate::filter::DenoiseParams, u16,
                |geometry, _| $crate::filter::Denoise::<u16, ()>::required_len(geometry), $crate::filter::Denoise::try_new;
            DoubleWindow double_window: $crate::filter::DoubleWindow<S>, $crate::filter::DoubleWindowParams, u32,
                |_, params| $crate::filter::DoubleWindow::<()>::required_len(params.window),
                $crate::filter::DoubleWindow::try_new;
            Mask mask: $crate::filter::MaskFilter<S>, $crate::filter::MaskKeep, u32,
                |geometry, _| $crate::filter::PixelMask::<()>::required_len(geometry),
                |geometry, keep, memory| $crate::filter::PixelMask::try_from_words(geometry, memory)
                    .map(|mask| $crate::filter::MaskFilter::new(mask, keep));
            LeakyHotPixel leaky_hot_pixel: $crate::filter::LeakyHotPixel<S>, $crate::filter::LeakyHotPixelParams, u8,
                |geometry, _| $crate::filter::LeakyHotPixel::<()>::required_len(geometry),
                $crate::filter::LeakyHotPixel::try_new;
            TrailU32 trail_u32: $crate::filter::Trail<u32, S>, $crate::filter::TrailParams, u32,
                |geometry, _| $crate::filter::Trail::<u32, ()>::required_len(geometry), $crate::filter::Trail::try_new;
            TrailU16 trail_u16: $crate::filter::Trail<u16, S>, $crate::filter::TrailParams, u16,
                |geometry, _| $crate::filter::Trail::<u16, ()>::required_len(geometry), $crate::filter::Trail::try_new;
            InceptiveU32 inceptive_u32: $crate::filter::Inceptive<u32, S>, $crate::filter::InceptiveParams, u32,
                |geometry, _| $crate::filter::Inceptive::<u32, ()>::required_len(geometry),
                $crate::filter::Inceptive::try_new;
            InceptiveU16 inceptive_u16: $crate::filter::Inceptive<u16, S>, $crate::filter::InceptiveParams, u16,
                |geometry, _| $crate::filter::Inceptive::<u16, ()>::required_len(geometry),
                $crate::filter::Inceptive::try_new;
            AntiFlicker anti_flicker: $crate::filter::AntiFlicker<S>, $crate::filter::AntiFlickerParams, u32,
                |geometry, params| $crate::filter::AntiFlicker::<()>::required_len(geometry, params.tile_shift),
                $crate::filter::AntiFlicker::try_new;
            Decimate decimate: $crate::filter::Decimate, $crate::filter::DecimateParams, u8,
                |_, _| 0, |geometry, params, _| $crate::filter::Decimate::try_new(geometry, params);
            RateLimit rate_limit: $crate::filter::RateLimit<S>, $crate::filter::RateLimitParams, u32,
                |geometry, params| $crate::filter::RateLimit::<()>::required_len(geometry, params.tile_shift),
                $crate::filter::RateLimit::try_new;
        }
    };
}

use crate::Geometry;
use crate::time_map::TimeMapError;

/// Which events start a refractory period.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Refresh {
    /// Those kept.
    #[default]
    Kept,
    /// All, the dropped included.
    All,
}

/// Which pixels are neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Neighbours {
    /// Those that share an edge.
    Four,
    /// Those that share an edge or a corner.
    #[default]
    Eight,
}

/// Why a filter cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilterError {
    /// Its time map cannot.
    TimeMap(TimeMapError),
    /// Its memory is too short.
    MemoryTooShort {
        /// Words needed.
        needed: usize,
        /// Words given.
        found: usize,
    },
    /// A parameter is not in its range.
    OutOfRange {
        /// Its name.
        name: &'static str,
        /// What was given.
        value: u32,
        /// The least it may be.
        min: u32,
        /// The most it may be.
        max: u32,
    },
    /// More than 8 neighbours are asked to support an event.
    SupportOutOfRange {
        /// How many are asked.
        support: u8,
    },
    /// The number of standard deviations is negative, not a number or infinite.
    SigmasOutOfRange,
    /// The region does not lie on the sensor.
    RegionOffSensor {
        /// The sensor's size.
        geometry: Geometry,
    },
}

/// Refuses memory that is shorter than needed, and clears what is needed of it.
fn cleared<T: Copy + Default>(memory: &mut [T], needed: usize) -> Result<(), FilterError> {
    let found = memory.len();
    memory.get_mut(..needed).ok_or(FilterError::MemoryTooShort { needed, found })?.fill(T::default());
    Ok(())
}

/// The value of a parameter, if it lies in its range, the ends included.
const fn in_range(name: &'static str, value: u32, (min, max): (u32, u32)) -> Result<u32, FilterError> {
    if value < min || value > max {
        return Err(FilterError::OutOfRange { name, value, min, max });
    }
    Ok(value)
}

/// Refuses a number of supporting neighbours that no pixel has.
const fn check_support(support: u8) -> Result<(), FilterError> {
    if support > 8 { Err(FilterError::SupportOutOfRange { support }) } else { Ok(()) }
}

impl From<TimeMapError> for FilterError {
    fn from(error: TimeMapError) -> Self {
        Self::TimeMap(error)
    }
}

impl core::fmt::Display for FilterError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TimeMap(error) => error.fmt(f),
            Self::MemoryTooShort { needed, found } => {
                write!(f, "memory of {found} words is too short: give {needed}")
            }
            Self::OutOfRange { name, value, min, max } => {
                write!(f, "{name} = {value} is out of range: give {min} to {max}")
            }
            Self::SupportOutOfRange { support } => {
                write!(f, "a pixel has 8 neighbours, so {support} cannot support it: ask for 0 to 8")
            }
            Self::SigmasOutOfRange => {
                f.write_str("the number of standard deviations must be 0 or more: 3 is usual")
            }
            Self::RegionOffSensor { geometry } => {
                write!(f, "the region reaches beyond the {geometry} sensor: make it smaller or move it")
            }
        }
    }
}

impl core::error::Error for FilterError {}
