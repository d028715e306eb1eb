//! Events without those of random pixels.

use lobula_core::augmentation::{ChanceParams, PixelDropout, Seed};

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
        op: Op::PixelDropout,
        same: false,
        note: "other events, of another generator of random numbers; peer: fresh columns, no streaming form",
    };
    op.contests(scene, peer, || PixelDropout::try_new(scene.geometry, ChanceParams { p: 0.1 }, Seed::default()))
}
