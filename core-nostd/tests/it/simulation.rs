//! The synthetic camera against the filters: noise and signal can be told apart, and both are what they claim to be.

use lobula_core::filter::{Denoise, DenoiseParams, HotPixelLearner, PixelMask};
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
