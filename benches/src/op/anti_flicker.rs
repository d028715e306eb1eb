//! Events without those of tiles that flicker.

use lobula_core::chain::StageSpec;
use lobula_core::filter::AntiFlickerParams;

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
    let op = Thinned { op: Op::AntiFlicker, bar_stream: None, note: "tiles of 8x8 pixels" };
    op.of_settings(scene, None, StageSpec::AntiFlicker(AntiFlickerParams::default()))
}
