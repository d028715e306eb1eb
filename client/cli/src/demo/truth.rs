//! What is known of the raw events without the daemon: the scene and its labels, or the recording itself.

use crate::Failure;
use lobula_core::filter::{HotPixelLearner, PixelMask};
use lobula_core::simulation::Scene;
use lobula_core::{Event, Span};
use lobula_formats::Recording;
use std::ops::Range;

/// The raw events, regenerated or read.
#[derive(Debug)]
pub enum Truth {
    /// A synthetic scene, made here from the same spec as in the daemon.
    Scene(Box<Scene>),
    /// A recording, and the time of its first and last event.
    Recording(Box<Recording>, Range<u64>),
}

/// Silence that the daemon's file source puts between two turns of a loop, in µs.
const LOOP_GAP_US: u64 = lobulad::source::PACKET_US;

impl Truth {
    /// That of a recording.
    pub fn recording(recording: Recording) -> Result<Self, Failure> {
        let summary = lobula_formats::Summary::of(&recording, lobula_formats::WithDigest::No)?;
        let first = summary.t_first_us.unwrap_or_default();
        let last = summary.t_last_us.unwrap_or_default().max(first);
        Ok(Self::Recording(Box::new(recording), first..last))
    }

    /// How long it takes before it repeats, in µs.
    pub fn duration_us(&self) -> u64 {
        match self {
            Self::Scene(scene) => scene.period_us(),
            Self::Recording(_, all) => all.end - all.start,
        }
    }

    /// The scene, if it is one.
    pub fn scene(&self) -> Option<&Scene> {
        match self {
            Self::Scene(scene) => Some(scene),
            Self::Recording(..) => None,
        }
    }

    /// Shows each raw event of a stretch of the daemon's stream time.
    pub fn raw(&self, t: Range<u64>, mut show: impl FnMut(Event)) -> Result<(), Failure> {
        match self {
            Self::Scene(scene) => {
                let in_loop = |t: u64| (t % scene.period_us()) as u32;
                let place = |t: u64| scene.events().partition_point(|event| event.t() < in_loop(t));
                let (start, end) = (place(t.start), place(t.end));
                let (events, turns) =
                    (scene.events(), t.end / scene.period_us() != t.start / scene.period_us());
                let parts = if turns { [start..events.len(), 0..end] } else { [start..end, 0..0] };
                let parts = parts.into_iter().flat_map(|part| events.get(part).unwrap_or_default());
                parts.for_each(|event| show(*event));
                Ok(())
            }
            Self::Recording(recording, all) => {
                let turn = all.end - all.start + LOOP_GAP_US;
                let start = all.start + t.start.saturating_sub(all.start) % turn;
                let mut blocks = recording.slice_time(start..start + (t.end - t.start))?;
                while let Some(chunk) = blocks.next_block()? {
                    chunk.span().events.iter().for_each(|event| show(*event));
                }
                Ok(())
            }
        }
    }

    /// The hot pixels, learned from the events of one loop of the scene as from any camera: no label is looked at.
    pub fn hot_pixels(&self) -> Result<Vec<(u16, u16)>, Failure> {
        const SIGMAS: f32 = 10.0;
        let Self::Scene(scene) = self else { return Ok(Vec::new()) };
        let geometry = scene.geometry();
        let span = Span { t_first: 0, t_last: scene.period_us(), geometry, events: scene.events() };
        let counters = vec![0; HotPixelLearner::<()>::required_len(geometry)];
        let mut learner = HotPixelLearner::try_new(geometry, counters).map_err(Failure::general)?;
        learner.learn(span).map_err(Failure::general)?;
        let words = vec![0; PixelMask::<()>::required_len(geometry)];
        Ok(learner.mask(SIGMAS, words).map_err(Failure::general)?.iter().collect())
    }
}
