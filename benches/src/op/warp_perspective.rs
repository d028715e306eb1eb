//! Events moved by a perspective map.

use lobula_core::transform::{Perspective, PerspectiveParams};

use super::Op;
use super::moved::Moved;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The map: a plane that leans back.
pub const MATRIX: [[f64; 3]; 3] = [[0.95, -0.2, 120.5], [0.2, 0.95, -90.25], [1e-4, -5e-5, 1.0]];

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer gives other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Moved {
        op: Op::WarpPerspective,
        same: true,
        note: "same events; ours: in place, in cache (whole: into a fresh array); peer: fresh columns, no streaming form",
    };
    op.contests(scene, peer, || Perspective::try_new(scene.geometry, PerspectiveParams { matrix: MATRIX }))
}
