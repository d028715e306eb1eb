//! Augmentations: the law, what p = 0 and p = 1 do, shares by counting, and that nothing but seed and slice matters.

use crate::chunk_invariance::{self, GEOMETRY, LEN_MAX, Splits};
use crate::streams::{self, Timed};
use lobula_core::augmentation::*;
use lobula_core::slice::SliceReverse;
use lobula_core::transform::{FlipX, FlipY, InvertPolarity};
use lobula_core::{Block, Event, Geometry, Polarity, Sink, Span, Transform};
use proptest::prelude::*;

const SEED: Seed = Seed { seed: 7, slice: 3 };

fn p(p: f64) -> ChanceParams {
    ChanceParams { p }
}

/// Each, as one type, so that the tests of all are compiled once.
fn all(geometry: Geometry) -> Vec<Box<dyn Transform>> {
    let stretch = DropByTimeParams { t0_us: 0, t1_us: 1 << 40, ratio: 0.5 };
    let rotation = RandomRotationParams { degrees_max: 30.0 };
    let translation = RandomTranslationParams { dx_max: 9, dy_max: 2 };
    vec![
        Box::new(EventDrop::try_new(geometry, p(0.3), SEED).unwrap()),
        Box::new(PixelDropout::try_new(geometry, p(0.3), SEED).unwrap()),
        Box::new(DropByTime::try_new(geometry, stretch, SEED).unwrap()),
        Box::new(DropByArea::try_new(geometry, DropByAreaParams { ratio: 0.6 }, SEED).unwrap()),
        Box::new(SpatialJitter::try_new(geometry, SpatialJitterParams { sigma_px: 2.0 }, SEED).unwrap()),
        Box::new(TimeJitter::try_new(geometry, TimeJitterParams { sigma_us: 1000.0 }, SEED).unwrap()),
        Box::new(RandomFlipX::try_new(geometry, p(1.0), SEED).unwrap()),
        Box::new(RandomFlipY::try_new(geometry, p(1.0), SEED).unwrap()),
        Box::new(RandomPolarityFlip::try_new(geometry, p(1.0), SEED).unwrap()),
        Box::new(RandomRotation::try_new(geometry, rotation, SEED).unwrap()),
        Box::new(RandomTranslation::try_new(geometry, translation, SEED).unwrap()),
        Box::new(RandomCrop::try_new(geometry, RandomCropParams { width: 100, height: 40 }, SEED).unwrap()),
    ]
}

chunk_invariance!(events every_augmentation, |events, splits: &mut Splits| {
    let run = |stage| crate::chunk_invariance::transform(crate::transform::Boxed(stage), events, &mut splits.clone());
    super::all(GEOMETRY).into_iter().map(run).collect::<Vec<_>>()
});

fn noise(rate_hz: f64, seed: Seed) -> NoiseInjection {
    let params = NoiseInjectionParams { t0_us: 0, t1_us: 10_000_000, rate_hz };
    NoiseInjection::try_new(GEOMETRY, params, seed).unwrap()
}

fn inject(mut noise: NoiseInjection, events: &[Timed], splits: &mut Splits) -> Vec<Timed> {
    let mut memory = [Event::default(); 200];
    let mut out = vec![];
    let mut rest = events;
    let mut finished = false;
    while !finished {
        let piece = &rest[..splits.next(streams::block_len(rest))];
        let mut events = streams::block_events(piece);
        let room = 1 + splits.next(199);
        let mut sink = Sink::new(&mut memory[..room]);
        if piece.is_empty() {
            finished = noise.finish(&mut sink);
        } else {
            let block = streams::block(piece, &mut events, GEOMETRY);
            rest = &rest[noise.inject(block.span(), &mut sink).unwrap()..];
        }
        let block = sink.block(GEOMETRY);
        out.extend(block.span().events.iter().map(|e| Timed { t: block.span().time(*e), event: *e }));
    }
    assert_eq!(noise.added(), noise.added_in_all());
    assert_eq!(out.len() as u64, events.len() as u64 + noise.added());
    out
}

chunk_invariance!(events noise_injection, |events, splits| super::inject(super::noise(0.01, super::SEED), events, splits));

/// Events of a slice of 10 s, sorted.
fn slice(len: u32) -> Vec<Timed> {
    let at = |i: u32| {
        let place = i.wrapping_mul(2_654_435_761) >> 8;
        Timed::new(
            u64::from(i) * (10_000_000 / u64::from(len)),
            (place % 123) as u16,
            (place / 123 % 45) as u16,
            Polarity::from_bit(place as u16),
        )
    };
    (0..len).map(at).collect()
}

fn apply(stage: impl Transform, events: &[Timed]) -> Vec<Timed> {
    chunk_invariance::transform(stage, events, &mut Splits::Whole)
}

#[test]
fn never_is_nothing_and_always_is_all() {
    let events = slice(5000);
    let same = |found: Vec<Timed>| assert_eq!(found, events);
    same(apply(EventDrop::try_new(GEOMETRY, p(0.0), SEED).unwrap(), &events));
    same(apply(PixelDropout::try_new(GEOMETRY, p(0.0), SEED).unwrap(), &events));
    same(apply(DropByArea::try_new(GEOMETRY, DropByAreaParams { ratio: 0.0 }, SEED).unwrap(), &events));
    same(apply(
        SpatialJitter::try_new(GEOMETRY, SpatialJitterParams { sigma_px: 0.0 }, SEED).unwrap(),
        &events,
    ));
    same(apply(TimeJitter::try_new(GEOMETRY, TimeJitterParams { sigma_us: 0.0 }, SEED).unwrap(), &events));
    same(apply(RandomFlipX::try_new(GEOMETRY, p(0.0), SEED).unwrap(), &events));
    same(apply(
        RandomRotation::try_new(GEOMETRY, RandomRotationParams { degrees_max: 0.0 }, SEED).unwrap(),
        &events,
    ));
    let still = RandomTranslationParams { dx_max: 0, dy_max: 0 };
    same(apply(RandomTranslation::try_new(GEOMETRY, still, SEED).unwrap(), &events));
    let large = RandomCropParams { width: 200, height: 200 };
    same(apply(RandomCrop::try_new(GEOMETRY, large, SEED).unwrap(), &events));
    same(inject(noise(0.0, SEED), &events, &mut Splits::Whole));

    for slice in 0..200 {
        let seed = Seed { slice, ..SEED };
        assert!(apply(EventDrop::try_new(GEOMETRY, p(1.0), seed).unwrap(), &events[..100]).is_empty());
        assert!(RandomFlipX::try_new(GEOMETRY, p(1.0), seed).unwrap().fires());
        assert!(!RandomFlipX::try_new(GEOMETRY, p(0.0), seed).unwrap().fires());
    }
    assert!(apply(PixelDropout::try_new(GEOMETRY, p(1.0), SEED).unwrap(), &events).is_empty());
    assert!(
        apply(DropByArea::try_new(GEOMETRY, DropByAreaParams { ratio: 1.0 }, SEED).unwrap(), &events)
            .is_empty()
    );
    let all = DropByTimeParams { t0_us: 0, t1_us: 10_000_000, ratio: 1.0 };
    assert!(apply(DropByTime::try_new(GEOMETRY, all, SEED).unwrap(), &events).is_empty());
    let flips: [(Vec<Timed>, Vec<Timed>); 3] = [
        (
            apply(RandomFlipX::try_new(GEOMETRY, p(1.0), SEED).unwrap(), &events),
            apply(FlipX::new(GEOMETRY), &events),
        ),
        (
            apply(RandomFlipY::try_new(GEOMETRY, p(1.0), SEED).unwrap(), &events),
            apply(FlipY::new(GEOMETRY), &events),
        ),
        (
            apply(RandomPolarityFlip::try_new(GEOMETRY, p(1.0), SEED).unwrap(), &events),
            apply(InvertPolarity::new(GEOMETRY), &events),
        ),
    ];
    flips.iter().for_each(|(random, plain)| assert_eq!(random, plain));

    let (mut once, mut plain) = (streams::block_events(&events), streams::block_events(&events));
    let scratch = once.clone();
    let mut always = RandomTimeReversal::try_new(p(1.0), SEED, scratch.clone()).unwrap();
    always.apply(&mut streams::block(&events, &mut once, GEOMETRY)).unwrap();
    SliceReverse::new(scratch.clone()).apply(&mut streams::block(&events, &mut plain, GEOMETRY)).unwrap();
    assert_eq!(once, plain);
    let mut never = RandomTimeReversal::try_new(p(0.0), SEED, scratch).unwrap();
    never.apply(&mut streams::block(&events, &mut once, GEOMETRY)).unwrap();
    assert!(!never.fires() && once == plain);
}

/// Whether a count of Bernoulli trials is within five standard errors of its share.
#[track_caller]
fn assert_share(count: usize, trials: usize, share: f64) {
    let error = (trials as f64 * share * (1.0 - share)).sqrt();
    let off = count as f64 - trials as f64 * share;
    assert!(off.abs() < 5.0 * error, "{count} of {trials} is not {share}");
}

#[test]
fn shares_are_those_asked_for() {
    let events = slice(100_000);
    for share in [0.01, 0.1, 0.5, 0.9] {
        let left = apply(EventDrop::try_new(GEOMETRY, p(share), SEED).unwrap(), &events);
        assert_share(events.len() - left.len(), events.len(), share);
        let one_each: Vec<Timed> = (0..GEOMETRY.pixels())
            .map(|i| Timed::new(i as u64, (i % 123) as u16, (i / 123) as u16, Polarity::On))
            .collect();
        let left = apply(PixelDropout::try_new(GEOMETRY, p(share), SEED).unwrap(), &one_each);
        assert_share(one_each.len() - left.len(), one_each.len(), share);
        let fires =
            |slice| RandomFlipY::try_new(GEOMETRY, p(share), Seed { seed: 1, slice }).unwrap().fires();
        assert_share((0..20_000).filter(|slice| fires(*slice)).count(), 20_000, share);
    }
}

#[test]
fn a_pixel_is_dead_or_alive() {
    let events = slice(50_000);
    let left = apply(PixelDropout::try_new(GEOMETRY, p(0.5), SEED).unwrap(), &events);
    let place = |timed: &Timed| (timed.event.x(), timed.event.y());
    let alive: std::collections::HashSet<_> = left.iter().map(place).collect();
    let expected: Vec<Timed> = events.iter().filter(|timed| alive.contains(&place(timed))).copied().collect();
    assert_eq!(left, expected);
}

#[test]
fn drops_one_stretch_and_one_rectangle() {
    let events = slice(10_000);
    for slice in 0..50 {
        let seed = Seed { seed: 1, slice };
        let params = DropByTimeParams { t0_us: 0, t1_us: 10_000_000, ratio: 0.2 };
        let stage = DropByTime::try_new(GEOMETRY, params, seed).unwrap();
        let dropped = stage.dropped();
        assert!(dropped.t1 - dropped.t0 == 2_000_000 && dropped.t1 <= 10_000_000);
        let expected: Vec<Timed> =
            events.iter().filter(|timed| timed.t < dropped.t0 || timed.t >= dropped.t1).copied().collect();
        assert_eq!(apply(stage, &events), expected);

        let left =
            apply(DropByArea::try_new(GEOMETRY, DropByAreaParams { ratio: 0.5 }, seed).unwrap(), &events);
        let gone: Vec<&Timed> = events.iter().filter(|timed| !left.contains(timed)).collect();
        let side = |of: fn(&Event) -> u16| {
            let places = || gone.iter().map(|timed| of(&timed.event));
            (places().min().unwrap(), places().max().unwrap())
        };
        let ((x0, x1), (y0, y1)) = (side(|e| e.x()), side(|e| e.y()));
        assert!(x1 - x0 < 62 && y1 - y0 < 23 && x1 - x0 > 55 && y1 - y0 > 18, "{x0} {x1} {y0} {y1}");
        let inside = |e: Event| (x0..=x1).contains(&e.x()) && (y0..=y1).contains(&e.y());
        assert!(left.iter().all(|timed| !inside(timed.event)));
    }
}

#[test]
fn jitter_is_of_the_deviation_asked_for() {
    let geometry = Geometry::new(1001, 1001);
    let n = 50_000u32;
    let mut events: Vec<Event> = (0..n).map(|i| Event::new(1_000_000 + i, 500, 500, Polarity::On)).collect();
    let mut block = Block::new(1_000_000, 1_000_000, geometry, &mut events);
    let mut jitter = SpatialJitter::try_new(geometry, SpatialJitterParams { sigma_px: 10.0 }, SEED).unwrap();
    assert_eq!(jitter.apply(&mut block), Ok(n as usize));
    let mut jitter = TimeJitter::try_new(geometry, TimeJitterParams { sigma_us: 50.0 }, SEED).unwrap();
    assert_eq!(jitter.apply(&mut block), Ok(n as usize));
    let deviation = |of: &dyn Fn(usize, &Event) -> f64, sigma: f64| {
        let all: Vec<f64> = events.iter().enumerate().map(|(i, event)| of(i, event)).collect();
        let mean = all.iter().sum::<f64>() / f64::from(n);
        let spread = (all.iter().map(|v| v * v).sum::<f64>() / f64::from(n)).sqrt();
        assert!(mean.abs() < 5.0 * sigma / f64::from(n).sqrt(), "mean {mean}");
        assert!((spread / sigma - 1.0).abs() < 0.02, "{spread} is not {sigma}");
    };
    deviation(&|_, e| f64::from(e.x()) - 500.0, 10.0);
    deviation(&|_, e| f64::from(e.y()) - 500.0, 10.0);
    deviation(&|i, e| f64::from(e.t()) - f64::from(1_000_000 + i as u32), 50.0);
    let products: f64 = events.iter().map(|e| (f64::from(e.x()) - 500.0) * (f64::from(e.y()) - 500.0)).sum();
    assert!((products / f64::from(n)).abs() < 3.0, "x and y go together: {products}");
}

#[test]
fn rotation_keeps_distances_from_the_middle() {
    let geometry = Geometry::new(201, 201);
    let radius = |e: &Event| (f64::from(e.x()) - 100.0).hypot(f64::from(e.y()) - 100.0);
    let mut angles = vec![];
    for slice in 0..200 {
        let mut events = [(180, 100), (100, 130), (100, 100)].map(|(x, y)| Event::new(0, x, y, Polarity::On));
        let params = RandomRotationParams { degrees_max: 40.0 };
        let mut stage = RandomRotation::try_new(geometry, params, Seed { seed: 1, slice }).unwrap();
        assert_eq!(stage.apply(&mut Block::new(0, 0, geometry, &mut events)), Ok(3));
        for (event, expected) in events.iter().zip([80.0, 30.0, 0.0]) {
            assert!((radius(event) - expected).abs() < 0.8, "{event:?}");
        }
        angles.push((f64::from(events[0].y()) - 100.0).atan2(f64::from(events[0].x()) - 100.0).to_degrees());
    }
    assert!(angles.iter().all(|angle| angle.abs() < 41.0));
    assert!(angles.iter().any(|angle| *angle < -30.0) && angles.iter().any(|angle| *angle > 30.0));
}

#[test]
fn noise_is_everywhere_at_all_times() {
    let rate_hz = 2.0;
    let added = inject(noise(rate_hz, SEED), &[], &mut Splits::random(5));
    let expected = (rate_hz * GEOMETRY.pixels() as f64 * 10.0) as i64;
    assert!((added.len() as i64 - expected).abs() <= 1, "{}", added.len());
    assert!(added.is_sorted_by_key(|timed| timed.t) && added.iter().all(|timed| timed.t < 10_000_000));
    let share = |of: &dyn Fn(&Timed) -> bool, share| {
        assert_share(added.iter().filter(|timed| of(timed)).count(), added.len(), share);
    };
    share(&|timed| timed.event.is_on(), 0.5);
    share(&|timed| timed.event.x() < 41, 41.0 / 123.0);
    share(&|timed| timed.event.y() >= 36, 9.0 / 45.0);
    share(&|timed| timed.t < 2_500_000, 0.25);
    let sorted = inject(noise(rate_hz, SEED), &slice(10_000), &mut Splits::Whole);
    assert!(sorted.is_sorted_by_key(|timed| timed.t));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    /// Slices in any order, others in between: each is changed as if it were alone.
    #[test]
    fn the_order_of_slices_does_not_matter(events in streams::stream(GEOMETRY, LEN_MAX), seed: u64, slices: [u64; 3]) {
        let one = |slice| {
            let seed = Seed { seed, slice };
            let dropped = apply(EventDrop::try_new(GEOMETRY, p(0.5), seed).unwrap(), &events);
            apply(SpatialJitter::try_new(GEOMETRY, SpatialJitterParams { sigma_px: 3.0 }, seed).unwrap(), &dropped)
        };
        let forward = slices.map(one);
        let mut backward = slices;
        backward.reverse();
        let mut backward = backward.map(one);
        backward.reverse();
        prop_assert_eq!(forward, backward);
    }
}

#[test]
fn seeds_and_slices_differ() {
    let events = slice(1000);
    let left =
        |seed, slice| apply(EventDrop::try_new(GEOMETRY, p(0.5), Seed { seed, slice }).unwrap(), &events);
    assert_eq!(left(1, 2), left(1, 2));
    assert_ne!(left(1, 2), left(1, 3));
    assert_ne!(left(1, 2), left(2, 2));
    assert_ne!(left(1, 2), left(2, 1));
}

#[test]
fn refuses_what_is_no_share() {
    for bad in [-0.1, 1.1, f64::NAN] {
        assert!(EventDrop::try_new(GEOMETRY, p(bad), SEED).is_err(), "{bad}");
        assert!(DropByArea::try_new(GEOMETRY, DropByAreaParams { ratio: bad }, SEED).is_err(), "{bad}");
        let params = DropByTimeParams { t0_us: 0, t1_us: 1, ratio: bad };
        assert!(DropByTime::try_new(GEOMETRY, params, SEED).is_err(), "{bad}");
    }
    for bad in [-1.0, 1e12, f64::NAN, f64::INFINITY] {
        assert!(
            SpatialJitter::try_new(GEOMETRY, SpatialJitterParams { sigma_px: bad }, SEED).is_err(),
            "{bad}"
        );
        assert!(TimeJitter::try_new(GEOMETRY, TimeJitterParams { sigma_us: bad }, SEED).is_err(), "{bad}");
        assert!(
            RandomRotation::try_new(GEOMETRY, RandomRotationParams { degrees_max: bad }, SEED).is_err(),
            "{bad}"
        );
        let params = NoiseInjectionParams { t0_us: 0, t1_us: 1, rate_hz: bad };
        assert!(NoiseInjection::try_new(GEOMETRY, params, SEED).is_err(), "{bad}");
    }
    let backwards = NoiseInjectionParams { t0_us: 1, t1_us: 0, rate_hz: 1.0 };
    assert!(NoiseInjection::try_new(GEOMETRY, backwards, SEED).is_err());
    let span = Span { t_first: 0, t_last: 0, geometry: Geometry::new(1, 1), events: &[] };
    assert!(noise(1.0, SEED).inject(span, &mut Sink::new(&mut [])).is_err());
}
