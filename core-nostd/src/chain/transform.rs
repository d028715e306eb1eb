//! One stage of a chain: any transform of the registry, in memory of its own.

use super::filter::memory;
use super::{ChainCause, StageSpec};
use crate::transform::TransformError;
use crate::{Block, Geometry, Transform, Unfit};
use alloc::boxed::Box;

macro_rules! any_transform {
    ($($variant:ident $module:ident: $type:ty, $params:ty, $len:expr, $make:expr;)*) => {
        $(mod $module {
            use super::*;
            #[allow(dead_code, reason = "a transform without a table has no storage")]
            type S = Box<[u32]>;
            pub(super) type Of = $type;

            pub(super) fn make(geometry: Geometry, params: $params) -> Result<AnyTransform, ChainCause> {
                let len: fn(Geometry) -> usize = $len;
                let make: fn(Geometry, $params, S) -> Result<Of, TransformError> = $make;
                Ok(AnyTransform::$variant(make(geometry, params, memory(len(geometry))?)?))
            }
        })*

        /// Any transform of the [registry](crate::transforms), on the heap.
        #[derive(Clone, Debug)]
        #[non_exhaustive]
        #[allow(missing_docs, reason = "each is named by its type")]
        #[allow(private_interfaces, reason = "the names of types of the registry")]
        pub enum AnyTransform {
            $($variant($module::Of),)*
        }

        impl AnyTransform {
            /// The transform that `spec` describes, for events of this sensor; `None` if it describes a filter.
            pub fn try_new(spec: &StageSpec, geometry: Geometry) -> Option<Result<Self, ChainCause>> {
                match spec {
                    $(StageSpec::$variant(params) => Some($module::make(geometry, *params)),)*
                    _ => None,
                }
            }
        }

        /// Name of a transform in settings; that of a filter is empty.
        pub(super) fn kind(spec: &StageSpec) -> &'static str {
            match spec {
                $(StageSpec::$variant(_) => stringify!($module),)*
                _ => "",
            }
        }

        impl Transform for AnyTransform {
            fn output_geometry(&self) -> Geometry {
                match self {
                    $(Self::$variant(transform) => transform.output_geometry(),)*
                }
            }

            fn reach_max(&self, after: u64) -> u64 {
                match self {
                    $(Self::$variant(transform) => transform.reach_max(after),)*
                }
            }

            fn time(&self, t: u64) -> Option<u64> {
                match self {
                    $(Self::$variant(transform) => transform.time(t),)*
                }
            }

            fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
                match self {
                    $(Self::$variant(transform) => transform.apply(block),)*
                }
            }
        }
    };
}

crate::transforms!(any_transform);

impl From<TransformError> for ChainCause {
    fn from(error: TransformError) -> Self {
        Self::Transform(error)
    }
}
