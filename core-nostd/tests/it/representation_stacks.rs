//! Stacks of parts of the window, and surfaces on which events change their neighbourhood, each against its formula.

use crate::representation::{GEOMETRY, PIXELS, pixel, pixel_by_polarity};
use crate::representation_oracles::{age, check, state};
use crate::streams;
use lobula_core::representation::*;
use lobula_core::{Event, Geometry, Window};
use proptest::prelude::*;

const WIDTH: i64 = GEOMETRY.width as i64;
const HEIGHT: i64 = GEOMETRY.height as i64;

/// OFF planes first.
fn off_first(bins: usize, bin: usize, event: Event) -> usize {
    (if event.is_on() { bins + bin } else { bin }) * PIXELS + pixel(event)
}

fn length(window: Window) -> f64 {
    (window.t1 - window.t0) as f64
}

/// Indices of the pixels around an event's, its own included.
fn around(event: Event, radius: i64) -> impl Iterator<Item = usize> {
    let (x, y) = (i64::from(event.x()), i64::from(event.y()));
    let square = (-radius..=radius).flat_map(move |dy| (-radius..=radius).map(move |dx| (x + dx, y + dy)));
    let inside = |(x, y): &(i64, i64)| (0..WIDTH).contains(x) && (0..HEIGHT).contains(y);
    square.filter(inside).map(|(x, y)| (y * WIDTH + x) as usize)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..Default::default() })]

    #[test]
    fn stacked_histograms(events in streams::stream(GEOMETRY, 400), bins in 1usize..20, cutoff in 1u8..6) {
        let stage = StackedHistogram::try_new(GEOMETRY, bins as u16, cutoff).unwrap();
        check(stage, &events, 0.0, |window, inside| {
            let mut out = vec![0.0; 2 * bins * PIXELS];
            for timed in inside {
                let since = timed.t.max(window.t0) - window.t0;
                let bin = (since * bins as u64 / (window.t1 - window.t0)) as usize;
                let cell = &mut out[off_first(bins, bin, timed.event)];
                *cell = f64::min(*cell + 1.0, cutoff.into());
            }
            out
        });
    }

    #[test]
    fn mixed_density_stacks(events in streams::stream(GEOMETRY, 400), bins in 1usize..20) {
        let stage = MixedDensityStack::try_new(GEOMETRY, bins as u16).unwrap();
        check(stage, &events, 0.0, |window, inside| {
            let mut out = vec![0.0; bins * PIXELS];
            for (bin, plane) in out.chunks_mut(PIXELS).enumerate() {
                let part = length(window) / f64::powi(2.0, bin as i32);
                for timed in inside.iter().filter(|timed| age(window, timed) <= part) {
                    plane[pixel(timed.event)] = if timed.event.is_on() { 1.0 } else { -1.0 };
                }
            }
            out
        });
    }

    #[test]
    fn event_spike_tensors(events in streams::stream(GEOMETRY, 400), bins in 1usize..20) {
        let stage = EventSpikeTensor::try_new(GEOMETRY, bins as u16).unwrap();
        check(stage, &events, 1e-3, |window, inside| {
            let mut out = vec![0.0; 2 * bins * PIXELS];
            for timed in inside {
                let time = 1.0 - age(window, timed) / length(window);
                for bin in 0..bins {
                    let share = 1.0 - (time * (bins - 1) as f64 - bin as f64).abs();
                    out[off_first(bins, bin, timed.event)] += time * share.max(0.0);
                }
            }
            out
        });
    }

    #[test]
    fn tore_volumes(events in streams::stream(GEOMETRY, 400), depth in 1usize..6, age_max_us in 200u32..1 << 30) {
        let state = state(Tore::<Vec<u32>>::state_len(GEOMETRY, depth as u16));
        let stage = Tore::try_new(GEOMETRY, depth as u16, 150, age_max_us, state).unwrap();
        let mut queues: Vec<Vec<u64>> = vec![vec![]; 2 * PIXELS];
        let mut before = 0;
        check(stage, &events, 1e-5, |window, inside| {
            if window.t1 < before {
                queues.iter_mut().for_each(Vec::clear);
            }
            before = window.t1;
            for timed in inside {
                queues[pixel_by_polarity(timed.event)].push(timed.t.max(window.t0));
            }
            let value = |queue: &[u64], k: usize| {
                let age = queue.iter().rev().nth(k).map_or(f64::INFINITY, |t| (window.t1 - t) as f64);
                ((age.min(age_max_us.into()) + 1.0).ln() - 151f64.ln()).max(0.0)
            };
            let planes = (0..2).flat_map(|polarity| (0..depth).map(move |k| (polarity, k)));
            let plane = |(polarity, k): (usize, usize)| {
                let queues = &queues[polarity * PIXELS..(polarity + 1) * PIXELS];
                queues.iter().map(move |queue| value(queue, k)).collect::<Vec<_>>()
            };
            planes.flat_map(plane).collect()
        });
    }

    #[test]
    fn speed_invariant_time_surfaces(events in streams::stream(GEOMETRY, 400), radius in 1u16..8) {
        let state = state(Sits::<Vec<u32>>::state_len(GEOMETRY));
        let stage = Sits::try_new(GEOMETRY, radius, state).unwrap();
        let mut planes = [vec![0.0; PIXELS], vec![0.0; PIXELS]];
        check(stage, &events, 0.0, |_, inside| {
            for timed in inside {
                let plane = &mut planes[usize::from(!timed.event.is_on())];
                let centre: f64 = plane[pixel(timed.event)];
                for at in around(timed.event, radius.into()) {
                    if plane[at] >= centre && plane[at] > 0.0 {
                        plane[at] -= 1.0;
                    }
                }
                plane[pixel(timed.event)] = f64::from(2 * radius + 1).powi(2);
            }
            planes.concat()
        });
    }

    #[test]
    fn threshold_ordinal_surfaces(
        events in streams::stream(GEOMETRY, 400),
        radius in 1u16..8,
        threshold in prop_oneof![1u8..=255, Just(241u8), Just(255u8)],
    ) {
        let state = state(Tos::<Vec<u32>>::state_len(GEOMETRY));
        let stage = Tos::try_new(GEOMETRY, radius, threshold, state).unwrap();
        let mut surface = vec![0.0; PIXELS];
        check(stage, &events, 0.0, |_, inside| {
            for timed in inside {
                for at in around(timed.event, radius.into()) {
                    let lower: f64 = surface[at] - 1.0;
                    surface[at] = if lower < threshold.into() { 0.0 } else { lower };
                }
                surface[pixel(timed.event)] = 255.0;
            }
            surface.clone()
        });
    }
}

#[test]
fn stacks_and_surfaces_refuse_what_makes_no_sense() {
    let text = |error: BadRepresentation| error.to_string();
    let sits = |radius| Sits::try_new(GEOMETRY, radius, state(Sits::<Vec<u32>>::state_len(GEOMETRY)));
    assert_eq!(text(sits(0).unwrap_err()), "radius = 0 is out of range: give 1 to 7 pixels");
    assert_eq!(text(sits(8).unwrap_err()), "radius = 8 is out of range: give 1 to 7 pixels");
    assert!(Sits::try_new(GEOMETRY, 3, vec![0; 7]).is_err());
    assert!(Tos::try_new(GEOMETRY, 3, 0, state(Tos::<Vec<u32>>::state_len(GEOMETRY))).is_err());
    assert!(StackedHistogram::try_new(GEOMETRY, 0, 10).is_err());
    assert!(StackedHistogram::try_new(GEOMETRY, 5, 0).is_err());
    assert!(EventSpikeTensor::try_new(GEOMETRY, 0).is_err());
    assert!(MixedDensityStack::try_new(GEOMETRY, 0).is_err());
    assert!(MixedDensityStack::try_new(GEOMETRY, 32).is_err());
    assert!(StackedHistogram::try_new(Geometry::new(65_535, 32_768), 2, 1).is_err());
    let tore = |depth, age_min_us, age_max_us| {
        let state = state(Tore::<Vec<u32>>::state_len(GEOMETRY, depth));
        Tore::try_new(GEOMETRY, depth, age_min_us, age_max_us, state)
    };
    assert!(tore(4, 150, 5_000_000).is_ok());
    for (depth, age_min_us, age_max_us) in
        [(0, 1, 2), (17, 1, 2), (4, 2, 2), (4, 0, 0), (4, 0, (1 << 30) + 1)]
    {
        assert!(tore(depth, age_min_us, age_max_us).is_err(), "{depth} {age_min_us} {age_max_us}");
    }
}
