//! Events to an image of the prevailing polarity.

use lobula_core::representation::SliceRedBlue;

use super::Op;
use super::tensor::Tensor;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// Where counts are clipped.
pub const PERCENTILE: u8 = 99;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer's tensor is another.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Tensor {
        op: Op::RedBlue,
        bar_stream: 2.0,
        tolerance: 0.0,
        note: "same",
    };
    let make = || SliceRedBlue::try_new(scene.geometry, PERCENTILE, vec![0u32; SliceRedBlue::<Vec<u32>>::state_len(scene.geometry)]);
    make().map_err(|e| e.to_string())?;
    #[allow(clippy::expect_used)] // it was made above
    let make = move || make().expect("made above");
    op.contests(scene, peer, make)
}
