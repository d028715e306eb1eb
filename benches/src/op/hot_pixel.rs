//! Events without those of pixels that fire far too often.

use std::hint::black_box;

use lobula_core::filter::{HotPixelFilter, HotPixelLearner, PixelMask};

use super::Op;
use super::thinned::{Thinned, thin, thin_in_packets};
use crate::contest::{Contest, Protocol};
use crate::input::Scene;
use crate::peers::Library;

/// How many standard deviations above the mean of the active pixels a count must be.
pub const SIGMAS: f32 = 3.0;

/// The operation's contests: `whole` learns the mask from the events and drops its pixels' ones, `stream` drops those of
/// a mask learnt before.
///
/// # Errors
/// A sentence, where the peer keeps other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Thinned {
        op: Op::HotPixel,
        bar_stream: Some(5.0),
        note: "same events; whole: learn the mask and apply it; stream: apply it; peer: no streaming form",
    };
    let mut filter = learn(scene)?;
    let kept = op.checked(scene, peer, &mut filter)?;
    let whole = Box::new(|| {
        let kept = learn(scene).and_then(|mut filter| thin(scene, &mut filter));
        black_box(kept).map_or(0, |kept| kept.len() as u64)
    });
    Ok(vec![
        op.contest(Protocol::Whole, scene, peer, kept, whole),
        op.contest(Protocol::Stream, scene, peer, kept, thin_in_packets(scene, filter)),
    ])
}

fn learn(scene: &Scene) -> Result<HotPixelFilter<Vec<u32>>, String> {
    let counters = vec![0; HotPixelLearner::<()>::required_len(scene.geometry)];
    let mut learner = HotPixelLearner::try_new(scene.geometry, counters).map_err(|e| e.to_string())?;
    learner.learn(scene.span(scene.events.len())).map_err(|e| e.to_string())?;
    let words = vec![0; PixelMask::<()>::required_len(scene.geometry)];
    learner.mask(SIGMAS, words).map(HotPixelFilter::new).map_err(|e| e.to_string())
}
