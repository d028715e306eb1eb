//! Filters: the events that are left.

use crate::{Answer, Op, Slice};
use lobula_core::Transform;
use lobula_core::chain::{Chain, Spec};

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
];

/// What a chain of these settings leaves.
pub fn filtered(slice: &Slice, settings: &str) -> Answer {
    let spec: Spec = serde_json::from_str(settings).unwrap();
    let mut slice = slice.clone();
    let left = Chain::try_new(&spec, slice.geometry).unwrap().apply(&mut slice.block()).unwrap();
    slice.events.truncate(left);
    slice.answer()
}
