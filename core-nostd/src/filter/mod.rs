//! Filters: each thins a block in place, in order, and leaves the events it keeps as they are.
//!
//! Every filter is made for a sensor's size from parameters and, if it remembers anything, memory that the caller
//! brings. All times are µs. A filter's answer depends on the events before it only, never on how they were cut into
//! blocks.

mod background_activity;
mod compact;
mod denoise;
mod double_window;
mod hot_pixel;
mod mask;
mod polarity;
mod refractory;
mod roi;

pub use background_activity::{BackgroundActivity, BackgroundActivityParams};
pub(crate) use compact::compact;
pub use denoise::{Denoise, DenoiseParams};
pub use double_window::{DoubleWindow, DoubleWindowParams};
pub use hot_pixel::{HotPixelFilter, HotPixelLearner};
pub use mask::PixelMask;
pub use polarity::{PolarityFilter, PolarityParams};
pub use refractory::{Refractory, RefractoryParams};
pub use roi::{RegionOfInterest, RegionParams};

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
            DenoiseU32 denoise_u32: $crate::filter::Denoise<u32, S>, $crate::filter::DenoiseParams, u32,
                |geometry, _| $crate::filter::Denoise::<u32, ()>::required_len(geometry), $crate::filter::Denoise::try_new;
            DenoiseU16 denoise_u16: $crate::filter::Denoise<u16, S>, $crate::filter::DenoiseParams, u16,
                |geometry, _| $crate::filter::Denoise::<u16, ()>::required_len(geometry), $crate::filter::Denoise::try_new;
            DoubleWindow double_window: $crate::filter::DoubleWindow<S>, $crate::filter::DoubleWindowParams, u32,
                |_, params| $crate::filter::DoubleWindow::<()>::required_len(params.window),
                $crate::filter::DoubleWindow::try_new;
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
