//! Events thinned a packet at a time in one buffer: every filter of a host's chain with usual parameters.

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use lobula_benches::input::{PACKET_EVENTS, Scene, block_of, packets};
use lobula_core::chain::{Chain, Spec, StageSpec};
use lobula_core::filter::{
    BackgroundActivityParams, DenoiseParams, Neighbours, PolarityParams, RefractoryParams, Refresh,
};
use lobula_core::{Event, Polarity, Transform};

/// Events of one pass: enough to leave the caches.
const EVENTS: usize = 1_000_000;

fn filter(c: &mut Criterion) {
    let scene = Scene::load(EVENTS).expect("a scene");
    let mut group = c.benchmark_group("filter");
    group.throughput(Throughput::Elements(scene.events.len() as u64)).sample_size(20);
    for (name, filter) in filters() {
        let chain =
            Chain::try_new(&Spec { stages: vec![filter] }, scene.geometry).expect("parameters that serve");
        group.bench_function(name, |b| {
            b.iter_batched_ref(|| chain.clone(), |chain| thin(&scene, chain), BatchSize::PerIteration)
        });
    }
    group.finish();
}

fn filters() -> Vec<(&'static str, StageSpec)> {
    let refractory = |shift| RefractoryParams { dt_us: 1_000, refresh: Refresh::Kept, shift };
    let background = |shift| BackgroundActivityParams { dt_us: 1_000, neighbours: Neighbours::Eight, shift };
    let denoise = |shift| DenoiseParams { shift, ..DenoiseParams::default() };
    vec![
        ("polarity", StageSpec::Polarity(PolarityParams { keep: Polarity::On })),
        ("refractory_u32", StageSpec::Refractory(refractory(0))),
        ("refractory_u16", StageSpec::Refractory(refractory(3))),
        ("background_activity_u32", StageSpec::BackgroundActivity(background(0))),
        ("background_activity_u16", StageSpec::BackgroundActivity(background(3))),
        ("denoise_u32", StageSpec::Denoise(denoise(0).into())),
        ("denoise_u16", StageSpec::Denoise(denoise(3).into())),
    ]
}

fn thin(scene: &Scene, chain: &mut Chain) -> usize {
    let mut buffer = [Event::default(); PACKET_EVENTS];
    let mut kept = 0;
    for packet in packets(scene.span(scene.events.len())) {
        let mut block = block_of(packet, &mut buffer);
        kept += chain.apply(&mut block).unwrap_or_default();
        black_box(&mut block);
    }
    kept
}

criterion_group!(benches, filter);
criterion_main!(benches);
