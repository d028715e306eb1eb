//! Events to which pixels had any.

use lobula_core::representation::Binary;

use super::Op;
use super::tensor::Tensor;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer's tensor is another.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Tensor {
        op: Op::Binary,
        bar_stream: 2.0,
        tolerance: 0.0,
        note: "same",
    };
    op.contests(scene, peer, || Binary::new(scene.geometry))
}
