//! What the decoders' tests share: a decoder's findings as one line.

use crate::{Decode, Event, Fault, Sink, Trigger};

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
