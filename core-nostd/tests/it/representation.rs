//! Every representation against an oracle over 64-bit times and double precision, and under the laws of all.

use crate::chunk_invariance::Splits;
use crate::streams::{self, Timed};
use crate::window::{oracle, slice};
use lobula_core::representation::{
    Build, Count, Decay, IntegerTimeSurface, Parameters, Pixel, PolarityHistogram, TileCount, TimeSurface,
    VoxelGrid,
};
use lobula_core::{
    Closed, Event, Geometry, Piece, Polarity, Representation, Span, Window, WrongGeometry, f16,
    for_each_representation,
};
use proptest::prelude::*;

pub const GEOMETRY: Geometry = Geometry::new(16, 4);
pub const PIXELS: usize = GEOMETRY.pixels();

/// What a representation is built from in tests: small, and with a decay that shows.
fn parameters() -> Parameters {
    let mut parameters = Parameters::default();
    (parameters.bins, parameters.tau_us, parameters.tile_px) = (5, 2_000, 2);
    parameters
}

/// Tensors of the windows of a stream that are [heard](crate::window::Sliced::heard), through the slicer; before each, the memory holds
/// garbage.
pub fn render<R: Representation>(
    stage: &mut R,
    events: &[Timed],
    period_us: u32,
    splits: &mut Splits,
) -> Vec<(Window, Vec<R::Pixel>)> {
    let mut out = vec![bytemuck::Zeroable::zeroed(); stage.shape().len()];
    let mut tensors = vec![];
    let (mut silent, mut unbegun) = (false, None);
    let begin = |stage: &mut R, window: Window, out: &mut [R::Pixel]| {
        bytemuck::cast_slice_mut::<_, u8>(out).fill(0xA5);
        stage.begin(window, out);
    };
    slice(events, period_us, GEOMETRY, splits, |piece| match piece {
        Piece::Begin(window) => unbegun = Some(window),
        Piece::Events(span) => {
            unbegun.take().into_iter().for_each(|window| begin(stage, window, &mut out));
            stage.accumulate(span, &mut out).unwrap();
        }
        Piece::End(Closed { window, events, .. }) => {
            if events > 0 || !silent {
                unbegun.take().into_iter().for_each(|window| begin(stage, window, &mut out));
                stage.finish(&mut out);
                tensors.push((window, out.clone()));
            }
            silent = events == 0;
        }
    });
    tensors
}

pub fn pixel(event: Event) -> usize {
    GEOMETRY.index(event.x(), event.y())
}

/// Pixel in the planes ON, OFF.
pub fn pixel_by_polarity(event: Event) -> usize {
    pixel(event) + if event.is_on() { 0 } else { PIXELS }
}

pub fn counts(inside: &[Timed], cells: usize, cell: impl Fn(Event) -> usize) -> Vec<u64> {
    let mut counts = vec![0; cells];
    inside.iter().for_each(|timed| counts[cell(timed.event)] += 1);
    counts
}

/// Checks a counting representation in each window: as many as the oracle, up to `max`, the rest in `saturated`.
fn check_counts<R: Representation + Build<Vec<u32>>>(
    mut stage: R,
    events: &[Timed],
    max: u64,
    cell: impl Fn(Event) -> usize,
    value: impl Fn(&R::Pixel) -> u64,
) {
    let windows = oracle(events, 5_000).heard();
    let tensors = render(&mut stage, events, 5_000, &mut Splits::Random(7));
    assert_eq!(tensors.len(), windows.len());
    let mut saturated = 0;
    for ((window, tensor), (expected, inside)) in tensors.iter().zip(&windows) {
        assert_eq!(window, expected);
        let counts = counts(inside, tensor.len(), &cell);
        saturated += counts.iter().map(|n| n.saturating_sub(max)).sum::<u64>();
        let clipped: Vec<u64> = counts.iter().map(|n| *n.min(&max)).collect();
        assert_eq!(tensor.iter().map(&value).collect::<Vec<_>>(), clipped);
    }
    assert_eq!(stage.saturated(), saturated);
}

/// The voxel grid by its definition, in double precision.
pub fn voxel(window: Window, inside: &[Timed], bins: usize) -> Vec<f64> {
    let mut out = vec![0.0; bins * PIXELS];
    for timed in inside {
        let age = timed.t.max(window.t0) - window.t0;
        let position = age as f64 / (window.t1 - window.t0) as f64 * (bins - 1) as f64;
        let sign = if timed.event.is_on() { 1.0 } else { -1.0 };
        for bin in 0..bins {
            let share = 1.0 - (position - bin as f64).abs();
            out[bin * PIXELS + pixel(timed.event)] += sign * share.max(0.0);
        }
    }
    out
}

fn check_voxel(events: &[Timed], period_us: u32, bins: u16) {
    let mut stage = VoxelGrid::try_new(GEOMETRY, bins).unwrap();
    let tensors = render(&mut stage, events, period_us, &mut Splits::Random(3));
    let windows = oracle(events, period_us).heard();
    assert_eq!(tensors.len(), windows.len());
    for ((window, tensor), (expected, inside)) in tensors.iter().zip(&windows) {
        assert_eq!(window, expected);
        let tolerance = 1e-6 * f64::from(bins) * (1 + inside.len()) as f64;
        for (found, expected) in tensor.iter().zip(voxel(*window, inside, bins.into())) {
            assert!((f64::from(*found) - expected).abs() <= tolerance, "{found} {expected} {period_us}");
        }
    }
}

/// A time surface that keeps 64-bit times and knows of every window.
fn check_surface(events: &[Timed], period_us: u32, tau_us: u32) {
    let mut stage = TimeSurface::<f32, _>::try_new(GEOMETRY, tau_us, vec![0xDEAD_BEEF; 2 * PIXELS]).unwrap();
    let tensors = render(&mut stage, events, period_us, &mut Splits::Random(5));
    let windows = oracle(events, period_us).heard();
    assert_eq!(tensors.len(), windows.len());
    let mut last: Vec<Option<u64>> = vec![None; 2 * PIXELS];
    let mut before = 0;
    for ((window, tensor), (expected, inside)) in tensors.iter().zip(&windows) {
        assert_eq!(window, expected);
        if window.t1 < before {
            last.fill(None); // the clock has restarted
        }
        before = window.t1;
        inside.iter().for_each(|timed| last[pixel_by_polarity(timed.event)] = Some(timed.t.max(window.t0)));
        for (found, last) in tensor.iter().zip(&last) {
            let age = last.map(|t| window.t1 - t);
            match age.filter(|age| *age < 32 * u64::from(tau_us)) {
                None => assert_eq!(*found, 0.0, "age {age:?}"),
                Some(age) => {
                    let expected = (-(age as f64) / f64::from(tau_us)).exp();
                    assert!((f64::from(*found) / expected - 1.0).abs() < 1e-5, "{found} {expected}");
                }
            }
        }
    }
}

/// The integer surface with 64-bit times, and its decay in double precision.
fn check_surface_u8(events: &[Timed], period_us: u32, tau_us: u32) {
    for (decay, share) in [
        (Decay::Exponential, (|decays| (-decays).exp()) as fn(f64) -> f64),
        (Decay::Linear, |decays| (1.0 - decays).max(0.0)),
    ] {
        check_decay_u8(events, period_us, tau_us, decay, share);
    }
}

fn check_decay_u8(events: &[Timed], period_us: u32, tau_us: u32, decay: Decay, share: fn(f64) -> f64) {
    let tick = u64::from(IntegerTimeSurface::<()>::tick_us(tau_us));
    let state = vec![0xDEAD_BEEF; IntegerTimeSurface::<()>::state_len(GEOMETRY)];
    let mut stage = IntegerTimeSurface::try_new(GEOMETRY, tau_us, state).unwrap().with_decay(decay);
    let tensors = render(&mut stage, events, period_us, &mut Splits::Random(5));
    let windows = oracle(events, period_us).heard();
    assert_eq!(tensors.len(), windows.len());
    let mut last: Vec<Option<u64>> = vec![None; 2 * PIXELS];
    let mut before = 0;
    for ((window, tensor), (_, inside)) in tensors.iter().zip(&windows) {
        if window.t1 < before {
            last.fill(None); // the clock has restarted
        }
        before = window.t1;
        inside.iter().for_each(|timed| last[pixel_by_polarity(timed.event)] = Some(timed.t.max(window.t0)));
        for (found, last) in tensor.iter().zip(&last) {
            let decays = |t: u64| ((window.t1 / tick - t / tick) * tick) as f64 / f64::from(tau_us);
            let expected = last.map_or(0.0, |t| 255.0 * share(decays(t)));
            assert!((f64::from(*found) - expected).abs() < 0.5 + 1e-4, "{found} {expected} tau {tau_us}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..Default::default() })]

    #[test]
    fn counts_as_the_oracle(events in streams::stream(GEOMETRY, 400)) {
        check_counts(Count::<u8>::new(GEOMETRY), &events, 255, pixel, |n| u64::from(*n));
        check_counts(Count::<u16>::new(GEOMETRY), &events, 65_535, pixel, |n| u64::from(*n));
        check_counts(Count::<f32>::new(GEOMETRY), &events, 1 << 24, pixel, |n| *n as u64);
    }

    #[test]
    fn counts_polarities_as_the_oracle(events in streams::stream(GEOMETRY, 400)) {
        let cell = pixel_by_polarity;
        check_counts(PolarityHistogram::<u8>::new(GEOMETRY), &events, 255, cell, |n| u64::from(*n));
        check_counts(PolarityHistogram::<u16>::new(GEOMETRY), &events, 65_535, cell, |n| u64::from(*n));
        check_counts(PolarityHistogram::<f32>::new(GEOMETRY), &events, 1 << 24, cell, |n| *n as u64);
    }

    #[test]
    fn voxels_as_the_oracle(
        events in streams::stream(GEOMETRY, 400),
        period_us in prop_oneof![1u32..50, 50u32..1_000_000, 1_000_000u32..1 << 30],
        bins in 1u16..12,
    ) {
        check_voxel(&events, period_us, bins);
    }

    /// Times up to 100 hours and far beyond 2^32 µs, decays from 1 µs to the longest.
    #[test]
    fn surfaces_as_the_oracle_through_long_silence(
        events in streams::stream(GEOMETRY, 300),
        period_us in prop_oneof![1u32..50, 50u32..1_000_000, 1_000_000u32..1 << 30],
        tau_us in prop_oneof![1u32..100, 100u32..100_000, 100_000u32..=1 << 25],
    ) {
        check_surface(&events, period_us, tau_us);
        check_surface_u8(&events, period_us, tau_us);
    }

    #[test]
    fn counts_tiles_as_the_oracle(events in streams::stream(GEOMETRY, 400), log2 in 0u32..16) {
        let tile = 1u16 << log2;
        let in_row = usize::from(GEOMETRY.width.div_ceil(tile));
        let cell = |event: Event| usize::from(event.y() / tile) * in_row + usize::from(event.x() / tile);
        check_counts(TileCount::<u16>::try_new(GEOMETRY, tile).unwrap(), &events, 65_535, cell, |n| u64::from(*n));
        check_counts(TileCount::<f32>::try_new(GEOMETRY, tile).unwrap(), &events, 1 << 24, cell, |n| *n as u64);
    }
}

/// The ages at which 32 bits would alias, and the edge of what is seen.
#[test]
fn surfaces_hold_at_the_edges_of_32_bits() {
    let tau_us = 1 << 25;
    for period_us in [1_000_000, 1 << 28, (1 << 30) - 1] {
        for gap in [1u64 << 30, 1 << 31, 1 << 32, (1 << 32) + (1 << 30), 1 << 33, 360_000_000_000] {
            for edge in -2i64..=2 {
                let times = [7, 8, gap.wrapping_add_signed(edge), gap.wrapping_add_signed(edge) + 1];
                let timed = |(x, t): (usize, &u64)| Timed::new(*t, x as u16, 0, Polarity::On);
                let events: Vec<Timed> = times.iter().enumerate().map(timed).collect();
                check_surface(&events, period_us, tau_us);
                check_surface_u8(&events, period_us, tau_us);
            }
        }
    }
}

/// Hours of events, so that the map is brought down many times while it is in use.
#[test]
fn surfaces_hold_through_hours_of_events() {
    let events: Vec<Timed> = (0..2_000u64)
        .map(|i| Timed::new(i * 20_000_003, (i * 7 % 16) as u16, (i / 500) as u16, Polarity::On))
        .collect();
    for check in [check_surface, check_surface_u8] {
        check(&events, 50_000_000, 1 << 25);
        check(&events, (1 << 30) - 1, 1 << 25);
    }
}

#[test]
fn counters_stop_at_their_greatest_number_and_say_so() {
    let events = vec![Timed::new(1, 3, 2, Polarity::Off); 70_000];
    check_counts(Count::<u8>::new(GEOMETRY), &events, 255, pixel, |n| u64::from(*n));
    check_counts(Count::<u16>::new(GEOMETRY), &events, 65_535, pixel, |n| u64::from(*n));
    let cell = pixel_by_polarity;
    check_counts(PolarityHistogram::<u8>::new(GEOMETRY), &events, 255, cell, |n| u64::from(*n));
    check_counts(PolarityHistogram::<u16>::new(GEOMETRY), &events, 65_535, cell, |n| u64::from(*n));
}

/// Ages from the newest event, as other libraries count them: a window that ends at its time.
#[test]
fn a_window_to_the_newest_event_counts_ages_from_it() {
    let inside =
        [(1_000, 0), (1_300, 1), (1_800, 2), (2_000, 3)].map(|(t, x)| Timed::new(t, x, 0, Polarity::On));
    let window = Window { t0: 1_000, t1: 2_000 };
    let memory = streams::block_events(&inside);
    let span = Span { t_first: 1_000, t_last: 2_000, geometry: GEOMETRY, events: &memory };
    let mut out = vec![0.0; 5 * PIXELS];
    let mut stage = VoxelGrid::try_new(GEOMETRY, 5).unwrap();
    stage.begin(window, &mut out);
    stage.accumulate(span, &mut out).unwrap();
    stage.finish(&mut out);
    for (found, expected) in out.iter().zip(voxel(window, &inside, 5)) {
        assert!((f64::from(*found) - expected).abs() < 1e-6);
    }
    assert_eq!(out[4 * PIXELS + 3], 1.0);
}

macro_rules! laws_of_all {
    ($($variant:ident $kind:ident $type:ty;)*) => {
        $(
            #[allow(non_snake_case)]
            mod $variant {
                use super::*;

                fn build(geometry: Geometry) -> $type {
                    let state = vec![0x5A5A_5A5A; <$type as Build<Vec<u32>>>::state_len(&parameters(), geometry)];
                    <$type>::build(&parameters(), geometry, state).unwrap()
                }

                chunk_invariance!(representation split, |geometry| super::build(geometry));

                #[test]
                fn refuses_another_geometry() {
                    let mut stage = build(GEOMETRY);
                    let found = Geometry::new(17, 4);
                    let span = Span { t_first: 0, t_last: 0, geometry: found, events: &[] };
                    let wrong = WrongGeometry { expected: GEOMETRY, found };
                    assert_eq!(stage.accumulate(span, &mut []), Err(wrong));
                }

                /// A tensor cut short is drawn as far as it goes, and one too long has its head right.
                #[test]
                fn takes_memory_of_any_length() {
                    let events = [Event::new(4, 15, 3, Polarity::Off), Event::new(5, 0, 0, Polarity::On)];
                    let span = Span { t_first: 4, t_last: 5, geometry: GEOMETRY, events: &events };
                    let draw = |len: usize| {
                        let mut stage = build(GEOMETRY);
                        let mut out = vec![bytemuck::Zeroable::zeroed(); len];
                        stage.begin(Window { t0: 0, t1: 10 }, &mut out);
                        stage.accumulate(span, &mut out).unwrap();
                        stage.finish(&mut out);
                        out
                    };
                    let len = build(GEOMETRY).shape().len();
                    let whole = draw(len);
                    assert!(bytemuck::cast_slice::<_, u8>(&whole).iter().any(|byte| *byte != 0));
                    for other in [0, 1, PIXELS, len - 1, len + 1, 2 * len] {
                        let out = draw(other);
                        let common = len.min(other);
                        assert_eq!(out[..common], whole[..common], "length {other}");
                    }
                }

                /// Events, windows and coordinates that no slicer or decoder would give.
                #[test]
                fn never_panics() {
                    let mut stage = build(GEOMETRY);
                    let mut out = vec![bytemuck::Zeroable::zeroed(); stage.shape().len()];
                    let corners = [0, 1, 1 << 31, u64::from(u32::MAX), 1 << 40, u64::MAX];
                    for (t0, t1) in corners.iter().flat_map(|t0| corners.map(|t1| (*t0, t1))) {
                        stage.begin(Window { t0, t1 }, &mut out);
                        for t in corners {
                            let events = [Event::new(t as u32, u16::MAX, 0x7FFF, Polarity::Off)];
                            let span = Span { t_first: t, t_last: t, geometry: GEOMETRY, events: &events };
                            stage.accumulate(span, &mut out).unwrap();
                        }
                        stage.finish(&mut out);
                    }
                }

                #[test]
                fn says_its_type() {
                    let bytes = size_of::<<$type as Representation>::Pixel>();
                    assert_eq!(<$type as Representation>::Pixel::DTYPE.bytes(), bytes);
                }
            }
        )*
    };
}

for_each_representation!(laws_of_all, Vec<u32>);

#[test]
fn half_precision_is_the_nearest_to_single() {
    let events: Vec<Timed> =
        (0..64).map(|i| Timed::new(i * 37, i as u16 % 16, i as u16 / 16, Polarity::On)).collect();
    let state = || vec![0; 2 * PIXELS];
    let mut single = TimeSurface::<f32, _>::try_new(GEOMETRY, 500, state()).unwrap();
    let mut half = TimeSurface::<f16, _>::try_new(GEOMETRY, 500, state()).unwrap();
    let single = render(&mut single, &events, 700, &mut Splits::Whole);
    let half = render(&mut half, &events, 700, &mut Splits::Whole);
    for ((_, single), (_, half)) in single.iter().zip(&half) {
        let nearest: Vec<f16> = single.iter().map(|value| f16::from_f32(*value)).collect();
        assert_eq!(*half, nearest);
    }
}

#[test]
fn refuses_what_makes_no_sense() {
    assert!(VoxelGrid::try_new(GEOMETRY, 0).is_err());
    for tau_us in [0, (1 << 25) + 1, u32::MAX] {
        assert!(TimeSurface::<f32, _>::try_new(GEOMETRY, tau_us, vec![0; 2 * PIXELS]).is_err(), "{tau_us}");
    }
    for tile_px in [0, 3, 100, u16::MAX] {
        assert!(TileCount::<u16>::try_new(GEOMETRY, tile_px).is_err(), "{tile_px}");
    }
    for tau_us in [0, (1 << 25) + 1] {
        let state = vec![0; IntegerTimeSurface::<()>::state_len(GEOMETRY)];
        assert!(IntegerTimeSurface::try_new(GEOMETRY, tau_us, state).is_err(), "{tau_us}");
    }
    assert!(IntegerTimeSurface::try_new(GEOMETRY, 1, vec![0; PIXELS]).is_err());
    for len in [0, 2 * PIXELS - 1, 2 * PIXELS + 1] {
        assert!(TimeSurface::<f32, _>::try_new(GEOMETRY, 1, vec![0; len]).is_err(), "{len}");
    }
}
