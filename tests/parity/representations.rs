//! Representations: the tensor of the whole slice, with ages from its newest event.

use crate::{Answer, Op, Slice};
use lobula_core::representation::{Count, PolarityHistogram, TimeSurface, VoxelGrid};
use lobula_core::{Event, Representation, Shape, Span, Window, full_time};

pub const OPS: &[Op] = &[
    Op {
        name: "count",
        theirs: "s.count()",
        ours: |slice| integers(slice, Count::<u16>::new(slice.geometry)),
    },
    Op {
        name: "polarity_histogram",
        theirs: "s.flatten(normalize=False)",
        ours: |slice| integers(slice, PolarityHistogram::<u16>::new(slice.geometry)),
    },
    Op {
        name: "voxel_grid",
        theirs: "s.voxel(bins=5, window_ms=5)",
        ours: |slice| floats(slice, 5_000, VoxelGrid::try_new(slice.geometry, 5).unwrap()),
    },
    Op {
        name: "time_surface",
        theirs: "s.tsurf(tau_ms=3)",
        ours: |slice| {
            let map = vec![0; 2 * slice.geometry.pixels()];
            floats(slice, 1 << 29, TimeSurface::try_new(slice.geometry, 3_000, map).unwrap())
        },
    },
];

/// The tensor of the slice in a window of `window_us` that ends at the newest event; older events are left out.
fn tensor<R: Representation>(slice: &Slice, window_us: u64, mut stage: R) -> (Vec<usize>, Vec<R::Pixel>) {
    let time = |event: &Event| full_time(slice.t_first, event.t());
    let t1 = slice.events.iter().map(time).max().unwrap();
    let window = Window { t0: t1.saturating_sub(window_us), t1 };
    let events: Vec<_> = slice.events.iter().filter(|event| time(event) >= window.t0).copied().collect();
    let Shape { channels, height, width } = stage.shape();
    let mut out = vec![bytemuck::Zeroable::zeroed(); stage.shape().len()];
    stage.begin(window, &mut out);
    stage.accumulate(Span { events: &events, ..slice.span() }, &mut out).unwrap();
    stage.finish(&mut out);
    (vec![channels, height, width], out)
}

/// The tensor of all events.
fn integers<R: Representation<Pixel: Into<u64>>>(slice: &Slice, stage: R) -> Answer {
    let (shape, values) = tensor(slice, u64::MAX, stage);
    Answer::Integers(shape, values.into_iter().map(Into::into).collect())
}

fn floats<R: Representation<Pixel = f32>>(slice: &Slice, window_us: u64, stage: R) -> Answer {
    let (shape, values) = tensor(slice, window_us, stage);
    Answer::Floats(shape, values)
}
