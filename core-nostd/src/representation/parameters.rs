//! What representations are made from besides the sensor's size: the one list of their parameters.

/// Every parameter of a representation: the one list that [`Parameters`], the settings of views and the check that a
/// setting means something to its kind are made from. Calls the macro `$then` with lines of
/// `key: type = default, Kinds;`, each under its docs: meaning, unit, range.
macro_rules! for_each_parameter {
    ($then:ident) => {
        $then! {
            /// Bins of a [`VoxelGrid`](crate::representation::VoxelGrid),
            /// [`SliceVoxelGrid`](crate::representation::SliceVoxelGrid),
            /// [`StackedHistogram`](crate::representation::StackedHistogram),
            /// [`MixedDensityStack`](crate::representation::MixedDensityStack) or
            /// [`EventSpikeTensor`](crate::representation::EventSpikeTensor), at least 1. Default 5.
            bins: u16 = 5, VoxelGrid SliceVoxelGrid StackedHistogram MixedDensityStack EventSpikeTensor;
            /// Where the counts of a stacked histogram stop, 1 to 255. Default 10.
            cutoff: u8 = 10, StackedHistogram;
            /// Planes of a voxel grid's polarities: `"signed"` (default) or `"apart"`.
            polarities: crate::representation::Polarities = crate::representation::Polarities::Signed, VoxelGrid;
            /// Bins that an event of a voxel grid adds to: `"linear"` (default) or `"nearest"`.
            interpolation: crate::representation::Interpolation = crate::representation::Interpolation::Linear, VoxelGrid;
            /// Decay of a [`TimeSurface`](crate::representation::TimeSurface),
            /// [`AveragedTimeSurface`](crate::representation::AveragedTimeSurface) or
            /// [`EventImage`](crate::representation::EventImage) in µs, 1 to 2^25. Default 30000.
            tau_us: u32 = 30_000, TimeSurface AveragedTimeSurface EventImage;
            /// Width and height of the tiles of a [`TileCount`](crate::representation::TileCount) in pixels, a power of
            /// two. Default 16.
            tile_px: u16 = 16, TileCount;
            /// How a time surface decays: `"exponential"` (default) or `"linear"`.
            decay: crate::representation::Decay = crate::representation::Decay::Exponential, TimeSurface;
            /// What an [`EventFrame`](crate::representation::EventFrame) makes of a pixel's events: `"sum"` (default)
            /// or `"latest"`.
            combine: crate::representation::Combine = crate::representation::Combine::Sum, EventFrame;
            /// The longest of the five scales of an [`Mcts`](crate::representation::Mcts) in µs, 1000 to 2^30. Default
            /// 30000.
            max_window_us: u32 = 30_000, Mcts;
            /// Scales of an MCTS in µs in place of the five, at most 16 of 1 to 2^30. Default none.
            windows_us: crate::representation::List = crate::representation::List::EMPTY, Mcts;
            /// Radius of what an event changes on a [`Sits`](crate::representation::Sits) or
            /// [`Tos`](crate::representation::Tos) in pixels, 1 to 7. Default 3.
            radius: u16 = 3, Sits Tos;
            /// Below it, a pixel of a TOS is 0; 1 to 255. Default 241.
            threshold: u8 = 241, Tos;
            /// Events of a pixel and polarity that a [`Tore`](crate::representation::Tore) holds, 1 to 16. Default 4.
            depth: u16 = 4, Tore;
            /// Ages of a TORE up to here, in µs, are 0. Default 150.
            age_min_us: u32 = 150, Tore;
            /// The greatest age of a TORE in µs, up to 2^30. Default 5000000.
            age_max_us: u32 = 5_000_000, Tore;
            /// Where a [`SliceCountmask`](crate::representation::SliceCountmask) or
            /// [`SliceRedBlue`](crate::representation::SliceRedBlue) clips counts, 0 to 100. Default 99.
            percentile: u8 = 99, SliceCountmask SliceRedBlue;
            /// Background of a countmask: `"black"` (default) or `"white"`.
            background: crate::representation::Background = crate::representation::Background::Black, SliceCountmask;
            /// Colours of an event image: `"dark"` (default), `"light"` or `"gray"`.
            palette: crate::representation::Palette = crate::representation::Palette::Dark, EventImage;
        }
    };
}
#[cfg(all(feature = "alloc", feature = "serde"))]
pub(crate) use for_each_parameter;

macro_rules! parameters {
    ($($(#[$doc:meta])* $key:ident: $type:ty = $default:expr, $($kind:ident)*;)*) => {
        /// Parameters of any representation; each takes those it knows.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[non_exhaustive]
        pub struct Parameters {
            $($(#[$doc])* pub $key: $type,)*
        }

        impl Default for Parameters {
            fn default() -> Self {
                Self { $($key: $default,)* }
            }
        }
    };
}

for_each_parameter!(parameters);

/// A short list of whole numbers, in settings `[1, 2, 3]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "alloc::vec::Vec<u32>", into = "alloc::vec::Vec<u32>"))]
pub struct List {
    values: [u32; Self::MAX],
    len: usize,
}

impl List {
    /// How many numbers it holds at most.
    pub const MAX: usize = 16;

    /// No number.
    pub const EMPTY: Self = Self { values: [0; Self::MAX], len: 0 };

    /// These numbers; none if there are more than [`MAX`](Self::MAX).
    pub fn try_new(numbers: &[u32]) -> Option<Self> {
        let mut values = [0; Self::MAX];
        values.get_mut(..numbers.len())?.copy_from_slice(numbers);
        Some(Self { values, len: numbers.len() })
    }

    /// The numbers.
    pub fn as_slice(&self) -> &[u32] {
        self.values.get(..self.len).unwrap_or_default()
    }
}

#[cfg(feature = "serde")]
impl TryFrom<alloc::vec::Vec<u32>> for List {
    type Error = &'static str;

    fn try_from(numbers: alloc::vec::Vec<u32>) -> Result<Self, Self::Error> {
        Self::try_new(&numbers).ok_or("a list of more than 16 numbers: give fewer")
    }
}

#[cfg(feature = "serde")]
impl From<List> for alloc::vec::Vec<u32> {
    fn from(list: List) -> Self {
        list.as_slice().to_vec()
    }
}
