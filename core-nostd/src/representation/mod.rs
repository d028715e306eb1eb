//! Dense tensors of a window's events, in the caller's memory: one file each.
//!
//! | kind | shape | element | value |
//! |---|---|---|---|
//! | [`Count`] | 1 x H x W | u8, u16, f32 | number of events |
//! | [`TileCount`] | 1 x H/tile x W/tile | u16, f32 | number of events of each tile |
//! | [`Binary`] | 1 x H x W | u8 | whether there were any |
//! | [`PolarityHistogram`] | 2 x H x W (ON, OFF) | u8, u16, f32 | number of events |
//! | [`SlicePolarityHistogram`] | 2 x H x W (ON, OFF) | u8 | the same as a share of the greatest |
//! | [`EventFrame`] | 1 x H x W | u8, f32 | sum of signs ±1, or the last one |
//! | [`VoxelGrid`] | bins x H x W (each polarity apart: 2 bins) | f32 | events of sign ±1, shared between the two nearest bins in time, or in the nearest |
//! | [`SliceVoxelGrid`] | bins x H x W | f32 | the same with mean 0 and deviation 1 |
//! | [`StackedHistogram`] | 2 bins x H x W (OFF, ON) | u8 | number of events in each part of the window, up to a cutoff |
//! | [`MixedDensityStack`] | bins x H x W | f32 | sign of the pixel's last event in the last 1 / 2^i of the window |
//! | [`EventSpikeTensor`] | 2 bins x H x W (OFF, ON) | f32 | times of events, shared between the two nearest bins |
//! | [`TimeSurface`] | 2 x H x W (ON, OFF) | f32, f16 | exp(-age / tau), or 1 - age / tau, of the pixel's last event |
//! | [`IntegerTimeSurface`] | 2 x H x W (ON, OFF) | u8 | 255 times the same, from a table: for microcontrollers |
//! | [`AveragedTimeSurface`] | 2 x H x W (ON, OFF) | f32 | mean of exp(-age / tau) over the pixel's events |
//! | [`Mcts`] | 2 N x H x W (OFF, ON) | f32, f16 | 1 - age / w of the pixel's last event for N scales w |
//! | [`Tore`] | 2 depth x H x W (ON, OFF) | f32 | logarithms of the ages of the pixel's last events |
//! | [`Sits`] | 2 x H x W (ON, OFF) | u8 | rank of the pixel's last event in its neighbourhood |
//! | [`Tos`] | 1 x H x W | u8 | order of the newest events of a neighbourhood |
//! | [`Tencode`] | 3 x H x W (ON, age, OFF) | u8 | polarity and age of the pixel's last event |
//! | [`SliceCountmask`] | 3 x H x W (ON, any, OFF) | u8 | number of events clipped at a percentile |
//! | [`SliceRedBlue`] | 3 x H x W (red, green, blue) | u8 | the prevailing polarity, clipped at a percentile |
//! | [`EventImage`] | 3 x H x W (red, green, blue) | u8 | the last event's colour, fading |
//!
//! Ages are counted from the window's end; [`LastEvent`] counts any of them from the newest event.
//! [`Sliding`] draws windows that overlap, each from the one before where that is possible.
//! `Slice*` need the whole window before they know any value: they keep it in the caller's memory.
//!
//! Rows from the top, columns from the left, row-major.

mod averaged_time_surface;
mod binary;
mod count;
mod digits;
mod eraser;
mod event_frame;
mod event_image;
mod event_spike_tensor;
pub(crate) mod index;
mod integer_time_surface;
mod last_event;
mod mcts;
mod mixed_density_stack;
mod overlap;
mod parameters;
mod patches;
mod pixel;
mod sits;
mod slice_countmask;
mod slice_polarity_histogram;
mod slice_red_blue;
mod slice_voxel_grid;
mod stacked_histogram;
mod stamps;
mod tencode;
mod tile_count;
mod time_surface;
mod tore;
mod tos;
mod voxel_grid;

pub use averaged_time_surface::AveragedTimeSurface;
pub use binary::Binary;
pub use count::{Count, EventCount, PolarityHistogram};
pub use eraser::Eraser;
pub use event_frame::{Combine, EventFrame};
pub use event_image::{EventImage, Palette};
pub use event_spike_tensor::EventSpikeTensor;
pub use integer_time_surface::IntegerTimeSurface;
pub use last_event::{KeptSlice, LastEvent};
pub use mcts::{Mcts, Scales};
pub use mixed_density_stack::MixedDensityStack;
pub use overlap::{Overlap, Sliding};
#[cfg(all(feature = "alloc", feature = "serde"))]
pub(crate) use parameters::for_each_parameter;
pub use parameters::{List, Parameters};
pub use pixel::{Dtype, Pixel, Real, Signed, Tally};
pub use sits::Sits;
pub use slice_countmask::{Background, SliceCountmask};
pub use slice_polarity_histogram::SlicePolarityHistogram;
pub use slice_red_blue::SliceRedBlue;
pub use slice_voxel_grid::SliceVoxelGrid;
pub use stacked_histogram::StackedHistogram;
pub use tencode::Tencode;
pub use tile_count::TileCount;
pub use time_surface::{Decay, TimeSurface};
pub use tore::Tore;
pub use tos::Tos;
pub use voxel_grid::{Interpolation, Polarities, VoxelGrid};

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
            TimeSurfaceU8 TimeSurface $crate::representation::IntegerTimeSurface<$state>;
            TileCountU16 TileCount $crate::representation::TileCount<u16>;
            TileCountF32 TileCount $crate::representation::TileCount<f32>;
            Binary Binary $crate::representation::Binary;
            SlicePolarityHistogram SlicePolarityHistogram $crate::representation::SlicePolarityHistogram<$state>;
            EventFrameU8 EventFrame $crate::representation::EventFrame<u8>;
            EventFrameF32 EventFrame $crate::representation::EventFrame<f32>;
            SliceVoxelGrid SliceVoxelGrid $crate::representation::SliceVoxelGrid<$state>;
            AveragedTimeSurface AveragedTimeSurface $crate::representation::AveragedTimeSurface<$state>;
            MctsF32 Mcts $crate::representation::Mcts<f32, $state>;
            MctsF16 Mcts $crate::representation::Mcts<$crate::f16, $state>;
            Tencode Tencode $crate::representation::Tencode<$state>;
            SliceCountmask SliceCountmask $crate::representation::SliceCountmask<$state>;
            SliceRedBlue SliceRedBlue $crate::representation::SliceRedBlue<$state>;
            EventImage EventImage $crate::representation::EventImage<$state>;
            StackedHistogram StackedHistogram $crate::representation::StackedHistogram;
            MixedDensityStack MixedDensityStack $crate::representation::MixedDensityStack;
            EventSpikeTensor EventSpikeTensor $crate::representation::EventSpikeTensor;
            Tore Tore $crate::representation::Tore<$state>;
            Sits Sits $crate::representation::Sits<$state>;
            Tos Tos $crate::representation::Tos<$state>;
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
    /// [`TimeSurface`], or [`IntegerTimeSurface`].
    TimeSurface, "time_surface", F32;
    /// [`TileCount`].
    TileCount, "tile_count", U16;
    /// [`Binary`].
    Binary, "binary", U8;
    /// [`SlicePolarityHistogram`].
    SlicePolarityHistogram, "slice_polarity_histogram", U8;
    /// [`EventFrame`].
    EventFrame, "event_frame", F32;
    /// [`SliceVoxelGrid`].
    SliceVoxelGrid, "slice_voxel_grid", F32;
    /// [`AveragedTimeSurface`].
    AveragedTimeSurface, "averaged_time_surface", F32;
    /// [`Mcts`].
    Mcts, "mcts", F32;
    /// [`Tencode`].
    Tencode, "tencode", U8;
    /// [`SliceCountmask`].
    SliceCountmask, "slice_countmask", U8;
    /// [`SliceRedBlue`].
    SliceRedBlue, "slice_red_blue", U8;
    /// [`EventImage`].
    EventImage, "event_image", U8;
    /// [`StackedHistogram`].
    StackedHistogram, "stacked_histogram", U8;
    /// [`MixedDensityStack`].
    MixedDensityStack, "mixed_density_stack", F32;
    /// [`EventSpikeTensor`].
    EventSpikeTensor, "event_spike_tensor", F32;
    /// [`Tore`].
    Tore, "tore", F32;
    /// [`Sits`].
    Sits, "sits", U8;
    /// [`Tos`].
    Tos, "tos", U8;
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

/// Refuses what is no percentile.
fn check_percentile(percentile: u8) -> Result<u8, BadRepresentation> {
    let (found, range) = (u64::from(percentile), "0 to 100");
    if percentile > 100 {
        return Err(BadRepresentation::Parameter { key: "percentile", found, range });
    }
    Ok(percentile)
}
