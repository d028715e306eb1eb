//! EVT3 bytes to events.

use std::hint::black_box;

use lobula_core::wire::evt3::{Decoder, Kernel};
use lobula_core::{Decode, Event, Sink};
use lobula_formats::LargeArray;

use super::{Op, same_events};
use crate::contest::{Contest, Protocol, Unit, Work};
use crate::input::{PACKET_EVENTS, Scene};
use crate::peers::Library;

/// The name in reports.
pub const NAME: &str = "evt3_decode";

/// Bytes handed to the decoder in one go: a USB transfer's worth.
const TRANSFER_BYTES: usize = 1 << 16;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer decodes other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    if let Some(peer) = peer {
        same_events(&scene.events, &peer.events(Op::Evt3Decode))?;
    }
    let contest = |kernel, protocol, ours, bar| Contest {
        op: NAME,
        kernel,
        protocol,
        unit: Unit::Rate,
        events: scene.events.len(),
        expected: scene.events.len() as u64,
        ours,
        peers: peer.map_or_else(Vec::new, |peer| peer.ways(Op::Evt3Decode, protocol)),
        bar: Some(bar),
        note: "same events; ours: 8 bytes an event, whole: on 2 MiB pages; peer: 13",
    };
    let kernels = [("portable", Kernel::Portable, 4.0), ("avx512", Kernel::Avx512, 6.0)];
    let available = kernels.into_iter().filter(|(_, kernel, _)| kernel.is_available());
    Ok(available
        .flat_map(|(name, kernel, bar_stream)| {
            [
                contest(name, Protocol::Whole, whole(scene, kernel), 2.0),
                contest(name, Protocol::Stream, stream(scene, kernel), bar_stream),
            ]
        })
        .collect())
}

/// All bytes at once, into a fresh array.
fn whole(scene: &Scene, kernel: Kernel) -> Work<'_> {
    Box::new(move || {
        let words = scene.bytes.len() / 2;
        let mut decoder = Decoder::with_kernel(scene.geometry, kernel);
        let Ok(mut events) = LargeArray::zeroed(words) else { return 0 };
        let mut sink = Sink::new(&mut events);
        decoder.decode(&scene.bytes, &mut sink);
        let len = sink.len();
        events.truncate(len);
        black_box(events).len() as u64
    })
}

/// A transfer's bytes at a time, into one packet's buffer.
fn stream(scene: &Scene, kernel: Kernel) -> Work<'_> {
    let mut buffer = vec![Event::default(); PACKET_EVENTS];
    Box::new(move || {
        let mut decoder = Decoder::with_kernel(scene.geometry, kernel);
        let mut events = 0;
        for mut transfer in scene.bytes.chunks(TRANSFER_BYTES) {
            while !transfer.is_empty() {
                let mut sink = Sink::new(&mut buffer);
                let taken = decoder.decode(transfer, &mut sink);
                events += sink.len() as u64;
                black_box(sink.block(scene.geometry));
                transfer = &transfer[taken..];
            }
        }
        events
    })
}
