//! Events without those that follow too soon at their pixel.

use lobula_core::filter::{Refractory, RefractoryParams, Refresh};

use super::Op;
use super::thinned::Thinned;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The refractory period in µs.
pub const PERIOD_US: u32 = 1_000;

/// 16 bits hold this period in ticks of 1 µs: the verdicts are those of 64-bit times, in half the memory.
type Stage = Refractory<u16, Vec<u16>>;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer keeps other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    stage(scene)?;
    let op = Thinned {
        op: Op::Refractory,
        bar_stream: Some(5.0),
        note: "same events; ours: a map of 16-bit ticks of 1 µs; peer: of 64-bit times, no streaming form",
    };
    #[allow(clippy::expect_used)] // it was made above
    op.contests(scene, peer, || stage(scene).expect("made above"))
}

fn stage(scene: &Scene) -> Result<Stage, String> {
    let params = RefractoryParams { dt_us: PERIOD_US, refresh: Refresh::Kept, shift: 0 };
    let map = vec![0; Stage::required_len(scene.geometry)];
    Stage::try_new(scene.geometry, params, map).map_err(|e| e.to_string())
}
