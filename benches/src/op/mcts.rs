//! Events to surfaces of five scales per polarity.

use lobula_core::representation::{Mcts, Scales};

use super::Op;
use super::tensor::Tensor;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The longest scale in µs.
pub const MAX_WINDOW_US: u32 = 30_000;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer's tensor is another.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Tensor {
        op: Op::Mcts,
        bar_stream: 5.0,
        tolerance: 2e-2,
        note: "same to 2e-2 at the scale of 1 ms, since ours takes the last event and the peer the one of greatest time; both f32",
    };
    let make = || Scales::up_to(MAX_WINDOW_US)
            .and_then(|scales| Mcts::<f32, Vec<u32>>::try_new(scene.geometry, scales, vec![0; 2 * scene.geometry.pixels()]));
    make().map_err(|e| e.to_string())?;
    #[allow(clippy::expect_used)] // it was made above
    let make = move || make().expect("made above");
    op.contests(scene, peer, make)
}
