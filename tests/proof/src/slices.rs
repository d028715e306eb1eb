//! Operations on whole slices, the merge, and what adds events.

use crate::export;
use crate::export::{Export, slice_mut};
use lobula_core::augmentation::{
    ChanceParams, NoiseInjection, NoiseInjectionParams, RandomTimeReversal, Seed,
};
use lobula_core::merge::{Merge, MergeInput};
use lobula_core::slice::{SliceNormalize, SliceReverse, SliceSort};
use lobula_core::transform::TransformError;
use lobula_core::{Block, Event, Geometry, Sink, Span, WrongGeometry};

type Memory = &'static mut [Event];

unsafe fn sort(slice: *mut Block<'_>, scratch: (*mut Event, usize)) -> Result<(), TransformError> {
    // SAFETY: the caller's promise.
    let (slice, scratch) = unsafe { (&mut *slice, slice_mut(scratch.0, scratch.1)) };
    SliceSort::new(scratch).apply(slice)
}

unsafe fn reverse(slice: *mut Block<'_>, scratch: (*mut Event, usize)) -> Result<(), TransformError> {
    // SAFETY: the caller's promise.
    let (slice, scratch) = unsafe { (&mut *slice, slice_mut(scratch.0, scratch.1)) };
    SliceReverse::new(scratch).apply(slice)
}

unsafe fn reverse_maybe(
    slice: *mut Block<'_>,
    scratch: (*mut Event, usize),
    p: f64,
    seed: Seed,
) -> Result<(), TransformError> {
    // SAFETY: the caller's promise.
    let (slice, scratch): (_, Memory) = unsafe { (&mut *slice, slice_mut(scratch.0, scratch.1)) };
    RandomTimeReversal::try_new(ChanceParams { p }, seed, scratch)?.apply(slice)
}

unsafe fn normalize(slice: *mut Block<'_>) {
    // SAFETY: the caller's promise.
    SliceNormalize.apply(unsafe { &mut *slice });
}

unsafe fn merge(
    geometry: Geometry,
    inputs: (*mut MergeInput<'static>, usize),
    sink: *mut Sink<'_>,
) -> Result<usize, WrongGeometry> {
    // SAFETY: the caller's promise.
    let (inputs, sink) = unsafe { (slice_mut(inputs.0, inputs.1), &mut *sink) };
    Merge::new(geometry).merge(inputs, sink)
}

unsafe fn noise(
    at: *mut NoiseInjection,
    geometry: Geometry,
    params: NoiseInjectionParams,
    seed: Seed,
) -> Result<u64, TransformError> {
    let made = NoiseInjection::try_new(geometry, params, seed)?;
    let count = made.added_in_all();
    // SAFETY: the caller's promise.
    unsafe { at.write(made) };
    Ok(count)
}

unsafe fn inject(
    noise: *mut NoiseInjection,
    span: *const Span<'_>,
    sink: *mut Sink<'_>,
) -> Result<(usize, bool), WrongGeometry> {
    // SAFETY: the caller's promise.
    let (noise, span, sink) = unsafe { (&mut *noise, *span, &mut *sink) };
    let taken = noise.inject(span, sink)?;
    Ok((taken, noise.finish(sink)))
}

pub const EXPORTS: &[Export] = &[
    export!(sort),
    export!(reverse),
    export!(reverse_maybe),
    export!(normalize),
    export!(merge),
    export!(noise),
    export!(inject),
];
