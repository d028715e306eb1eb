//! What the operations from bytes to a tensor share: nothing but a packet of events is in memory at a time.

use std::hint::black_box;

use bytemuck::Zeroable;
use lobula_core::wire::evt3::Decoder;
use lobula_core::{Decode, Event, Geometry, Representation, Sink, Window};

use super::Op;
use crate::contest::{Contest, Protocol, Unit};
use crate::input::{PACKET_EVENTS, Scene};
use crate::peers::Library;

/// The bytes of a tensor's events.
pub struct Stretch<'a> {
    /// EVT3 words.
    pub bytes: &'a [u8],
    /// How many events they hold: those of a tensor, but for the last word's.
    pub events: usize,
}

impl<'a> Stretch<'a> {
    fn of(scene: &'a Scene) -> Self {
        let mut memory = vec![Event::default(); scene.tensor_events];
        let mut sink = Sink::new(&mut memory);
        let taken = Decoder::new(scene.geometry).decode(&scene.bytes, &mut sink);
        Self { bytes: &scene.bytes[..taken], events: sink.len() }
    }
}

/// The contest of an operation, where `ours` is our representation. In the `stream` protocol only: it is what it is for.
///
/// # Errors
/// A sentence, where a side cannot read the bytes.
pub fn contests<'a, R: Representation + 'a>(
    op: Op,
    bar: f64,
    scene: &'a Scene,
    peer: Option<&'a dyn Library>,
    mut ours: R,
) -> Result<Vec<Contest<'a>>, String> {
    let stretch = Stretch::of(scene);
    let peers = peer.map_or(Ok(Vec::new()), |peer| peer.fused(op, &stretch))?;
    let (geometry, window, Stretch { bytes, events }) = (scene.geometry, scene.tensor_window, stretch);
    let mut out = vec![R::Pixel::zeroed(); ours.shape().len()];
    let mut packet = vec![Event::default(); PACKET_EVENTS];
    let ours = Box::new(move || {
        let built = build(&mut ours, geometry, window, bytes, &mut packet, &mut out);
        black_box(&out);
        built
    });
    Ok(vec![Contest {
        op: op.name(),
        kernel: "best",
        protocol: Protocol::Stream,
        unit: Unit::Time,
        events,
        expected: events as u64,
        ours,
        peers,
        bar: Some(bar),
        note: "from EVT3 words to the tensor; the peer's words lie in a file it has opened and indexed",
    }])
}

/// Decodes and draws packet by packet; returns how many events.
fn build<R: Representation>(
    representation: &mut R,
    geometry: Geometry,
    window: Window,
    bytes: &[u8],
    packet: &mut [Event],
    out: &mut [R::Pixel],
) -> u64 {
    let mut decoder = Decoder::new(geometry);
    let (mut rest, mut events) = (bytes, 0);
    representation.begin(window, out);
    while !rest.is_empty() {
        let mut sink = Sink::new(packet);
        let taken = decoder.decode(rest, &mut sink);
        let block = sink.block(geometry);
        if taken == 0 || representation.accumulate(block.span(), out).is_err() {
            break;
        }
        events += block.len() as u64;
        rest = &rest[taken..];
    }
    representation.finish(out);
    events
}
