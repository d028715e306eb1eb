//! The transforms, by the settings that a chain takes, and what needs a whole slice.

use crate::{Answer, Op, Slice};
use lobula_core::augmentation::*;
use lobula_core::chain::{Chain, Spec};
use lobula_core::slice::{SliceNormalize, SliceReverse, SliceSort};
use lobula_core::{Event, Transform};

/// A line for each operation, and for each way of doing it.
pub const OPS: &[Op] = &[
    Op {
        name: "crop",
        theirs: "s.crop(100, 50, 400, 300)",
        ours: |slice| chain(slice, r#"{ "kind": "crop", "x": 100, "y": 50, "width": 400, "height": 300 }"#),
    },
    Op {
        name: "crop, beyond",
        theirs: "s.crop(-10, -20, 500, 600)",
        ours: |slice| chain(slice, r#"{ "kind": "crop", "x": -10, "y": -20, "width": 500, "height": 600 }"#),
    },
    Op { name: "flip_x", theirs: "s.flip_x()", ours: |slice| chain(slice, r#"{ "kind": "flip_x" }"#) },
    Op { name: "flip_y", theirs: "s.flip_y()", ours: |slice| chain(slice, r#"{ "kind": "flip_y" }"#) },
    Op {
        name: "rotate90",
        theirs: "s.rotate90(1)",
        ours: |slice| chain(slice, r#"{ "kind": "rotate90", "k": 1 }"#),
    },
    Op {
        name: "rotate90, back",
        theirs: "s.rotate90(-1)",
        ours: |slice| chain(slice, r#"{ "kind": "rotate90", "k": -1 }"#),
    },
    Op {
        name: "rotate90, twice",
        theirs: "s.rotate90(2)",
        ours: |slice| chain(slice, r#"{ "kind": "rotate90", "k": 2 }"#),
    },
    Op {
        name: "transpose",
        theirs: "s.transpose()",
        ours: |slice| chain(slice, r#"{ "kind": "transpose" }"#),
    },
    Op {
        name: "translate",
        theirs: "s.translate(30, -40)",
        ours: |slice| chain(slice, r#"{ "kind": "translate", "dx": 30, "dy": -40 }"#),
    },
    Op {
        name: "resize",
        theirs: "s.resize(346, 260)",
        ours: |slice| chain(slice, r#"{ "kind": "resize", "width": 346, "height": 260 }"#),
    },
    Op {
        name: "resize, larger",
        theirs: "s.resize(2000, 1000)",
        ours: |slice| chain(slice, r#"{ "kind": "resize", "width": 2000, "height": 1000 }"#),
    },
    Op {
        name: "scale",
        theirs: "s.scale(0.37, 0.5)",
        ours: |slice| chain(slice, r#"{ "kind": "scale", "sx": 0.37, "sy": 0.5 }"#),
    },
    Op {
        name: "affine",
        theirs: "s.warp_affine([[0.9, -0.25, 30.5], [0.125, 1.1, -20.0]])",
        ours: |slice| {
            chain(slice, r#"{ "kind": "affine", "matrix": [[0.9, -0.25, 30.5], [0.125, 1.1, -20.0]] }"#)
        },
    },
    Op {
        name: "perspective",
        theirs: "s.warp_perspective([[0.9, -0.25, 30.5], [0.125, 1.1, -20.0], [0.0002, -0.0001, 1.0]])",
        ours: |slice| {
            chain(
                slice,
                r#"{ "kind": "perspective", "matrix": [[0.9, -0.25, 30.5], [0.125, 1.1, -20.0], [0.0002, -0.0001, 1.0]] }"#,
            )
        },
    },
    Op {
        name: "undistort",
        theirs: "s.undistort(ecv.Camera(500.0, 510.0, 320.0, 240.0, k1=-0.366475, k2=0.130235, p1=0.000262, p2=0.000191, k3=0.01))",
        ours: |slice| {
            chain(
                slice,
                r#"{ "kind": "undistort", "model": "brown_conrady", "fx": 500, "fy": 510, "cx": 320, "cy": 240,
            "k1": -0.366475, "k2": 0.130235, "p1": 0.000262, "p2": 0.000191, "k3": 0.01 }"#,
            )
        },
    },
    Op {
        name: "invert_polarity",
        theirs: "s.invert_polarity()",
        ours: |slice| chain(slice, r#"{ "kind": "invert_polarity" }"#),
    },
    Op {
        name: "time_shift",
        theirs: "s.time_shift(123456)",
        ours: |slice| chain(slice, r#"{ "kind": "time_shift", "dt_us": 123456 }"#),
    },
    Op {
        name: "time_scale",
        theirs: "s.time_scale(0.37)",
        ours: |slice| chain(slice, r#"{ "kind": "time_scale", "factor": 0.37 }"#),
    },
    Op {
        name: "time_scale, slower",
        theirs: "s.time_scale(2.5)",
        ours: |slice| chain(slice, r#"{ "kind": "time_scale", "factor": 2.5 }"#),
    },
    Op {
        name: "time_window",
        theirs: "s.time_window(*(int(getattr(s, 'numpy')()[i][2]) for i in (1000, 50000)))",
        ours: |slice| {
            let at = |i: usize| slice.span().time(slice.events[i]);
            chain(
                slice,
                &format!(r#"{{ "kind": "time_window", "t0_us": {}, "t1_us": {} }}"#, at(1000), at(50_000)),
            )
        },
    },
    Op {
        name: "normalize_time",
        theirs: "s.normalize_time()",
        ours: |slice| {
            let mut slice = slice.clone();
            let mut block = slice.block();
            SliceNormalize.apply(&mut block);
            let times = (block.t_first, block.t_last);
            (slice.t_first, slice.t_last) = times;
            slice.answer()
        },
    },
    Op {
        name: "sort_by_time",
        theirs: "s.sort_by_time()",
        ours: |slice| {
            whole(slice, |block, scratch| {
                SliceSort::new(scratch).apply(block).unwrap();
            })
        },
    },
    Op {
        name: "time_reversal",
        theirs: "s.time_reversal(1.0, seed=0)",
        ours: |slice| {
            whole(slice, |block, scratch| {
                SliceReverse::new(scratch).apply(block).unwrap();
            })
        },
    },
    Op {
        name: "random_flip_x, always",
        theirs: "s.random_flip_x(1.0, seed=0)",
        ours: |slice| through(slice, RandomFlipX::try_new(slice.geometry, ALWAYS, Seed::default()).unwrap()),
    },
    Op {
        name: "random_flip_y, always",
        theirs: "s.random_flip_y(1.0, seed=0)",
        ours: |slice| through(slice, RandomFlipY::try_new(slice.geometry, ALWAYS, Seed::default()).unwrap()),
    },
    Op {
        name: "random_polarity_flip, always",
        theirs: "s.random_polarity_flip(1.0, seed=0)",
        ours: |slice| {
            through(slice, RandomPolarityFlip::try_new(slice.geometry, ALWAYS, Seed::default()).unwrap())
        },
    },
    Op {
        name: "event_drop, never",
        theirs: "s.event_drop(0.0, seed=0)",
        ours: |slice| through(slice, EventDrop::try_new(slice.geometry, NEVER, Seed::default()).unwrap()),
    },
    Op {
        name: "pixel_dropout, always",
        theirs: "s.pixel_dropout(1.0, seed=0)",
        ours: |slice| through(slice, PixelDropout::try_new(slice.geometry, ALWAYS, Seed::default()).unwrap()),
    },
    Op {
        name: "spatial_jitter of none",
        theirs: "s.spatial_jitter(0.0, seed=0)",
        ours: |slice| {
            let params = SpatialJitterParams { sigma_px: 0.0 };
            through(slice, SpatialJitter::try_new(slice.geometry, params, Seed::default()).unwrap())
        },
    },
    Op {
        name: "time_jitter of none",
        theirs: "s.time_jitter(sigma_us=0.0, seed=0)",
        ours: |slice| {
            let params = TimeJitterParams { sigma_us: 0.0 };
            through(slice, TimeJitter::try_new(slice.geometry, params, Seed::default()).unwrap())
        },
    },
    Op {
        name: "random_crop, larger",
        theirs: "s.random_crop(5000, 5000, seed=0)",
        ours: |slice| {
            let params = RandomCropParams { width: 5000, height: 5000 };
            through(slice, RandomCrop::try_new(slice.geometry, params, Seed::default()).unwrap())
        },
    },
];

const ALWAYS: ChanceParams = ChanceParams { p: 1.0 };
const NEVER: ChanceParams = ChanceParams { p: 0.0 };

fn chain(slice: &Slice, stage: &str) -> Answer {
    let spec: Spec = serde_json::from_str(&format!("[{stage}]")).unwrap();
    through(slice, Chain::try_new(&spec, slice.geometry).unwrap())
}

/// What a transform leaves of the slice.
fn through(slice: &Slice, mut transform: impl Transform) -> Answer {
    let mut slice = slice.clone();
    let mut block = slice.block();
    let left = transform.apply(&mut block).unwrap();
    let (t_first, t_last, geometry) = (block.t_first, block.t_last, block.geometry);
    (slice.t_first, slice.t_last, slice.geometry) = (t_first, t_last, geometry);
    slice.events.truncate(left);
    slice.answer()
}

fn whole(slice: &Slice, operate: impl Fn(&mut lobula_core::Block<'_>, &mut [Event])) -> Answer {
    let mut slice = slice.clone();
    let mut scratch = slice.events.clone();
    operate(&mut slice.block(), &mut scratch);
    slice.answer()
}
