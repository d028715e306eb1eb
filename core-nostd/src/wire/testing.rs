//! What the decoders' tests share: a decoder's findings as one line.

use crate::{Counters, Decode, Event, Fault, Sink, Trigger};

/// The events of `bytes`, with their full times.
pub(super) fn decode_words(decoder: &mut impl Decode, bytes: &[u8]) -> Vec<(u64, Event)> {
    decode_all(decoder, bytes).0
}

fn decode_all(decoder: &mut impl Decode, bytes: &[u8]) -> (Vec<(u64, Event)>, Vec<Trigger>) {
    let (mut events, mut triggers) = (vec![], vec![]);
    let mut rest = bytes;
    while !rest.is_empty() {
        let mut memory = [Event::default(); Sink::LEN_MIN];
        let mut trigger_memory = [Trigger::default(); 1];
        let mut sink = Sink::with_triggers(&mut memory, &mut trigger_memory);
        let n = decoder.decode(rest, &mut sink);
        rest = &rest[n..];
        triggers.extend(sink.triggers());
        let block = sink.block(decoder.geometry());
        events.extend(block.span().events.iter().map(|event| (block.span().time(*event), *event)));
    }
    (events, triggers)
}

/// Everything a decoder tells of a stream.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Told {
    pub events: Vec<(u64, Event)>,
    pub triggers: Vec<Trigger>,
    pub counters: Counters,
    pub now: u64,
}

/// Feeds `bytes` in the given pieces to sinks of `room` events and `triggers` triggers.
pub(super) fn decode_in(
    decoder: &mut impl Decode,
    bytes: &[u8],
    pieces: &[usize],
    room: usize,
    triggers: usize,
) -> Told {
    let mut told = Told::default();
    let mut memory = vec![Event::default(); room];
    let mut trigger_memory = vec![Trigger::default(); triggers];
    let mut rest = bytes;
    let mut pieces = pieces.iter().cycle();
    while !rest.is_empty() {
        let (mut piece, tail) = rest.split_at(rest.len().min(*pieces.next().unwrap()));
        rest = tail;
        while !piece.is_empty() {
            let mut sink = Sink::with_triggers(&mut memory, &mut trigger_memory);
            let taken = decoder.decode(piece, &mut sink);
            told.triggers.extend(sink.triggers());
            let block = sink.block(decoder.geometry());
            let span = block.span();
            told.events.extend(span.events.iter().map(|event| (span.time(*event), *event)));
            assert!(taken > 0 || !span.events.is_empty() || !told.triggers.is_empty(), "no progress");
            piece = &piece[taken..];
        }
    }
    told.counters = *decoder.counters();
    told.now = decoder.now();
    told
}

/// What a decoder finds in `bytes`: faults, events off the sensor, events, triggers.
pub(super) fn tell(mut decoder: impl Decode, bytes: &[u8]) -> String {
    let (events, triggers) = decode_all(&mut decoder, bytes);
    decoder.finish();
    let counters = decoder.counters();
    let faults = Fault::ALL.iter().map(|fault| (fault.name(), counters.faults.get(*fault)));
    let counts = faults.chain([("off sensor", counters.off_sensor)]);
    let mut told: Vec<String> =
        counts.filter(|(_, n)| *n > 0).map(|(what, n)| format!("{what} {n}")).collect();
    for (t, event) in events {
        told.push(format!("t={t} x={} y={} p={}", event.x(), event.y(), event.is_on() as u8));
    }
    for Trigger { t, ordinal, channel, edge } in triggers {
        told.push(format!("trigger t={t} after={ordinal} channel={channel} p={}", edge as u8));
    }
    told.join(", ")
}
