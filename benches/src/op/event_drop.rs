//! Events without a random half.

use lobula_core::augmentation::{ChanceParams, EventDrop, Seed};

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
        op: Op::EventDrop,
        same: false,
        note: "other events, of another generator of random numbers; peer: fresh columns, no streaming form",
    };
    op.contests(scene, peer, || EventDrop::try_new(scene.geometry, ChanceParams { p: 0.5 }, Seed::default()))
}
