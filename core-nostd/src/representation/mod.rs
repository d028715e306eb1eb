//! Dense tensors of a window's events, in the caller's memory: one file each.
//!
//! | kind | shape | element | value |
//! |---|---|---|---|
//! | [`Count`] | 1 x H x W | u8, u16, f32 | number of events |
//! | [`PolarityHistogram`] | 2 x H x W (ON, OFF) | u8, u16, f32 | number of events |
//! | [`VoxelGrid`] | bins x H x W | f32 | events of sign ±1, shared between the two nearest bins in time |
//! | [`TimeSurface`] | 2 x H x W (ON, OFF) | f32, f16 | exp(-age / tau) of the pixel's last event |
//!
//! Rows from the top, columns from the left, row-major.

mod count;
mod index;
mod parameters;
mod pixel;
mod polarity_histogram;
mod time_surface;
mod voxel_grid;

pub use count::Count;
pub use parameters::Parameters;
#[cfg(all(feature = "alloc", feature = "serde"))]
pub(crate) use parameters::for_each_parameter;
pub use pixel::{Dtype, Pixel, Real, Tally};
pub use polarity_histogram::PolarityHistogram;
pub use time_surface::TimeSurface;
pub use voxel_grid::VoxelGrid;

use crate::{Geometry, Representation, Span, WrongGeometry};

// A new representation is a file with its type and `Build`, the lines for it in the table above, here and in `kinds!`
// below, and for each new setting a line in `parameters.rs`.

/// Every representation, in every type of element: the one list that the host's views and the no-panic proof are
/// made from. Calls the macro `$then` with lines of `Variant Kind Type;`, the types over memory of type `$state`.
#[macro_export]
macro_rules! for_each_representation {
    ($then:ident, $state:ty) => {
        $then! {
            CountU8 Count $crate::representation::Count<u8>;
            CountU16 Count $crate::representation::Count<u16>;
            CountF32 Count $crate::representation::Count<f32>;
            PolarityHistogramU8 PolarityHistogram $crate::representation::PolarityHistogram<u8>;
            PolarityHistogramU16 PolarityHistogram $crate::representation::PolarityHistogram<u16>;
            PolarityHistogramF32 PolarityHistogram $crate::representation::PolarityHistogram<f32>;
            VoxelGridF32 VoxelGrid $crate::representation::VoxelGrid;
            TimeSurfaceF32 TimeSurface $crate::representation::TimeSurface<f32, $state>;
            TimeSurfaceF16 TimeSurface $crate::representation::TimeSurface<$crate::f16, $state>;
        }
    };
}

/// Lines of `Kind, name in settings, dtype;`, each under its docs.
macro_rules! kinds {
    ($($(#[$doc:meta])* $kind:ident, $name:literal, $dtype:ident;)*) => {
        /// What kind of tensor: the name in settings.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        pub enum Kind {
            $($(#[$doc])* #[cfg_attr(feature = "serde", serde(rename = $name))] $kind,)*
        }

        impl Kind {
            /// All there are.
            pub const ALL: &[Self] = &[$(Self::$kind),*];

            /// Its name in settings.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$kind => $name,)*
                }
            }

            /// The type of element when none is asked for: the smallest that serves.
            pub const fn dtype(self) -> Dtype {
                match self {
                    $(Self::$kind => Dtype::$dtype,)*
                }
            }
        }
    };
}

kinds! {
    /// [`Count`].
    Count, "count", U8;
    /// [`PolarityHistogram`].
    PolarityHistogram, "polarity_histogram", U8;
    /// [`VoxelGrid`].
    VoxelGrid, "voxel_grid", F32;
    /// [`TimeSurface`].
    TimeSurface, "time_surface", F32;
}

/// Why a representation cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadRepresentation {
    /// No bins, or so many that the tensor has over 2^32 elements.
    Bins {
        /// What was asked for.
        found: u16,
    },
    /// A decay of 0 or beyond [`TimeSurface::TAU_US_MAX`].
    TauUs {
        /// What was asked for.
        found: u32,
    },
    /// A parameter out of its range.
    Parameter {
        /// Its name in settings.
        key: &'static str,
        /// What was asked for.
        found: u64,
        /// What it may be, with the unit.
        range: &'static str,
    },
    /// The state's memory has another length than the representation needs.
    StateLen {
        /// Elements needed.
        expected: usize,
        /// Elements given.
        found: usize,
    },
}

impl core::fmt::Display for BadRepresentation {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bins { found } => {
                write!(f, "bins = {found} is no voxel grid: give at least 1, and 2^32 elements at most")
            }
            Self::TauUs { found } => {
                write!(f, "tau_us = {found} is not a decay: give 1 to {} µs", time_surface::TAU_US_MAX)
            }
            Self::Parameter { key, found, range } => {
                write!(f, "{key} = {found} is out of range: give {range}")
            }
            Self::StateLen { expected, found } => {
                write!(f, "memory of {found} elements was given where {expected} are needed")
            }
        }
    }
}

impl core::error::Error for BadRepresentation {}

/// A representation made the same way as all others: from parameters and memory for its state.
pub trait Build<S>: Representation + Sized {
    /// Elements of state it needs: the required length of `S`. Of parameters that [`build`](Self::build) would refuse,
    /// anything.
    fn state_len(parameters: &Parameters, geometry: Geometry) -> usize;

    /// Makes it. `state` may hold anything; those that need none drop it.
    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation>;

    /// Events that a pixel could not count any more, since the start.
    fn saturated(&self) -> u64 {
        0
    }
}

/// Refuses events of another sensor.
fn check(expected: Geometry, span: &Span<'_>) -> Result<(), WrongGeometry> {
    if span.geometry == expected { Ok(()) } else { Err(WrongGeometry { expected, found: span.geometry }) }
}
