//! Every transform of [`lobula_core::transforms`] and every augmentation of [`lobula_core::augmentations`].

use crate::export;
use crate::export::{Export, slice_mut};
use lobula_core::augmentation::Seed;
use lobula_core::transform::TransformError;
use lobula_core::{Block, Event, Geometry, Transform, Unfit};

unsafe fn apply<T: Transform>(
    transform: *mut T,
    block: *mut (u64, u64, Geometry),
    events: (*mut Event, usize),
) -> Result<usize, Unfit> {
    // SAFETY: the caller's promise.
    let (transform, block) = unsafe { (&mut *transform, &mut *block) };
    // SAFETY: the caller's promise.
    let events = unsafe { slice_mut(events.0, events.1) };
    let mut own = Block::new(block.0, block.1, block.2, events);
    let left = transform.apply(&mut own);
    *block = (own.t_first, own.t_last, own.geometry);
    left
}

unsafe fn facts<T: Transform>(transform: *const T, after: u64) -> (Geometry, u64) {
    // SAFETY: the caller's promise.
    let transform = unsafe { &*transform };
    (transform.output_geometry(), transform.reach_max(after))
}

type Memory = &'static mut [u32];

macro_rules! transforms {
    ($($variant:ident $module:ident: $type:ty, $params:ty, $len:expr, $make:expr;)*) => {
        $(mod $module {
            use super::*;
            #[allow(dead_code, reason = "those without memory name none")]
            type S = Memory;
            pub type Of = $type;

            fn try_new(
                make: impl Fn(Geometry, $params, Memory) -> Result<Of, TransformError>,
                (geometry, params, memory): (Geometry, $params, Memory),
            ) -> Result<Of, TransformError> {
                make(geometry, params, memory)
            }

            pub unsafe fn make(
                at: *mut Of,
                geometry: Geometry,
                params: *const $params,
                memory: (*mut u32, usize),
            ) -> Result<(), TransformError> {
                // SAFETY: the caller's promise.
                let (params, memory) = unsafe { (*params, slice_mut(memory.0, memory.1)) };
                // SAFETY: the caller's promise.
                try_new($make, (geometry, params, memory)).map(|transform| unsafe { at.write(transform) })
            }

            pub fn required_len(geometry: Geometry) -> usize {
                let len: fn(Geometry) -> usize = $len;
                len(geometry)
            }
        })*

        pub const EXPORTS: &[Export] = &[
            $(
                export!($module::make),
                export!($module::required_len),
                export!(apply::<$module::Of>),
                export!(facts::<$module::Of>),
            )*
        ];
    };
}

lobula_core::transforms!(transforms);

macro_rules! augmentations {
    ($($variant:ident $module:ident: $type:ty, $params:ty, $make:expr;)*) => {
        $(mod $module {
            use super::*;
            pub type Of = $type;

            pub unsafe fn make(
                at: *mut Of,
                geometry: Geometry,
                params: *const $params,
                seed: Seed,
            ) -> Result<(), TransformError> {
                let make: fn(Geometry, $params, Seed) -> Result<Of, TransformError> = $make;
                // SAFETY: the caller's promise.
                make(geometry, unsafe { *params }, seed).map(|transform| unsafe { at.write(transform) })
            }
        })*

        pub const AUGMENTATIONS: &[Export] = &[
            $(
                export!($module::make),
                export!(apply::<$module::Of>),
                export!(facts::<$module::Of>),
            )*
        ];
    };
}

lobula_core::augmentations!(augmentations);
