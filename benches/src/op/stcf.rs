//! Events without those that fewer than 2 of 8 neighbours support.

use lobula_core::chain::StageSpec;
use lobula_core::filter::StcfParams;

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
    let op = Thinned { op: Op::Stcf, bar_stream: None, note: "a map of 16-bit ticks of 8 µs" };
    op.of_settings(scene, None, StageSpec::Stcf(StcfParams { shift: 3, ..StcfParams::default() }))
}
