//! The synthetic camera against the filters: noise and signal can be told apart, and both are what they claim to be.

use lobula_core::filter::{
    BackgroundActivity, BackgroundActivityParams, Denoise, DenoiseParams, HotPixelLearner, Neighbours,
    PixelMask, PolarityMatch, Stcf, StcfParams,
};
use lobula_core::simulation::{Label, LabelCounts, Scene, SceneSpec};
use lobula_core::{Block, Event, Filter, Geometry, Span};

fn scene() -> Scene {
    let geometry = Geometry::new(320, 240);
    let spec = SceneSpec { geometry, rate_evs: 300_000, hot_hz: 200, ..SceneSpec::default() };
    Scene::try_new(&spec).unwrap()
}

fn hot_pixels(scene: &Scene) -> Vec<(u16, u16)> {
    let geometry = scene.geometry();
    let counters = vec![0; HotPixelLearner::<()>::required_len(geometry)];
    let mut learner = HotPixelLearner::try_new(geometry, counters).unwrap();
    learner.learn(Span { t_first: 0, t_last: scene.period_us(), geometry, events: scene.events() }).unwrap();
    let words = vec![0; PixelMask::<()>::required_len(geometry)];
    learner.mask(10.0, words).unwrap().iter().collect()
}

/// What is left of the second loop, by label: in the first the filter's map is still empty.
fn kept(scene: &Scene, mask: &[(u16, u16)]) -> LabelCounts {
    let geometry = scene.geometry();
    let params = DenoiseParams { support_us: 10_000, ..DenoiseParams::default() };
    let memory = vec![0u32; Denoise::<u32, ()>::required_len(geometry)];
    let mut denoise = Denoise::<u32, _>::try_new(geometry, params, memory).unwrap();
    for (x, y) in mask {
        assert!(denoise.mask(*x, *y));
    }
    let mut counts = LabelCounts::default();
    for turn in 0..2 {
        let start = turn * scene.period_us();
        let moved =
            |event: &Event| Event::new(event.t() + start as u32, event.x(), event.y(), event.polarity());
        let mut events: Vec<_> = scene.events().iter().map(moved).collect();
        let mut block = Block::new(start, start + scene.period_us(), geometry, &mut events);
        denoise.retain(&mut block).unwrap();
        let span = block.span();
        let labels = span.events.iter().map(|event| scene.label(span.time(*event), *event).unwrap());
        labels.filter(|_| turn == 1).for_each(|label| counts.count(label));
    }
    counts
}

#[test]
fn hot_pixels_are_learned_from_the_events_alone() {
    let scene = scene();
    let mut truth: Vec<_> = (scene.events().iter().zip(scene.labels()))
        .filter(|(_, label)| **label == Label::Hot)
        .map(|(event, _)| (event.x(), event.y()))
        .collect();
    truth.sort_unstable();
    truth.dedup();
    let mut learned = hot_pixels(&scene);
    learned.sort_unstable();
    assert_eq!(learned, truth);
}

#[test]
fn denoising_removes_the_noise_and_keeps_the_signal() {
    let scene = scene();
    let all = scene.counts(0, scene.period_us());
    let kept = kept(&scene, &hot_pixels(&scene));
    assert_eq!(kept.get(Label::Hot), 0);
    assert!(kept.signal() * 100 > all.signal() * 85, "{kept:?} of {all:?}");
    assert!(kept.noise() * 100 < all.noise() * 8, "{kept:?} of {all:?}");
}

/// A scene half of whose events are noise of pixels that fire once in a while, none of them hot.
fn noisy_scene() -> Scene {
    let geometry = Geometry::new(320, 240);
    let noise = SceneSpec { shot_mhz: 3_000, hot_pixels: 0, noise_percent_max: 50, ..SceneSpec::default() };
    Scene::try_new(&SceneSpec { geometry, rate_evs: 300_000, ..noise }).unwrap()
}

/// Which share of the noise and of the signal a filter keeps, from 0 to 1.
fn kept_shares(scene: &Scene, filter: &mut impl Filter) -> (f64, f64) {
    let (mut all, mut kept) = (LabelCounts::default(), LabelCounts::default());
    for (event, label) in scene.events().iter().zip(scene.labels()) {
        all.count(*label);
        if filter.keep(*event) {
            kept.count(*label);
        }
    }
    (kept.noise() as f64 / all.noise() as f64, kept.signal() as f64 / all.signal() as f64)
}

/// Area under the receiver operating characteristic of a filter with one period, over all periods: 1 where some period
/// parts signal from noise, 0.5 for a filter that tosses a coin.
fn roc_area<F: Filter>(scene: &Scene, make: impl Fn(u32) -> F) -> f64 {
    let mut points = vec![(0.0, 0.0)];
    points.extend((0..12).map(|i| kept_shares(scene, &mut make((50.0 * 2.5f64.powi(i)) as u32))));
    points.push((1.0, 1.0));
    points.windows(2).map(|pair| (pair[1].0 - pair[0].0) * (pair[0].1 + pair[1].1) / 2.0).sum()
}

#[test]
fn stcf_tells_signal_from_noise_better_than_background_activity() {
    let scene = noisy_scene();
    let geometry = scene.geometry();
    let all = scene.counts(0, scene.period_us());
    assert!(all.noise() * 10 > all.total() * 4, "{all:?}");
    let background = roc_area(&scene, |dt_us| {
        let params = BackgroundActivityParams { dt_us, neighbours: Neighbours::Eight, shift: 0 };
        let memory = vec![0; BackgroundActivity::<u32, ()>::required_len(geometry)];
        BackgroundActivity::<u32, _>::try_new(geometry, params, memory).unwrap()
    });
    println!("ROC area, {} signal and {} noise events:", all.signal(), all.noise());
    println!("  background activity     {background:.4}");
    let stcf = |support, polarity_match| {
        let area = roc_area(&scene, |dt_us| {
            let params = StcfParams { dt_us, support, polarity_match, shift: 0 };
            let memory = vec![0; Stcf::<u32, ()>::required_len(geometry)];
            Stcf::<u32, _>::try_new(geometry, params, memory).unwrap()
        });
        println!("  STCF, k = {support}, {polarity_match:?} {area:.4}");
        area
    };
    assert_eq!(stcf(1, PolarityMatch::Any), background, "the same rule");
    assert!(stcf(2, PolarityMatch::Any) >= background);
    assert!(stcf(2, PolarityMatch::Same) >= background);
    stcf(3, PolarityMatch::Any);
}
