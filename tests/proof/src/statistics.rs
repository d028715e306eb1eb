//! Statistics of streams.

use crate::export;
use crate::export::{Export, slice_mut};
use lobula_core::statistics::{BadStatistic, EventRate, Intervals, PixelIntervals, PixelTimes, Tally};
use lobula_core::{Geometry, Span, WrongGeometry};

type Rate = EventRate<&'static mut [Tally]>;
type Silence = Intervals<&'static mut [PixelTimes]>;

unsafe fn rate(
    at: *mut Rate,
    start: u64,
    bin_us: u64,
    bins: (*mut Tally, usize),
) -> Result<(), BadStatistic> {
    // SAFETY: the caller's promise.
    unsafe { EventRate::try_new(start, bin_us, slice_mut(bins.0, bins.1)).map(|rate| at.write(rate)) }
}

unsafe fn count(rate: *mut Rate, span: *const Span<'_>) -> f64 {
    // SAFETY: the caller's promise.
    let (rate, span) = unsafe { (&mut *rate, *span) };
    rate.push(span);
    rate.total().balance() + rate.total().per_second(rate.bin_us())
}

unsafe fn intervals(
    at: *mut Silence,
    geometry: Geometry,
    pixels: (*mut PixelTimes, usize),
) -> Result<(), BadStatistic> {
    // SAFETY: the caller's promise.
    unsafe { Intervals::try_new(geometry, slice_mut(pixels.0, pixels.1)).map(|made| at.write(made)) }
}

unsafe fn note(intervals: *mut Silence, span: *const Span<'_>) -> Result<Option<f64>, WrongGeometry> {
    // SAFETY: the caller's promise.
    let (intervals, span) = unsafe { (&mut *intervals, *span) };
    intervals.push(span)?;
    Ok(intervals.pixels().first().and_then(|pixel| pixel.mean_interval_us()))
}

type Silences = PixelIntervals<&'static mut [PixelTimes], &'static mut [u32]>;

unsafe fn histograms(
    at: *mut Silences,
    geometry: Geometry,
    pixels: (*mut PixelTimes, usize),
    counts: (*mut u32, usize),
) -> Result<(), BadStatistic> {
    // SAFETY: the caller's promise.
    let (pixels, counts) = unsafe { (slice_mut(pixels.0, pixels.1), slice_mut(counts.0, counts.1)) };
    // SAFETY: the caller's promise.
    PixelIntervals::try_new(geometry, pixels, counts).map(|made| unsafe { at.write(made) })
}

unsafe fn tally(
    silences: *mut Silences,
    span: *const Span<'_>,
    at: (u16, u16),
) -> Result<usize, WrongGeometry> {
    // SAFETY: the caller's promise.
    let (silences, span) = unsafe { (&mut *silences, *span) };
    silences.push(span)?;
    Ok(silences.histogram(at.0, at.1).len())
}

pub const EXPORTS: &[Export] =
    &[export!(rate), export!(count), export!(intervals), export!(note), export!(histograms), export!(tally)];
