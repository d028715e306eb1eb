//! EVT3 bytes to counts per pixel and polarity, without storing events.

use lobula_core::representation::PolarityHistogram;

use super::{Op, fused};
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The operation's contests.
///
/// # Errors
/// A sentence, where a side cannot read the bytes.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let ours = PolarityHistogram::<u8>::new(scene.geometry);
    fused::contests(Op::FilePolarity, 5.0, scene, peer, ours)
}
