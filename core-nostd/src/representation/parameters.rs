//! What representations are made from besides the sensor's size: the one list of their parameters.

/// Every parameter of a representation: the one list that [`Parameters`], the settings of views and the check that a
/// setting means something to its kind are made from. Calls the macro `$then` with lines of
/// `key: type = default, Kinds;`, each under its docs: meaning, unit, range.
macro_rules! for_each_parameter {
    ($then:ident) => {
        $then! {
            /// Bins of a [`VoxelGrid`](crate::representation::VoxelGrid), at least 1. Default 5.
            bins: u16 = 5, VoxelGrid;
            /// Decay of a [`TimeSurface`](crate::representation::TimeSurface) in µs, 1 to 2^25. Default 30000.
            tau_us: u32 = 30_000, TimeSurface;
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
