//! Events to counts per pixel and polarity, as shares of the greatest.

use lobula_core::representation::SlicePolarityHistogram;

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
        op: Op::PolarityShare,
        bar_stream: 2.0,
        tolerance: 0.0,
        note: "same",
    };
    let make = || SlicePolarityHistogram::try_new(scene.geometry, vec![0u32; SlicePolarityHistogram::<Vec<u32>>::state_len(scene.geometry)]);
    make().map_err(|e| e.to_string())?;
    #[allow(clippy::expect_used)] // it was made above
    let make = move || make().expect("made above");
    op.contests(scene, peer, make)
}
