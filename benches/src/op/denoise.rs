//! Events without those of hot pixels, that follow too soon or that too few neighbours support, in one pass.

use lobula_core::chain::StageSpec;
use lobula_core::filter::DenoiseParams;

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
    let op = Thinned { op: Op::Denoise, bar_stream: None, note: "hot pixels, refractory period and 2 of 8 neighbours over one map of 16-bit ticks of 8 µs" };
    op.of_settings(scene, None, StageSpec::Denoise(DenoiseParams { shift: 3, ..DenoiseParams::default() }.into()))
}
