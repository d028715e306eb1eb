//! EVT3 bytes to a voxel grid of 5 bins, without storing events.

use lobula_core::representation::VoxelGrid;

use super::{Op, fused};
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The operation's contests.
///
/// # Errors
/// A sentence, where a side cannot read the bytes.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let ours = VoxelGrid::try_new(scene.geometry, super::voxel5::BINS).map_err(|e| e.to_string())?;
    fused::contests(Op::FileVoxel5, 4.0, scene, peer, ours)
}
