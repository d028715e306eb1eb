//! Every representation of [`lobula_core::for_each_representation`], alone and cut by a slicer.

use crate::export;
use crate::export::{Export, slice_mut};
use lobula_core::representation::{
    BadRepresentation, Build, Eraser, LastEvent, Parameters, Sliding, Tencode,
};
use lobula_core::{
    BadGrid, BadPeriod, CountSlicer, Event, Geometry, Grid, Piece, Representation, Shape, Slicer, Slide,
    SlidingSlicer, Span, Stride, Window, WrongGeometry, for_each_representation,
};

type State = &'static mut [u32];

unsafe fn make<R: Build<State>>(
    at: *mut R,
    parameters: *const Parameters,
    geometry: Geometry,
    state: (*mut u32, usize),
) -> Result<Shape, BadRepresentation> {
    // SAFETY: the caller's promise.
    let made = unsafe { R::build(&*parameters, geometry, slice_mut(state.0, state.1)) }?;
    let shape = made.shape();
    // SAFETY: the caller's promise.
    unsafe { at.write(made) };
    Ok(shape)
}

fn lens<R: Build<State>>(parameters: &Parameters, geometry: Geometry, shape: Shape) -> (usize, usize) {
    (R::state_len(parameters, geometry), shape.len())
}

unsafe fn begin<R: Representation>(stage: *mut R, window: Window, out: (*mut R::Pixel, usize)) {
    // SAFETY: the caller's promise.
    unsafe { (*stage).begin(window, slice_mut(out.0, out.1)) }
}

unsafe fn accumulate<R: Representation>(
    stage: *mut R,
    span: *const Span<'_>,
    out: (*mut R::Pixel, usize),
) -> Result<(), WrongGeometry> {
    // SAFETY: the caller's promise.
    unsafe { (*stage).accumulate(*span, slice_mut(out.0, out.1)) }
}

unsafe fn finish<R: Representation>(stage: *mut R, out: (*mut R::Pixel, usize)) {
    // SAFETY: the caller's promise.
    unsafe { (*stage).finish(slice_mut(out.0, out.1)) }
}

/// A view as firmware would drive it.
unsafe fn view<R: Representation>(
    stage: *mut R,
    slicer: *mut Slicer,
    span: *const Span<'_>,
    now: u64,
    out: (*mut R::Pixel, usize),
    done: extern "C" fn(u64, u64),
) {
    // SAFETY: the caller's promise.
    let (stage, slicer, span, out) = unsafe { (&mut *stage, &mut *slicer, *span, slice_mut(out.0, out.1)) };
    let mut each = |piece: Piece<'_>| match piece {
        Piece::Begin(window) => stage.begin(window, out),
        Piece::Events(span) => {
            let _ = stage.accumulate(span, out);
        }
        Piece::End(closed) => {
            stage.finish(out);
            done(closed.window.t1, closed.events);
        }
    };
    slicer.push(span, &mut each);
    slicer.advance(now, &mut each);
}

/// A window in memory that was kept.
unsafe fn erased<R: Representation>(
    stage: *mut R,
    eraser: *mut Eraser<State>,
    span: *const Span<'_>,
    out: (*mut R::Pixel, usize),
) -> Result<(), WrongGeometry> {
    // SAFETY: the caller's promise.
    let (stage, eraser, span, out) = unsafe { (&mut *stage, &mut *eraser, *span, slice_mut(out.0, out.1)) };
    eraser.begin(stage, Window { t0: span.t_first, t1: span.t_last }, out);
    eraser.accumulate(stage, span, out)
}

unsafe fn eraser(at: *mut Eraser<State>, shape: Shape, log: (*mut u32, usize)) -> usize {
    // SAFETY: the caller's promise.
    unsafe { at.write(Eraser::new(shape, slice_mut(log.0, log.1))) };
    Eraser::<State>::state_len(shape)
}

unsafe fn end(slicer: *mut Slicer, now: u64, done: extern "C" fn(u64, u64)) {
    let each = |piece: Piece<'_>| {
        if let Piece::End(closed) = piece {
            done(closed.window.t1, closed.late);
        }
    };
    // SAFETY: the caller's promise.
    unsafe { (*slicer).finish(now, each) }
}

unsafe fn slicer(at: *mut Slicer, period_us: u32) -> Result<(), BadPeriod> {
    // SAFETY: the caller's promise.
    Slicer::try_new(period_us).map(|slicer| unsafe { at.write(slicer) })
}

type Overlapping = SlidingSlicer<&'static mut [Stride], &'static mut [Event]>;

unsafe fn slide(
    at: *mut Overlapping,
    grid: Grid,
    geometry: Geometry,
    strides: (*mut Stride, usize),
    events: (*mut Event, usize),
) -> Result<(), BadGrid> {
    // SAFETY: the caller's promise.
    let (strides, events) = unsafe { (slice_mut(strides.0, strides.1), slice_mut(events.0, events.1)) };
    // SAFETY: the caller's promise.
    SlidingSlicer::try_new(grid, geometry, strides, events).map(|slicer| unsafe { at.write(slicer) })
}

/// A view of windows that overlap, as firmware would drive it.
unsafe fn slides<R: Representation>(
    stage: *mut R,
    slicer: *mut Overlapping,
    span: *const Span<'_>,
    sum: (*mut R::Pixel, usize),
    out: (*mut R::Pixel, usize),
    done: extern "C" fn(u64, u64),
) -> Result<(), WrongGeometry> {
    // SAFETY: the caller's promise.
    let (stage, slicer, span) = unsafe { (&mut *stage, &mut *slicer, *span) };
    // SAFETY: the caller's promise.
    let (sum, out) = unsafe { (slice_mut(sum.0, sum.1), slice_mut(out.0, out.1)) };
    let mut sliding = Sliding::new();
    let mut each = |slide: &Slide<'_>| {
        let _ = sliding.draw(stage, slide, sum, out);
        done(slide.closed.window.t1, slide.len() as u64);
    };
    slicer.push(span, &mut each)?;
    slicer.advance(span.t_last, &mut each);
    slicer.finish(span.t_last, &mut each);
    done(slicer.late() + slicer.skipped() + slicer.overflowed(), Sliding::sum_len(stage) as u64);
    Ok(())
}

type Kept = LastEvent<Tencode<State>, &'static mut [Event]>;

unsafe fn keep(
    at: *mut Kept,
    geometry: Geometry,
    window_us: Option<u32>,
    events: (*mut Event, usize),
    state: (*mut u32, usize),
) -> Result<(), BadRepresentation> {
    // SAFETY: the caller's promise.
    let (events, state) = unsafe { (slice_mut(events.0, events.1), slice_mut(state.0, state.1)) };
    let tencode = Tencode::try_new(geometry, state)?;
    // SAFETY: the caller's promise.
    LastEvent::try_new(tencode, geometry, window_us, events).map(|kept| unsafe { at.write(kept) })
}

unsafe fn count(
    slicer: *mut CountSlicer,
    span: *const Span<'_>,
    done: extern "C" fn(u64, u64),
) -> Option<CountSlicer> {
    let mut each = |piece: Piece<'_>| {
        if let Piece::End(closed) = piece {
            done(closed.window.t1, closed.events);
        }
    };
    // SAFETY: the caller's promise.
    let (slicer, span) = unsafe { (&mut *slicer, *span) };
    slicer.push(span, &mut each);
    slicer.finish(&mut each);
    CountSlicer::try_new(span.t_first as u32)
}

macro_rules! representations {
    ($($variant:ident $kind:ident $type:ty;)+) => {
        pub const EXPORTS: &[Export] = &[
            export!(slicer),
            export!(end),
            export!(eraser),
            export!(count),
            export!(slide),
            export!(slides::<Kept>),
            export!(keep),
            export!(begin::<Kept>),
            export!(accumulate::<Kept>),
            export!(finish::<Kept>),
            $(
                export!(make::<$type>),
                export!(lens::<$type>),
                export!(begin::<$type>),
                export!(accumulate::<$type>),
                export!(finish::<$type>),
                export!(erased::<$type>),
                export!(view::<$type>),
                export!(slides::<$type>),
            )+
        ];
    };
}

for_each_representation!(representations, State);
