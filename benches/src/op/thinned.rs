//! What the operations that thin a stream share.

use std::hint::black_box;

use lobula_core::chain::{AnyFilter, StageSpec};
use lobula_core::{Event, Filter};

use super::{Events, Op, same_events, worked_on};
use crate::contest::{Contest, Protocol, Unit, Work};
use crate::input::{PACKET_EVENTS, Scene, block_of, packets};
use crate::peers::Library;

/// A time in µs that no scene reaches.
const FAR_US: u64 = 1 << 48;

/// The contests of a filter of these settings, which keeps the peer's events.
///
/// # Errors
/// A sentence, where it cannot be made or the peer keeps other events.
pub fn of_settings<'a>(
    op: Op,
    scene: &'a Scene,
    peer: Option<&'a dyn Library>,
    filter: StageSpec,
) -> Result<Vec<Contest<'a>>, String> {
    let note = "same events; peer: fresh columns, no streaming form";
    Thinned { op, bar_stream: Some(2.0), note }.of_settings(scene, peer, filter)
}

/// An operation that thins a stream.
pub struct Thinned {
    /// Which.
    pub op: Op,
    /// How much faster `stream` shall be; `whole` twice.
    pub bar_stream: Option<f64>,
    /// How the two sides differ in what they do.
    pub note: &'static str,
}

impl Thinned {
    /// The operation's contests, where `make` makes our filter.
    ///
    /// # Errors
    /// A sentence, where the peer keeps other events.
    pub fn contests<'a, F: Filter + 'a>(
        &self,
        scene: &'a Scene,
        peer: Option<&'a dyn Library>,
        make: impl Fn() -> F + 'a,
    ) -> Result<Vec<Contest<'a>>, String> {
        let kept = self.checked(scene, peer, &mut make())?;
        let stream = thin_in_packets(scene, make());
        Ok(vec![
            self.contest(Protocol::Whole, scene, peer, kept, whole(scene, make)),
            self.contest(Protocol::Stream, scene, peer, kept, stream),
        ])
    }

    /// The contests of a host's filter of these settings.
    ///
    /// # Errors
    /// A sentence, where it cannot be made, or the peer keeps other events.
    pub fn of_settings<'a>(
        &self,
        scene: &'a Scene,
        peer: Option<&'a dyn Library>,
        filter: StageSpec,
    ) -> Result<Vec<Contest<'a>>, String> {
        AnyFilter::try_new(&filter, scene.geometry).map_err(|cause| format!("{cause:?}"))?;
        #[allow(clippy::expect_used)] // it was made above
        self.contests(scene, peer, move || AnyFilter::try_new(&filter, scene.geometry).expect("made above"))
    }

    /// How many events `filter` keeps.
    ///
    /// # Errors
    /// A sentence, where the peer keeps other events.
    pub fn checked(
        &self,
        scene: &Scene,
        peer: Option<&dyn Library>,
        filter: &mut impl Filter,
    ) -> Result<usize, String> {
        let kept = thin(scene, filter)?;
        if let Some(peer) = peer {
            same_events(&kept, &peer.events(self.op)).map_err(|e| format!("{}: {e}", self.op.name()))?;
        }
        Ok(kept.len())
    }

    /// The contest of `ours`, which keeps `kept` events.
    pub fn contest<'a>(
        &self,
        protocol: Protocol,
        scene: &'a Scene,
        peer: Option<&'a dyn Library>,
        kept: usize,
        ours: Work<'a>,
    ) -> Contest<'a> {
        Contest {
            op: self.op.name(),
            kernel: "portable",
            protocol,
            unit: Unit::Rate,
            events: scene.events.len(),
            expected: kept as u64,
            ours,
            peers: peer.map_or_else(Vec::new, |peer| peer.ways(self.op, protocol)),
            bar: if protocol == Protocol::Whole { Some(2.0) } else { self.bar_stream },
            note: self.note,
        }
    }
}

/// The scene's events that `filter` keeps, in a fresh array.
///
/// # Errors
/// A sentence, where there is no memory.
pub fn thin(scene: &Scene, filter: &mut impl Filter) -> Result<Events, String> {
    worked_on(scene, |block| filter.retain(block).map_err(|e| e.to_string()))
}

/// All events at once, into a fresh array with a fresh map.
fn whole<'a, F: Filter>(scene: &'a Scene, make: impl Fn() -> F + 'a) -> Work<'a> {
    Box::new(move || black_box(thin(scene, &mut make())).map_or(0, |kept| kept.len() as u64))
}

/// A packet at a time: copied into one buffer, as a decoder would write it, and thinned there.
pub fn thin_in_packets<'a, F: Filter + 'a>(scene: &'a Scene, mut filter: F) -> Work<'a> {
    let mut buffer = vec![Event::default(); PACKET_EVENTS];
    Box::new(move || {
        // The scene's start is then a restart of the clock, at which a filter forgets the run before.
        filter.advance(FAR_US);
        let mut kept = 0;
        for packet in packets(scene.span(scene.events.len())) {
            let mut block = block_of(packet, &mut buffer);
            kept += filter.retain(&mut block).unwrap_or_default() as u64;
            black_box(&mut block);
        }
        kept
    })
}
