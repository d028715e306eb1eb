//! Events without the distortion of the lens.

use lobula_core::transform::{BrownConrady, CameraModel, Undistort};

use super::Op;
use super::moved::Moved;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The camera.
pub const LENS: BrownConrady = BrownConrady {
    fx: 1000.0,
    fy: 1000.0,
    cx: 640.0,
    cy: 360.0,
    k1: -0.3,
    k2: 0.1,
    p1: 0.0003,
    p2: 0.0002,
    k3: 0.0,
};

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer gives other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Moved {
        op: Op::Undistort,
        same: true,
        note: "same events; ours: the table is made once (whole: each time); peer: makes it each time",
    };
    op.contests(scene, peer, || Undistort::try_new(scene.geometry, CameraModel::BrownConrady(LENS), vec![0; scene.geometry.pixels()]))
}
