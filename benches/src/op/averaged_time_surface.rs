//! Events to the mean decay per pixel and polarity.

use lobula_core::representation::AveragedTimeSurface;

use super::Op;
use super::tensor::Tensor;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// Decay in µs.
pub const TAU_US: u32 = 30_000;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer's tensor is another.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Tensor {
        op: Op::AveragedTimeSurface,
        bar_stream: 5.0,
        tolerance: 1e-4,
        note: "same to 1e-4; both f32, ours adds in f32, peer in f64",
    };
    let make = || AveragedTimeSurface::try_new(scene.geometry, TAU_US, vec![0u32; AveragedTimeSurface::<Vec<u32>>::state_len(scene.geometry)]);
    make().map_err(|e| e.to_string())?;
    #[allow(clippy::expect_used)] // it was made above
    let make = move || make().expect("made above");
    op.contests(scene, peer, make)
}
