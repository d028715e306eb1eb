//! EVT3 bytes to a decayed time surface per polarity, without storing events.

use lobula_core::representation::TimeSurface;

use super::{Op, fused};
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The operation's contests.
///
/// # Errors
/// A sentence, where a side cannot read the bytes.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let ours = TimeSurface::<f32, _>::try_new(scene.geometry, super::time_surface::TAU_US, vec![0; 2 * scene.geometry.pixels()]).map_err(|e| e.to_string())?;
    fused::contests(Op::FileTimeSurface, 5.0, scene, peer, ours)
}
