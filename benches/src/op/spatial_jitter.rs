//! Events moved by normal deviates.

use lobula_core::augmentation::{Seed, SpatialJitter, SpatialJitterParams};

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
        op: Op::SpatialJitter,
        same: false,
        note: "other events, of another generator of random numbers; peer: fresh columns, no streaming form",
    };
    op.contests(scene, peer, || SpatialJitter::try_new(scene.geometry, SpatialJitterParams { sigma_px: 1.0 }, Seed::default()))
}
