//! Events to a voxel grid of 5 bins.

use lobula_core::representation::VoxelGrid;

use super::Op;
use super::tensor::Tensor;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// Bins of the grid.
pub const BINS: u16 = 5;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer's grid is another.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    VoxelGrid::try_new(scene.geometry, BINS).map_err(|e| e.to_string())?;
    let op = Tensor {
        op: Op::Voxel5,
        bar_stream: 3.0,
        tolerance: 1e-3,
        note: "same to 1e-3; both f32, ours adds in f32, peer weighs in f64",
    };
    #[allow(clippy::expect_used)] // it was made above
    op.contests(scene, peer, || VoxelGrid::try_new(scene.geometry, BINS).expect("made above"))
}
