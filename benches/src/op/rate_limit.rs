//! Events up to a budget a period, of all tiles.

use lobula_core::chain::StageSpec;
use lobula_core::filter::RateLimitParams;

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
    let op = Thinned { op: Op::RateLimit, bar_stream: None, note: "5000 events a ms, tiles of 32x32 pixels" };
    op.of_settings(scene, None, StageSpec::RateLimit(RateLimitParams { events: 5_000, period_us: 1_000, tile_shift: 5 }))
}
