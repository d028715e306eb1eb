//! Events moved by an affine map.

use lobula_core::transform::{Affine, AffineParams};

use super::Op;
use super::moved::Moved;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The map: turned a little, stretched and shifted.
pub const MATRIX: [[f64; 3]; 2] = [[0.95, -0.2, 120.5], [0.2, 0.95, -90.25]];

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer gives other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Moved {
        op: Op::WarpAffine,
        same: true,
        note: "same events; ours: in place, in cache (whole: into a fresh array); peer: fresh columns, no streaming form",
    };
    op.contests(scene, peer, || Affine::try_new(scene.geometry, AffineParams { matrix: MATRIX }))
}
