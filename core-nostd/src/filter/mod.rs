//! Filters: each thins a block in place, in order, and leaves the events it keeps as they are.
//!
//! Every filter is made for a sensor's size from parameters and, if it remembers anything, memory that the caller
//! brings. All times are µs. A filter's answer depends on the events before it only, never on how they were cut into
//! blocks.

mod background_activity;
mod compact;
mod polarity;
mod refractory;
mod roi;

pub use background_activity::{BackgroundActivity, BackgroundActivityParams};
pub(crate) use compact::compact;
pub use polarity::{PolarityFilter, PolarityParams};
pub use refractory::{Refractory, RefractoryParams};
pub use roi::{RegionOfInterest, RegionParams};

/// The registry: every filter. Calls `$then!` with the list, from which the host's
/// [`AnyFilter`](crate::chain::AnyFilter) and the exports of the no-panic proof are made.
///
/// Each line: name, type, parameters; those with memory also a module's name and the word of the memory, and in
/// their type `S` stands for the storage. All have `try_new(geometry, params[, memory])`, those with memory also
/// `required_len(geometry)`.
#[macro_export]
macro_rules! filters {
    ($then:ident) => {
        $then! {
            stateless {
                Polarity: $crate::filter::PolarityFilter, $crate::filter::PolarityParams;
                RegionOfInterest: $crate::filter::RegionOfInterest, $crate::filter::RegionParams;
            }
            stateful {
                RefractoryU32 refractory_u32:
                    $crate::filter::Refractory<u32, S>, $crate::filter::RefractoryParams, u32;
                RefractoryU16 refractory_u16:
                    $crate::filter::Refractory<u16, S>, $crate::filter::RefractoryParams, u16;
                BackgroundActivityU32 background_activity_u32:
                    $crate::filter::BackgroundActivity<u32, S>, $crate::filter::BackgroundActivityParams, u32;
                BackgroundActivityU16 background_activity_u16:
                    $crate::filter::BackgroundActivity<u16, S>, $crate::filter::BackgroundActivityParams, u16;
            }
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
            Self::RegionOffSensor { geometry } => {
                write!(f, "the region reaches beyond the {geometry} sensor: make it smaller or move it")
            }
        }
    }
}

impl core::error::Error for FilterError {}
