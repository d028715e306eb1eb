//! Events to the colour of the last one per pixel.

use lobula_core::representation::Tencode;

use super::Op;
use super::tensor::Tensor;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// Elements at which the clock stepped back between the last event and the newest.
const OUTLIERS: usize = 1000;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer's tensor is another.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Tensor {
        op: Op::Tencode,
        bar_stream: 5.0,
        tolerance: 0.0,
        note: "same but for up to 1000 elements of 2.8 million, since ours takes the last event and the peer the one of greatest time",
    };
    let make = || Tencode::try_new(scene.geometry, vec![0; scene.geometry.pixels().div_ceil(2)]);
    make().map_err(|e| e.to_string())?;
    #[allow(clippy::expect_used)] // it was made above
    let make = move || make().expect("made above");
    op.contests_but(OUTLIERS, scene, peer, make)
}
