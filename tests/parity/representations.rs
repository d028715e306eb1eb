//! Representations: the tensor of the whole slice, with ages from its newest event.

use crate::{Answer, Op, Slice};
use lobula_core::representation::{
    AveragedTimeSurface, Background, Binary, Count, EventImage, LastEvent, Mcts, Palette, PolarityHistogram,
    Scales, SliceCountmask, SlicePolarityHistogram, SliceRedBlue, Tencode, TimeSurface, VoxelGrid,
};
use lobula_core::{Event, Geometry, Representation, Shape, Window};

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
        name: "binary",
        theirs: "s.flatten(binary=True)",
        ours: |slice| integers(slice, Binary::new(slice.geometry)),
    },
    Op {
        name: "slice_polarity_histogram",
        theirs: "s.flatten()",
        ours: |slice| {
            integers(
                slice,
                SlicePolarityHistogram::try_new(slice.geometry, planes(slice.geometry, 2)).unwrap(),
            )
        },
    },
    Op {
        name: "averaged_time_surface",
        theirs: "s.atsurf(tau_ms=3)",
        ours: |slice| {
            let state = planes(slice.geometry, 4);
            floats(slice, None, AveragedTimeSurface::try_new(slice.geometry, 3_000, state).unwrap())
        },
    },
    Op {
        name: "mcts",
        theirs: "s.mcts(max_window_ms=5)",
        ours: |slice| scaled(slice, Scales::up_to(5_000).unwrap()),
    },
    Op {
        name: "mcts_windows",
        theirs: "s.mcts(windows_ms=[0.5, 2, 7])",
        ours: |slice| scaled(slice, Scales::try_new(&[500, 2_000, 7_000]).unwrap()),
    },
    Op {
        name: "tencode",
        theirs: "s.tencode(window_ms=5)",
        ours: |slice| {
            let state = vec![0; slice.geometry.pixels().div_ceil(2)];
            let stage = Tencode::try_new(slice.geometry, state).unwrap();
            let (shape, values) = tensor(slice, Some(5_000), stage);
            Answer::Integers(shape, values.into_iter().map(Into::into).collect())
        },
    },
    Op { name: "slice_countmask", theirs: "s.countmask()", ours: |slice| masked(slice, Background::Black) },
    Op {
        name: "slice_countmask_white",
        theirs: "s.countmask(white_frame=True)",
        ours: |slice| masked(slice, Background::White),
    },
    Op {
        name: "slice_red_blue",
        theirs: "s.redblue()",
        ours: |slice| {
            integers(slice, SliceRedBlue::try_new(slice.geometry, 99, planes(slice.geometry, 2)).unwrap())
        },
    },
    Op {
        // Theirs takes exp from a table of 4096 steps, which is a level off now and then: in units of 10^5 levels, within
        // 1e-5 is within one. (And a little: a level is not 1e-5 exactly.)
        name: "event_image",
        theirs: "np.moveaxis(np.asarray(s.raw_image(decay_ms=3)), 2, 0).astype(np.float32) / np.float32(100100)",
        ours: |slice| {
            let map = planes(slice.geometry, 1);
            let image = EventImage::try_new(slice.geometry, 3_000, Palette::Dark, map).unwrap();
            let (shape, values) = tensor(slice, None, image);
            Answer::Floats(shape, values.into_iter().map(|value| f32::from(value) / 100_100.0).collect())
        },
    },
    Op {
        name: "voxel_grid",
        theirs: "s.voxel(bins=5, window_ms=5)",
        ours: |slice| floats(slice, Some(5_000), VoxelGrid::try_new(slice.geometry, 5).unwrap()),
    },
    Op {
        name: "time_surface",
        theirs: "s.tsurf(tau_ms=3)",
        ours: |slice| {
            let map = planes(slice.geometry, 2);
            floats(slice, None, TimeSurface::try_new(slice.geometry, 3_000, map).unwrap())
        },
    },
];

/// The tensor of the slice as its one window, with the last event as reference.
fn tensor<R: Representation>(slice: &Slice, window_us: Option<u32>, stage: R) -> (Vec<usize>, Vec<R::Pixel>) {
    let kept = vec![Event::default(); slice.events.len()];
    let mut stage = LastEvent::try_new(stage, slice.geometry, window_us, kept).unwrap();
    let Shape { channels, height, width } = stage.shape();
    let mut out = vec![bytemuck::Zeroable::zeroed(); stage.shape().len()];
    stage.begin(Window { t0: 0, t1: 0 }, &mut out);
    stage.accumulate(slice.span(), &mut out).unwrap();
    stage.finish(&mut out);
    assert_eq!(stage.slice().overflowed(), 0);
    (vec![channels, height, width], out)
}

/// State of so many elements a pixel.
fn planes(geometry: Geometry, planes: usize) -> Vec<u32> {
    vec![0; planes * geometry.pixels()]
}

/// The tensor of all events.
fn integers<R: Representation<Pixel: Into<u64>>>(slice: &Slice, stage: R) -> Answer {
    let (shape, values) = tensor(slice, None, stage);
    Answer::Integers(shape, values.into_iter().map(Into::into).collect())
}

fn floats<R: Representation<Pixel = f32>>(slice: &Slice, window_us: Option<u32>, stage: R) -> Answer {
    let (shape, values) = tensor(slice, window_us, stage);
    Answer::Floats(shape, values)
}

fn scaled(slice: &Slice, scales: Scales) -> Answer {
    floats(slice, None, Mcts::<f32, _>::try_new(slice.geometry, scales, planes(slice.geometry, 2)).unwrap())
}

fn masked(slice: &Slice, background: Background) -> Answer {
    let state = planes(slice.geometry, 2);
    integers(slice, SliceCountmask::try_new(slice.geometry, 99, background, state).unwrap())
}
