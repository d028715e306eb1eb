//! Events to counts per pixel.

use lobula_core::representation::{Count, Tally};
use lobula_core::tensor::Element;

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
    let note = "same counts, ours up to 255: u8, the default of views; peer: u64";
    of_elements::<u8>(Op::Count, note, scene, peer)
}

/// The contests of counts up to 65535, for many events.
///
/// # Errors
/// A sentence, where the peer's tensor is another.
pub fn wide<'a>(op: Op, scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    of_elements::<u16>(op, "same counts, ours up to 65535: u16; peer: u64", scene, peer)
}

fn of_elements<'a, P: Tally + Element + 'a>(
    op: Op,
    note: &'static str,
    scene: &'a Scene,
    peer: Option<&'a dyn Library>,
) -> Result<Vec<Contest<'a>>, String> {
    let op = Tensor { op, bar_stream: 5.0, tolerance: 0.0, note };
    op.contests(scene, peer, || Count::<P>::new(scene.geometry))
}
