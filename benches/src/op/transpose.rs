//! Events with x and y in exchange.

use lobula_core::transform::Transpose;

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
        op: Op::Transpose,
        same: true,
        note: "same events; ours: every event is rewritten; peer: two shared columns change names, no event is touched",
    };
    op.contests(scene, peer, || Transpose::try_new(scene.geometry))
}
