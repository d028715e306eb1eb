//! Events of a set of pixels.

use lobula_core::chain::{StageSpec, MaskSpec};
use lobula_core::filter::MaskKeep;

use super::Op;
use super::thinned::Thinned;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// Whether a pixel is in the set: four of five, spread over the sensor.
pub const fn inside(x: u16, y: u16) -> bool {
    !(x as u32 * 7 + y as u32 * 3).is_multiple_of(5)
}

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer keeps other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let note = "same events; ours: one bit a pixel; peer: one byte, no streaming form";
    let op = Thinned { op: Op::Mask, bar_stream: Some(2.0), note };
    let rows = 0..scene.geometry.height;
    let pixels = rows.flat_map(|y| (0..scene.geometry.width).map(move |x| (x, y)));
    let pixels = pixels.filter(|(x, y)| inside(*x, *y)).collect();
    op.of_settings(scene, peer, StageSpec::Mask(MaskSpec { pixels, keep: MaskKeep::Inside }))
}
