//! What the operations that move events share.

use std::hint::black_box;

use lobula_core::augmentation::Seed;
use lobula_core::chain::{AnyTransform, StageSpec};
use lobula_core::transform::TransformError;
use lobula_core::{Event, Geometry, Span, Transform};

use super::{Events, Op, same_events, worked_on};
use crate::contest::{Contest, Protocol, Unit, Work};
use crate::input::{PACKET_EVENTS, Scene, block_of, packets};
use crate::peers::Library;

/// Packets of the `stream` protocol, which are in the second-level cache, as they are between two stages of a chain.
const RESIDENT_PACKETS: usize = 32;

/// The contests of a transform of these settings, which gives the peer's events.
///
/// # Errors
/// A sentence, where it cannot be made or the peer gives other events.
pub fn of_settings<'a>(
    op: Op,
    scene: &'a Scene,
    peer: Option<&'a dyn Library>,
    settings: StageSpec,
) -> Result<Vec<Contest<'a>>, String> {
    let make = move || match AnyTransform::try_new(&settings, scene.geometry) {
        Some(made) => made.map_err(|cause| format!("{cause:?}")),
        None => Err(format!("{} is no transform", settings.kind())),
    };
    let note = "same events; ours: in place, in cache (whole: into a fresh array); peer: fresh columns, no streaming form";
    Moved { op, same: true, note }.contests(scene, peer, make)
}

/// The contests of a random transform that `make` makes of these settings: it gives other events than the peer's.
///
/// # Errors
/// A sentence, where it cannot be made.
pub fn at_random<'a, P: Copy + 'a, T: Transform + Clone + 'a>(
    op: Op,
    scene: &'a Scene,
    peer: Option<&'a dyn Library>,
    make: fn(Geometry, P, Seed) -> Result<T, TransformError>,
    settings: P,
) -> Result<Vec<Contest<'a>>, String> {
    let note = "of another generator of random numbers; peer: fresh columns, no streaming form";
    Moved { op, same: false, note }
        .contests(scene, peer, move || make(scene.geometry, settings, Seed::default()))
}

/// An operation that moves events.
pub struct Moved {
    /// Which.
    pub op: Op,
    /// Whether a peer gives the same events: one of another generator of random numbers does not.
    pub same: bool,
    /// How the two sides differ in what they do.
    pub note: &'static str,
}

impl Moved {
    /// The operation's contests, where `make` makes our transform.
    ///
    /// # Errors
    /// A sentence, where the transform cannot be made or the peer gives other events.
    pub fn contests<'a, T: Transform + Clone + 'a, E: core::fmt::Display>(
        &self,
        scene: &'a Scene,
        peer: Option<&'a dyn Library>,
        make: impl Fn() -> Result<T, E> + 'a,
    ) -> Result<Vec<Contest<'a>>, String> {
        let make = move || make().map_err(|e| e.to_string());
        let moved = move_all(scene, &mut make()?)?;
        let theirs = match peer.map(|peer| peer.events(self.op)) {
            Some(events) if self.same => {
                same_events(&moved, &events).map_err(|e| format!("{}: {e}", self.op.name()))?;
                events.len()
            }
            Some(events) => events.len(),
            None => 0,
        };
        let (mut stream, count) = (in_packets(scene, make()?), moved.len() as u64);
        let expected = stream();
        let whole: Work<'a> = Box::new(move || {
            let moved = make().and_then(|mut transform| move_all(scene, &mut transform));
            black_box(moved).map_or(0, |moved| moved.len() as u64)
        });
        Ok(vec![
            self.contest(Protocol::Whole, scene, peer, (count, theirs), whole),
            self.contest(Protocol::Stream, scene, peer, (expected, theirs), stream),
        ])
    }

    /// The contest of `ours`, which gives so many events, and the peer's, which gives so many.
    pub fn contest<'a>(
        &self,
        protocol: Protocol,
        scene: &'a Scene,
        peer: Option<&'a dyn Library>,
        (expected, theirs): (u64, usize),
        ours: Work<'a>,
    ) -> Contest<'a> {
        let mut peers = peer.map_or_else(Vec::new, |peer| peer.ways(self.op, protocol));
        for peer in &mut peers {
            peer.expected = Some(theirs as u64);
        }
        Contest {
            op: self.op.name(),
            kernel: "portable",
            protocol,
            unit: Unit::Rate,
            events: scene.events.len(),
            expected,
            ours,
            peers,
            bar: (protocol == Protocol::Stream).then_some(2.0),
            note: self.note,
        }
    }
}

/// The scene's events as `transform` moves them, in a fresh array.
fn move_all(scene: &Scene, transform: &mut impl Transform) -> Result<Events, String> {
    worked_on(scene, |block| transform.apply(block).map_err(|e| e.to_string()))
}

/// As many events as the scene has, of its first packets again and again: copied into one buffer, as a decoder would
/// write them, and moved there.
fn in_packets<'a, T: Transform + Clone + 'a>(scene: &'a Scene, transform: T) -> Work<'a> {
    let mut buffer = vec![Event::default(); PACKET_EVENTS];
    let resident: Vec<Span<'a>> = packets(scene.span(RESIDENT_PACKETS * PACKET_EVENTS)).collect();
    let count = scene.events.len() / PACKET_EVENTS;
    Box::new(move || {
        // Anew, since what is random goes by the number of the event.
        let mut transform = transform.clone();
        let mut left = 0;
        for packet in resident.iter().cycle().take(count) {
            let mut block = block_of(*packet, &mut buffer);
            left += transform.apply(&mut block).unwrap_or_default() as u64;
            black_box(&mut block);
        }
        left
    })
}
