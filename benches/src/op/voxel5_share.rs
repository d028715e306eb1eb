//! Events to a voxel grid of 5 bins of mean 0 and deviation 1.

use lobula_core::representation::SliceVoxelGrid;

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
/// A sentence, where the peer's tensor is another.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Tensor {
        op: Op::Voxel5Share,
        bar_stream: 2.0,
        tolerance: 0.0,
        note: "no peer",
    };
    let make = || SliceVoxelGrid::try_new(scene.geometry, BINS, vec![0u32; 5 * scene.geometry.pixels()]);
    make().map_err(|e| e.to_string())?;
    #[allow(clippy::expect_used)] // it was made above
    let make = move || make().expect("made above");
    op.contests(scene, peer, make)
}
