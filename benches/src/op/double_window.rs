//! Events without those that are far from the last ones.

use lobula_core::chain::StageSpec;
use lobula_core::filter::DoubleWindowParams;

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
    let op = Thinned { op: Op::DoubleWindow, bar_stream: None, note: "two windows of 64 events" };
    op.of_settings(scene, None, StageSpec::DoubleWindow(DoubleWindowParams::default()))
}
