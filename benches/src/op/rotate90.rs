//! Events turned by a quarter.

use lobula_core::transform::{Rotate90, Rotate90Params};

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
        op: Op::Rotate90,
        same: true,
        note: "same events; ours: in place, in cache (whole: into a fresh array); peer: fresh columns, no streaming form",
    };
    op.contests(scene, peer, || Rotate90::try_new(scene.geometry, Rotate90Params { k: 1 }))
}
