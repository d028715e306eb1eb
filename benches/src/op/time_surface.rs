//! Events to a decayed time surface per polarity.

use lobula_core::representation::TimeSurface;

use super::Op;
use super::tensor::Tensor;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// Decay in µs.
pub const TAU_US: u32 = 30_000;

/// Its type.
pub type Surface = TimeSurface<f32, Vec<u32>>;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer's surface is another.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    surface(scene)?;
    let op = Tensor {
        op: Op::TimeSurface,
        bar_stream: 5.0,
        tolerance: 5e-4,
        note: "same to 5e-4, since ours takes the last event and the peer the one of greatest time; both f32",
    };
    #[allow(clippy::expect_used)] // it was made above
    op.contests(scene, peer, || surface(scene).expect("made above"))
}

/// The surface of the operation.
///
/// # Errors
/// A sentence, where it cannot be made.
pub fn surface(scene: &Scene) -> Result<Surface, String> {
    let map = vec![0; Surface::state_len(scene.geometry)];
    Surface::try_new(scene.geometry, TAU_US, map).map_err(|e| e.to_string())
}
