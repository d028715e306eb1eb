//! Representations that are a function of a window's events, and those that know of the windows before, each against its
//! formula over 64-bit times in double precision.

use crate::chunk_invariance::Splits;
use crate::representation::{GEOMETRY, PIXELS, counts, pixel, pixel_by_polarity, render, voxel};
use crate::streams::{self, Timed};
use crate::window::oracle;
use lobula_core::representation::*;
use lobula_core::{CountSlicer, Event, Geometry, Piece, Polarity, Representation, Window};
use proptest::prelude::*;

const PERIOD_US: u32 = 5_000;

/// Checks every element of every window within `tolerance` of what `oracle` gives; it sees the windows in order.
pub fn check<R: Representation<Pixel: Into<f64>>>(
    mut stage: R,
    events: &[Timed],
    tolerance: f64,
    mut formula: impl FnMut(Window, &[Timed]) -> Vec<f64>,
) {
    let tensors = render(&mut stage, events, PERIOD_US, &mut Splits::Random(11));
    let windows = oracle(events, PERIOD_US).heard();
    assert_eq!(tensors.len(), windows.len());
    for ((window, tensor), (_, inside)) in tensors.iter().zip(&windows) {
        let expected = formula(*window, inside);
        assert_eq!(tensor.len(), expected.len());
        for (at, (found, expected)) in tensor.iter().zip(&expected).enumerate() {
            let found: f64 = (*found).into();
            assert!((found - expected).abs() <= tolerance, "element {at}: {found}, expected {expected}");
        }
    }
}

/// Age from the window's end; what is older than the window counts at its start.
pub fn age(window: Window, timed: &Timed) -> f64 {
    (window.t1 - timed.t.max(window.t0)) as f64
}

/// The last event of each of `cells`, which is remembered until the clock restarts.
struct Last {
    of: Vec<Option<(u64, bool)>>,
    before: u64,
}

impl Last {
    fn new(cells: usize) -> Self {
        Self { of: vec![None; cells], before: 0 }
    }

    /// Ages at the window's end, and whether ON.
    fn ages(
        &mut self,
        window: Window,
        inside: &[Timed],
        cell: fn(lobula_core::Event) -> usize,
    ) -> Vec<Option<(f64, bool)>> {
        if window.t1 < self.before {
            self.of.fill(None);
        }
        self.before = window.t1;
        for timed in inside {
            self.of[cell(timed.event)] = Some((timed.t.max(window.t0), timed.event.is_on()));
        }
        self.of.iter().map(|last| last.map(|(t, on)| ((window.t1 - t) as f64, on))).collect()
    }
}

/// What numpy's `percentile` gives for all that is not 0.
fn percentile(counts: &[u64], percent: f64) -> f64 {
    let mut counts: Vec<u64> = counts.iter().copied().filter(|count| *count > 0).collect();
    counts.sort_unstable();
    let Some(last) = counts.len().checked_sub(1) else { return 1.0 };
    let position = last as f64 * percent / 100.0;
    let (low, high) = (counts[position.floor() as usize] as f64, counts[position.ceil() as usize] as f64);
    low + (high - low) * position.fract()
}

fn tencode(geometry: Geometry) -> Tencode<Vec<u32>> {
    Tencode::try_new(geometry, state(geometry.pixels().div_ceil(2))).unwrap()
}

pub fn state(len: usize) -> Vec<u32> {
    vec![0xDEAD_BEEF; len]
}

/// Bursts at few pixels, so that counts go over 255.
fn bursts() -> impl Strategy<Value = Vec<Timed>> {
    let burst = (1usize..600, 0u16..16, 0u16..4, any::<bool>());
    proptest::collection::vec(burst, 0..12).prop_map(|bursts| {
        let of = |(n, x, y, on): (usize, u16, u16, bool)| {
            std::iter::repeat_n(Timed::new(7, x, y, if on { Polarity::On } else { Polarity::Off }), n)
        };
        bursts.into_iter().flat_map(of).collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 24, ..Default::default() })]

    #[test]
    fn binary_and_frames(events in streams::stream(GEOMETRY, 400)) {
        check(Binary::new(GEOMETRY), &events, 0.0, |_, inside| {
            counts(inside, PIXELS, pixel).iter().map(|count| f64::from(*count > 0)).collect()
        });
        let sign = |timed: &Timed| if timed.event.is_on() { 1.0 } else { -1.0 };
        let sums = |inside: &[Timed]| {
            let mut sums = vec![0.0; PIXELS];
            inside.iter().for_each(|timed| sums[pixel(timed.event)] += sign(timed));
            sums
        };
        let latest = |inside: &[Timed]| {
            let mut signs = vec![0.0; PIXELS];
            inside.iter().for_each(|timed| signs[pixel(timed.event)] = sign(timed));
            signs
        };
        check(EventFrame::<f32>::new(GEOMETRY, Combine::Sum), &events, 0.0, |_, inside| sums(inside));
        check(EventFrame::<f32>::new(GEOMETRY, Combine::Latest), &events, 0.0, |_, inside| latest(inside));
        check(EventFrame::<u8>::new(GEOMETRY, Combine::Latest), &events, 0.0, |_, inside| {
            latest(inside).iter().map(|sign| 128.0 + sign).collect()
        });
    }

    #[test]
    fn shares_of_the_greatest_count(events in streams::stream(GEOMETRY, 400), burst in bursts()) {
        for events in [events, burst] {
            let stage = SlicePolarityHistogram::try_new(GEOMETRY, state(2 * PIXELS)).unwrap();
            check(stage, &events, 0.0, |_, inside| {
                let counts = counts(inside, 2 * PIXELS, pixel_by_polarity);
                let max = counts.iter().copied().max().unwrap().max(1) as f64;
                counts.iter().map(|count| (255.0 * *count as f64 / max + 0.5 - 0.5 * (max % 2.0) / max).floor()).collect()
            });
        }
    }

    #[test]
    fn images_of_counts(
        events in streams::stream(GEOMETRY, 400),
        burst in bursts(),
        percent in 0u8..=100,
        white: bool,
    ) {
        for events in [events, burst] {
            let background = if white { Background::White } else { Background::Black };
            let stage = SliceCountmask::try_new(GEOMETRY, percent, background, state(2 * PIXELS)).unwrap();
            // Single precision may lead over a whole number, at which the value is cut off: hence 1.
            check(stage, &events, 1.0, |_, inside| {
                let counts = counts(inside, 2 * PIXELS, pixel_by_polarity);
                let alpha = percentile(&counts, percent.into());
                let shade = |share: f64| (255.0 * if white { 1.0 - share } else { share }).floor();
                let level = |count: &u64| shade((*count as f64).min(alpha) / alpha);
                let any = (0..PIXELS).map(|at| shade(f64::from(counts[at] + counts[PIXELS + at] > 0)));
                counts[..PIXELS].iter().map(level).chain(any).chain(counts[PIXELS..].iter().map(level)).collect()
            });
            let stage = SliceRedBlue::try_new(GEOMETRY, percent, state(2 * PIXELS)).unwrap();
            check(stage, &events, 1.0, |_, inside| {
                let counts = counts(inside, 2 * PIXELS, pixel_by_polarity);
                let alphas = [0, PIXELS].map(|at| percentile(&counts[at..at + PIXELS], percent.into()));
                let level = |at: usize, plane: usize| (counts[plane * PIXELS + at] as f64).min(alphas[plane]) / alphas[plane];
                let mut out = vec![255.0; 3 * PIXELS];
                for at in 0..PIXELS {
                    let (on, off) = (level(at, 0), level(at, 1));
                    let faded = (255.0 * (1.0 - on.max(off))).floor();
                    out[PIXELS + at] = faded;
                    out[if on >= off { 2 * PIXELS + at } else { at }] = faded;
                }
                out
            });
        }
    }

    #[test]
    fn voxels_of_each_polarity(events in streams::stream(GEOMETRY, 400), bins in 1u16..9) {
        let (apart, linear) = (Polarities::Apart, Interpolation::Linear);
        let stage = VoxelGrid::try_with(GEOMETRY, bins, apart, linear).unwrap();
        check(stage, &events, 1e-3, |window, inside| {
            let of = |on: bool| inside.iter().filter(|timed| timed.event.is_on() == on).copied().collect::<Vec<_>>();
            let off = voxel(window, &of(false), bins.into());
            voxel(window, &of(true), bins.into()).into_iter().chain(off.iter().map(|value| value.abs())).collect()
        });
    }

    /// Times at which no event is halfway between two bins.
    #[test]
    fn voxels_of_the_nearest_bin(events in streams::stream(GEOMETRY, 400)) {
        for (polarities, bins) in [(Polarities::Signed, 4u16), (Polarities::Apart, 7)] {
            let stage = VoxelGrid::try_with(GEOMETRY, bins, polarities, Interpolation::Nearest).unwrap();
            check(stage, &events, 0.0, |window, inside| {
                let apart = polarities == Polarities::Apart;
                let mut out = vec![0.0; usize::from(bins) * PIXELS * if apart { 2 } else { 1 }];
                for timed in inside {
                    let position = (f64::from(PERIOD_US) - age(window, timed)) / f64::from(PERIOD_US) * f64::from(bins - 1);
                    let bin = position.round_ties_even() as usize;
                    let (plane, sign) = match (timed.event.is_on(), apart) {
                        (true, _) => (bin, 1.0),
                        (false, true) => (bin + usize::from(bins), 1.0),
                        (false, false) => (bin, -1.0),
                    };
                    out[plane * PIXELS + pixel(timed.event)] += sign;
                }
                out
            });
        }
    }

    #[test]
    fn voxels_of_mean_0_and_deviation_1(events in streams::stream(GEOMETRY, 400), bins in 1u16..9) {
        let stage = SliceVoxelGrid::try_new(GEOMETRY, bins, state(usize::from(bins) * PIXELS)).unwrap();
        let mut plain = VoxelGrid::try_new(GEOMETRY, bins).unwrap();
        let mut grids = render(&mut plain, &events, PERIOD_US, &mut Splits::Whole).into_iter();
        check(stage, &events, 1e-3, |_, _| {
            // Over the grid in single precision: which elements are 0 exactly is up to its rounding.
            let grid: Vec<f64> = grids.next().unwrap().1.into_iter().map(f64::from).collect();
            let some: Vec<f64> = grid.iter().copied().filter(|value| *value != 0.0).collect();
            let mean = some.iter().sum::<f64>() / some.len().max(1) as f64;
            let variance = some.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / some.len().max(1) as f64;
            let scale = if variance < 1e-9 { 0.0 } else { 1.0 / variance.sqrt() };
            grid.iter().map(|value| if *value == 0.0 { 0.0 } else { (value - mean) * scale }).collect()
        });
    }

    #[test]
    fn surfaces(events in streams::stream(GEOMETRY, 300), tau_us in 1u32..60_000, max_us in 1_000u32..100_000) {
        let map = || state(2 * PIXELS);
        let mut last = Last::new(2 * PIXELS);
        let stage = TimeSurface::<f32, _>::try_new(GEOMETRY, tau_us, map()).unwrap().with_decay(Decay::Linear);
        check(stage, &events, 1e-6, |window, inside| {
            let value = |last: Option<(f64, bool)>| last.map_or(0.0, |(age, _)| (1.0 - age / f64::from(tau_us)).max(0.0));
            last.ages(window, inside, pixel_by_polarity).into_iter().map(value).collect()
        });

        let stage = AveragedTimeSurface::try_new(GEOMETRY, tau_us, state(4 * PIXELS)).unwrap();
        check(stage, &events, 1e-5, |window, inside| {
            let (mut sums, counts) = (vec![0.0; 2 * PIXELS], counts(inside, 2 * PIXELS, pixel_by_polarity));
            for timed in inside {
                sums[pixel_by_polarity(timed.event)] += (-age(window, timed) / f64::from(tau_us)).exp();
            }
            sums.iter().zip(counts).map(|(sum, count)| sum / (count.max(1)) as f64).collect()
        });

        let factor = (f64::from(max_us) / 1000.0).powf(0.25);
        let five: Vec<f64> = (0..5).map(|i| 1000.0 * factor.powi(i)).collect();
        let own = [1, 700, max_us];
        for (scales, lens) in [
            (Scales::up_to(max_us).unwrap(), five),
            (Scales::try_new(&own).unwrap(), own.map(f64::from).to_vec()),
        ] {
            let mut last = Last::new(2 * PIXELS);
            let stage = Mcts::<f32, _>::try_new(GEOMETRY, scales, map()).unwrap();
            check(stage, &events, 1e-5, |window, inside| {
                let ages = last.ages(window, inside, pixel_by_polarity);
                let (on, off) = ages.split_at(PIXELS);
                let plane = |half: &[Option<(f64, bool)>], len: f64| {
                    half.iter().map(|last| last.map_or(0.0, |(age, _)| (1.0 - age / len).max(0.0))).collect::<Vec<_>>()
                };
                [off, on].iter().flat_map(|half| lens.iter().flat_map(|len| plane(half, *len))).collect()
            });
        }
    }

    #[test]
    fn colours_of_the_last_event(events in streams::stream(GEOMETRY, 300), tau_us in 50u32..60_000) {
        check(tencode(GEOMETRY), &events, 0.0, |window, inside| {
            let mut out = vec![0.0; 3 * PIXELS];
            for timed in inside {
                let (at, on) = (pixel(timed.event), f64::from(timed.event.is_on()));
                out[at] = 255.0 * on;
                out[2 * PIXELS + at] = 255.0 * (1.0 - on);
                // In whole numbers: halves are told exactly.
                let (age, length) = (age(window, timed) as u64, u64::from(PERIOD_US));
                out[PIXELS + at] = ((510 * age + length) / (2 * length)) as f64;
            }
            out
        });
        for palette in [Palette::Dark, Palette::Light, Palette::Gray] {
            let mut last = Last::new(PIXELS);
            let stage = EventImage::try_new(GEOMETRY, tau_us, palette, state(PIXELS)).unwrap();
            let [none, on, off] = palette.colours().map(|colour| colour.map(f64::from));
            // Two µs of the shortest decay are a 25th: hence the tolerance.
            let tolerance = 1.0 + 255.0 * 2.0 / f64::from(tau_us);
            check(stage, &events, tolerance, |window, inside| {
                let ages = last.ages(window, inside, pixel);
                let fade = |channel: usize, last: &Option<(f64, bool)>| {
                    let share = last.map_or(0.0, |(age, _)| (-age / f64::from(tau_us)).exp());
                    let colour = if last.is_some_and(|(_, is_on)| is_on) { on } else { off };
                    (none[channel] + (colour[channel] - none[channel]) * share).round()
                };
                (0..3).flat_map(|channel| ages.iter().map(move |last| (channel, last))).map(|(c, last)| fade(c, last)).collect()
            });
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 24, ..Default::default() })]

    /// Each slice alone, its window from `back` before its newest event, in memory for `room` events.
    #[test]
    fn ages_from_the_newest_event(
        events in streams::stream(GEOMETRY, 300),
        back in prop_oneof![Just(None), (1u32..20_000).prop_map(Some)],
        room in 1usize..300,
    ) {
        let kept = vec![Event::default(); room];
        let mut stage = LastEvent::try_new(tencode(GEOMETRY), GEOMETRY, back, kept).unwrap();
        let tensors = render(&mut stage, &events, PERIOD_US, &mut Splits::Random(13));
        let (mut older, mut overflowed, mut before) = (0, 0, 0u64);
        for ((grid, tensor), (_, inside)) in tensors.iter().zip(&oracle(&events, PERIOD_US).heard()) {
            let stored = &inside[..inside.len().min(room)];
            overflowed += (inside.len() - stored.len()) as u64;
            let newest = stored.iter().map(|timed| timed.t.max(grid.t0)).max();
            let t1 = match newest {
                Some(newest) if before > newest && before - newest <= 1_000 => before,
                Some(newest) => newest,
                None => grid.t1,
            };
            before = t1;
            let reach = u64::from(back.unwrap_or(1 << 30));
            let seen: Vec<Timed> = stored.iter().filter(|timed| t1 - timed.t <= reach).copied().collect();
            older += (stored.len() - seen.len()) as u64;
            let t0 = back.map_or(seen.iter().map(|timed| timed.t).min(), |us| Some(t1.saturating_sub(us.into())));
            let mut plain = tencode(GEOMETRY);
            let mut expected = vec![0; 3 * PIXELS];
            plain.begin(Window { t0: t0.unwrap_or(0), t1 }, &mut expected);
            let memory = streams::block_events(&seen);
            let span = lobula_core::Span { t_first: t1, t_last: t1, geometry: GEOMETRY, events: &memory };
            plain.accumulate(span, &mut expected).unwrap();
            plain.finish(&mut expected);
            prop_assert_eq!(tensor, &expected);
        }
        prop_assert_eq!((stage.slice().older(), stage.slice().overflowed()), (older, overflowed));
    }
}

chunk_invariance!(representation last_event, |geometry| {
    LastEvent::try_new(tencode(geometry), geometry, Some(3_000), vec![Event::default(); 50]).unwrap()
});

/// The slices that a cutter by count gives: window, and number of events.
fn slices_of(events: &[Timed], splits: &mut Splits) -> Vec<(Window, u64)> {
    let (mut slicer, mut out, mut rest) = (CountSlicer::try_new(7).unwrap(), vec![], events);
    let mut each = |piece: Piece<'_>| {
        if let Piece::End(closed) = piece {
            out.push((closed.window, closed.events));
        }
    };
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(splits.next(streams::block_len(rest)));
        let memory = streams::block_events(piece);
        let (t_first, t_last) = (piece[0].t, piece[piece.len() - 1].t);
        slicer.push(lobula_core::Span { t_first, t_last, geometry: GEOMETRY, events: &memory }, &mut each);
        rest = after;
    }
    slicer.finish(&mut each);
    out
}

chunk_invariance!(custom count_slicer, streams::stream(GEOMETRY, 300), |events, splits| slices_of(events, splits));

/// None is longer than 2^30 - 1 µs.
#[test]
fn slices_of_so_many_events() {
    let long = (1 << 30) - 1;
    let times = [5u64, 9, 8, 9, 9, 9, 9, 50, 50 + long, 49, 51 + long, 51, 53 + long];
    let events = times.map(|t| Timed::new(t, 0, 0, Polarity::On));
    let expected =
        [(5, 9, 7), (50, 50 + long, 2), (49, 49, 1), (51, 51 + long, 2), (53 + long, 53 + long, 1)]
            .map(|(t0, t1, events)| (Window { t0, t1 }, events));
    assert_eq!(slices_of(&events, &mut Splits::Ones), expected);
}

#[test]
fn frames_stop_at_what_they_hold_and_say_so() {
    let events = vec![Timed::new(1, 3, 2, Polarity::Off); 200];
    let mut stage = EventFrame::<u8>::new(GEOMETRY, Combine::Sum);
    let tensors = render(&mut stage, &events, PERIOD_US, &mut Splits::Whole);
    assert_eq!(tensors[0].1[GEOMETRY.index(3, 2)], 0);
    assert_eq!(Build::<Vec<u32>>::saturated(&stage), 72);
}

#[test]
fn refuses_what_makes_no_sense() {
    let state = |len: usize| vec![0u32; len];
    assert!(SliceCountmask::try_new(GEOMETRY, 101, Background::Black, state(2 * PIXELS)).is_err());
    assert!(SliceRedBlue::try_new(GEOMETRY, 101, state(2 * PIXELS)).is_err());
    assert!(SlicePolarityHistogram::try_new(GEOMETRY, state(PIXELS)).is_err());
    assert!(SliceVoxelGrid::try_new(GEOMETRY, 0, state(0)).is_err());
    assert!(SliceVoxelGrid::try_new(GEOMETRY, 2, state(PIXELS)).is_err());
    assert!(EventImage::try_new(GEOMETRY, 0, Palette::Dark, state(PIXELS)).is_err());
    assert!(AveragedTimeSurface::try_new(GEOMETRY, 0, state(4 * PIXELS)).is_err());
    for lens in [&[][..], &[0], &[(1 << 30) + 1], &[5; 17]] {
        assert!(Scales::try_new(lens).is_err(), "{lens:?}");
    }
    for max_us in [0, 999, (1 << 30) + 1] {
        assert!(Scales::up_to(max_us).is_err(), "{max_us}");
    }
}
