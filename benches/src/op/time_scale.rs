//! Events in slow motion.

use lobula_core::transform::{TimeScale, TimeScaleParams};

use super::Op;
use super::moved::Moved;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer gives other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Moved {
        op: Op::TimeScale,
        same: true,
        note: "same events; ours: in place, in cache (whole: into a fresh array); peer: fresh columns, no streaming form",
    };
    op.contests(scene, peer, || TimeScale::try_new(scene.geometry, TimeScaleParams { factor: 2.5 }))
}
