//! Events to counts per pixel and polarity.

use lobula_core::representation::PolarityHistogram;

use super::Op;
use super::tensor::Tensor;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer counts otherwise.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Tensor {
        op: Op::Polarity,
        bar_stream: 5.0,
        tolerance: 0.0,
        note: "same counts, ours up to 255: u8, the default of views; peer: u64",
    };
    op.contests(scene, peer, || PolarityHistogram::<u8>::new(scene.geometry))
}
