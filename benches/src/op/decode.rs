//! Bytes to events, in both protocols, by any decoder.

use std::hint::black_box;

use lobula_core::wire::Kernel;
use lobula_core::{Decode, Event, Sink};
use lobula_formats::LargeArray;

use super::{Op, same_events};
use crate::contest::{Contest, Protocol, Unit, Work};
use crate::input::PACKET_EVENTS;
use crate::peers::Library;
use crate::wire::Wire;

/// Bytes handed to the decoder in one go: a USB transfer's worth.
const TRANSFER_BYTES: usize = 1 << 16;

/// All bytes at once, into a fresh array of `room` events.
pub fn whole<'a, D: Decode>(bytes: &'a [u8], room: usize, decoder: impl Fn() -> D + 'a) -> Work<'a> {
    Box::new(move || {
        let mut decoder = decoder();
        let Ok(mut events) = LargeArray::zeroed(room) else { return 0 };
        let mut sink = Sink::new(&mut events);
        decoder.decode(bytes, &mut sink);
        let len = sink.len();
        events.truncate(len);
        black_box(events).len() as u64
    })
}

/// A transfer's bytes at a time, into one packet's buffer.
pub fn stream<'a, D: Decode>(bytes: &'a [u8], decoder: impl Fn() -> D + 'a) -> Work<'a> {
    let mut buffer = vec![Event::default(); PACKET_EVENTS];
    Box::new(move || {
        let mut decoder = decoder();
        let mut events = 0;
        for mut transfer in bytes.chunks(TRANSFER_BYTES) {
            while !transfer.is_empty() {
                let mut sink = Sink::new(&mut buffer);
                let taken = decoder.decode(transfer, &mut sink);
                events += sink.len() as u64;
                black_box(sink.block(decoder.geometry()));
                transfer = &transfer[taken..];
            }
        }
        events
    })
}

/// The contests of a format beside EVT3, with every kernel of this machine.
///
/// # Errors
/// A sentence, where a peer that knows the format decodes other events.
pub fn of_wire<'a>(
    op: Op,
    wire: &'a Wire,
    peer: Option<&'a dyn Library>,
    note: &'static str,
) -> Result<Vec<Contest<'a>>, String> {
    let theirs = peer.and_then(|peer| peer.decoded(wire));
    if let Some(theirs) = &theirs {
        same_events(&wire.events, theirs)?;
    }
    let peer = peer.filter(|_| theirs.is_some());
    let contest = |kernel, protocol, ours| -> Result<Contest<'a>, String> {
        Ok(Contest {
            op: op.name(),
            kernel,
            protocol,
            unit: Unit::Rate,
            events: wire.events.len(),
            expected: wire.events.len() as u64,
            ours,
            peers: peer.map_or(Ok(Vec::new()), |peer| peer.decoders(wire, protocol))?,
            bar: None,
            note,
        })
    };
    let kernels = [("portable", Kernel::Portable), ("neon", Kernel::Neon), ("avx512", Kernel::Avx512)];
    let available = kernels.into_iter().filter(|(_, kernel)| kernel.is_available());
    available
        .flat_map(|(name, kernel)| {
            let decoder = move || wire.decoder(kernel);
            let room = wire.events.len() + Sink::LEN_MIN;
            [
                contest(name, Protocol::Whole, whole(&wire.bytes, room, decoder)),
                contest(name, Protocol::Stream, stream(&wire.bytes, decoder)),
            ]
        })
        .collect()
}
