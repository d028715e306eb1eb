//! Tensors of a window's events, a packet at a time into memory used again: every representation and element.

use std::hint::black_box;

use bytemuck::Zeroable;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lobula_benches::input::{Scene, TENSOR_EVENTS, packets};
use lobula_core::Representation;
use lobula_core::representation::{Build, Parameters};

fn representation(c: &mut Criterion) {
    let scene = Scene::load(TENSOR_EVENTS).expect("a scene");
    let mut group = c.benchmark_group("representation");
    group.throughput(Throughput::Elements(TENSOR_EVENTS as u64)).sample_size(20);
    macro_rules! each {
        ($($variant:ident $kind:ident $type:ty;)*) => {
            $({
                let state = vec![0; <$type as Build<Vec<u32>>>::state_len(&Parameters::default(), scene.geometry)];
                let mut made =
                    <$type as Build<Vec<u32>>>::build(&Parameters::default(), scene.geometry, state).expect("defaults serve");
                let mut out = vec![<$type as Representation>::Pixel::zeroed(); made.shape().len()];
                group.bench_function(stringify!($variant), |b| b.iter(|| fill(&scene, &mut made, &mut out)));
            })*
        };
    }
    lobula_core::for_each_representation!(each, Vec<u32>);
    group.finish();
}

fn fill<R: Representation>(scene: &Scene, representation: &mut R, out: &mut [R::Pixel]) {
    representation.begin(scene.tensor_window, out);
    for packet in packets(scene.span(TENSOR_EVENTS)) {
        representation.accumulate(packet, out).expect("the scene's geometry");
    }
    representation.finish(out);
    black_box(out);
}

criterion_group!(benches, representation);
criterion_main!(benches);
