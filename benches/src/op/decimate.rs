//! Every n-th event.

use lobula_core::chain::StageSpec;
use lobula_core::filter::DecimateParams;

use super::Op;
use super::thinned::Thinned;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// Of how many events one is kept.
pub const N: u32 = 4;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer keeps other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Thinned { op: Op::Decimate, bar_stream: Some(2.0), note: "same events; peer: no streaming form" };
    op.of_settings(scene, peer, StageSpec::Decimate(DecimateParams { n: N }))
}
