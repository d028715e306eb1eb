//! Events of a rectangle, which becomes the sensor.

use lobula_core::transform::{Crop, CropParams};

use super::Op;
use super::moved::Moved;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The rectangle.
pub const PARAMS: CropParams = CropParams { x: 160, y: 120, width: 960, height: 480 };

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer gives other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Moved {
        op: Op::Crop,
        same: true,
        note: "same events; ours: in place, in cache (whole: into a fresh array); peer: fresh columns, no streaming form",
    };
    op.contests(scene, peer, || Crop::try_new(scene.geometry, PARAMS))
}
