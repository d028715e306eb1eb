//! Events to an image of the last one's colour, fading.

use lobula_core::representation::{EventImage, Palette};

use super::Op;
use super::tensor::Tensor;
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// How fast colours fade, in µs.
pub const TAU_US: u32 = 30_000;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer's image is another.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Tensor {
        op: Op::EventImage,
        bar_stream: 2.0,
        tolerance: 1.0,
        note: "within a level but for up to 1000 elements of 2.8 million, as for tencode; ours in planes, the peer's interleaved",
    };
    let make = || EventImage::try_new(scene.geometry, TAU_US, Palette::Dark, vec![0; scene.geometry.pixels()]);
    make().map_err(|e| e.to_string())?;
    #[allow(clippy::expect_used)] // it was made above
    let make = move || make().expect("made above");
    op.contests_but(1000, scene, peer, make)
}
