//! Filters: the events that are left.

use crate::{Answer, Op, Slice};
use lobula_core::Transform;
use lobula_core::chain::{Chain, HotPixelSpec, MaskSpec, Spec, StageSpec};
use lobula_core::filter::{HotPixelLearner, MaskKeep, PixelMask};

pub const OPS: &[Op] = &[
    Op { name: "events", theirs: "s", ours: Slice::answer },
    Op {
        name: "polarity",
        theirs: "s.filter_polarity(True)",
        ours: |slice| filtered(slice, r#"[{ "kind": "polarity", "keep": "on" }]"#),
    },
    Op {
        name: "refractory",
        theirs: "s.refractory_filter(1000)",
        ours: |slice| filtered(slice, r#"[{ "kind": "refractory", "dt_us": 1000 }]"#),
    },
    Op {
        name: "refractory_all",
        theirs: "s.refractory_filter(1000, refresh='all')",
        ours: |slice| filtered(slice, r#"[{ "kind": "refractory", "dt_us": 1000, "refresh": "all" }]"#),
    },
    Op {
        name: "background_activity",
        theirs: "s.background_activity_filter(1000)",
        ours: |slice| filtered(slice, r#"[{ "kind": "background_activity", "dt_us": 1000 }]"#),
    },
    Op {
        name: "background_activity_four",
        theirs: "s.background_activity_filter(1000, neighbourhood='cross')",
        ours: |slice| {
            filtered(slice, r#"[{ "kind": "background_activity", "dt_us": 1000, "neighbours": "four" }]"#)
        },
    },
    Op {
        name: "hot_pixel",
        theirs: "s.hot_pixel_filter(3)",
        ours: |slice| {
            let counters = vec![0; HotPixelLearner::<()>::required_len(slice.geometry)];
            let mut learner = HotPixelLearner::try_new(slice.geometry, counters).unwrap();
            learner.learn(slice.span()).unwrap();
            let words = vec![0; PixelMask::<()>::required_len(slice.geometry)];
            let pixels = learner.mask(3.0, words).unwrap().iter().collect();
            thinned(slice, StageSpec::HotPixel(HotPixelSpec { pixels, ..HotPixelSpec::default() }))
        },
    },
    Op {
        name: "decimate",
        theirs: "s.decimate(7)",
        ours: |slice| filtered(slice, r#"[{ "kind": "decimate", "n": 7 }]"#),
    },
    Op {
        name: "mask",
        theirs: "s.mask((np.add.outer(np.arange(s.sensor_size[1]) * 3, np.arange(s.sensor_size[0]) * 7) % 5) != 0)",
        ours: |slice| {
            let rows = 0..slice.geometry.height;
            let pixels = rows.flat_map(|y| (0..slice.geometry.width).map(move |x| (x, y)));
            let pixels = pixels.filter(|(x, y)| (u32::from(*y) * 3 + u32::from(*x) * 7) % 5 != 0).collect();
            thinned(slice, StageSpec::Mask(MaskSpec { pixels, keep: MaskKeep::Inside }))
        },
    },
];

/// What a filter of these settings leaves.
fn thinned(slice: &Slice, filter: StageSpec) -> Answer {
    left(slice, &Spec { stages: vec![filter] })
}

/// What a chain of these settings leaves.
pub fn filtered(slice: &Slice, settings: &str) -> Answer {
    left(slice, &serde_json::from_str(settings).unwrap())
}

fn left(slice: &Slice, spec: &Spec) -> Answer {
    let mut slice = slice.clone();
    let left = Chain::try_new(spec, slice.geometry).unwrap().apply(&mut slice.block()).unwrap();
    slice.events.truncate(left);
    slice.answer()
}
