//! Events without those of pixels whose leaky counter is full.

use lobula_core::chain::StageSpec;
use lobula_core::filter::LeakyHotPixelParams;

use super::Op;
use super::thinned::Thinned;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The operation's contests; no peer has it.
///
/// # Errors
/// A sentence, where the filter cannot be made.
pub fn contests<'a>(scene: &'a Scene, _: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Thinned { op: Op::LeakyHotPixel, bar_stream: None, note: "a counter of 8 bits a pixel" };
    op.of_settings(scene, None, StageSpec::LeakyHotPixel(LeakyHotPixelParams::default()))
}
