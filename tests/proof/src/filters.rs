//! Every filter of [`lobula_core::filters`], alone and in a tuple.

use crate::export;
use crate::export::{Export, slice_mut};
use lobula_core::filter::{FilterError, HotPixelFilter, HotPixelLearner, PixelMask};
use lobula_core::{Block, Event, Filter, Geometry, Span, WrongGeometry};

unsafe fn advance<F: Filter>(filter: *mut F, now: u64) {
    // SAFETY: the caller's promise.
    unsafe { (*filter).advance(now) }
}

unsafe fn keep<F: Filter>(filter: *mut F, event: Event) -> bool {
    // SAFETY: the caller's promise.
    unsafe { (*filter).keep(event) }
}

unsafe fn retain<F: Filter>(
    filter: *mut F,
    times: (u64, u64),
    geometry: Geometry,
    events: (*mut Event, usize),
) -> Result<usize, WrongGeometry> {
    // SAFETY: the caller's promise.
    let (filter, events) = unsafe { (&mut *filter, slice_mut(events.0, events.1)) };
    filter.retain(&mut Block::new(times.0, times.1, geometry, events))
}

unsafe fn learn(
    at: *mut HotPixelLearner<Memory<u32>>,
    geometry: Geometry,
    memory: (*mut u32, usize),
) -> Result<(), FilterError> {
    // SAFETY: the caller's promise.
    let memory = unsafe { slice_mut(memory.0, memory.1) };
    // SAFETY: the caller's promise.
    HotPixelLearner::try_new(geometry, memory).map(|learner| unsafe { at.write(learner) })
}

unsafe fn learn_from(
    learner: *mut HotPixelLearner<Memory<u32>>,
    span: *const Span<'_>,
) -> Result<(), WrongGeometry> {
    // SAFETY: the caller's promise.
    unsafe { (*learner).learn(*span) }
}

unsafe fn mask(
    learner: *const HotPixelLearner<Memory<u32>>,
    sigmas: f32,
    words: (*mut u32, usize),
    at: *mut PixelMask<Memory<u32>>,
) -> Result<(), FilterError> {
    // SAFETY: the caller's promise.
    let words = unsafe { slice_mut(words.0, words.1) };
    // SAFETY: the caller's promise.
    unsafe { (*learner).mask(sigmas, words).map(|mask| at.write(mask)) }
}

unsafe fn mask_pixel(filter: *mut HotPixelFilter<Memory<u32>>, x: u16, y: u16) -> bool {
    // SAFETY: the caller's promise.
    unsafe { (*filter).mask(x, y) }
}

type Memory<T> = &'static mut [T];

macro_rules! filters {
    ($($variant:ident $module:ident: $type:ty, $params:ty, $word:ty, $len:expr, $make:expr;)*) => {
        $(mod $module {
            use super::*;
            #[allow(dead_code, reason = "those without memory name none")]
            type S = Memory<$word>;
            pub type Of = $type;

            fn try_new(
                make: impl Fn(Geometry, $params, Memory<$word>) -> Result<Of, FilterError>,
                (geometry, params, memory): (Geometry, $params, Memory<$word>),
            ) -> Result<Of, FilterError> {
                make(geometry, params, memory)
            }

            pub unsafe fn make(
                at: *mut Of,
                geometry: Geometry,
                params: $params,
                memory: (*mut $word, usize),
            ) -> Result<(), FilterError> {
                // SAFETY: the caller's promise.
                let memory = unsafe { slice_mut(memory.0, memory.1) };
                // SAFETY: the caller's promise.
                try_new($make, (geometry, params, memory)).map(|filter| unsafe { at.write(filter) })
            }

            pub fn required_len(geometry: Geometry, params: &$params) -> usize {
                let len: fn(Geometry, &$params) -> usize = $len;
                len(geometry, params)
            }
        })*

        pub const EXPORTS: &[Export] = &[
            export!(learn),
            export!(learn_from),
            export!(mask),
            export!(mask_pixel),
            // A pipeline, as firmware would have it.
            export!(advance::<(hot_pixel::Of, denoise_u16::Of, region_of_interest::Of)>),
            export!(keep::<(hot_pixel::Of, denoise_u16::Of, region_of_interest::Of)>),
            export!(retain::<(hot_pixel::Of, denoise_u16::Of, region_of_interest::Of)>),
            $(
                export!($module::make),
                export!($module::required_len),
                export!(advance::<$module::Of>),
                export!(keep::<$module::Of>),
                export!(retain::<$module::Of>),
            )*
        ];
    };
}

lobula_core::filters!(filters);
