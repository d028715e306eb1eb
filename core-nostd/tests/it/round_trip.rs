//! Events through the encoder and the decoder of every format: the same events, or a refusal, and nothing between.

use crate::chunk_invariance::{Splits, decode, encode, encode_whole};
use crate::streams::{self, START_MAX_US, Timed};
use lobula_core::wire::{AnyDecoder, AnyEncoder, Encoding};
use lobula_core::{Decode, Encode, Event, Geometry, Polarity, Refused, Sink, Span, Trigger};
use proptest::prelude::*;

/// The largest sensor that the formats can tell.
const LARGEST: Geometry = Geometry::new(2048, 2048);

/// Encodes and decodes; the events that come out, and what was refused.
fn round_trip(encoding: Encoding, events: &[Timed]) -> (Vec<Timed>, Vec<Refused>) {
    let (bytes, refused) = encode(AnyEncoder::new(encoding), events, &mut Splits::Whole);
    let decoded = decode(AnyDecoder::new(encoding, LARGEST), &bytes, &mut Splits::Whole);
    assert_eq!((decoded.counters.bytes_faulty, decoded.counters.off_sensor), (0, 0), "{encoding}");
    (decoded.events, refused)
}

/// Bits of time that the format's TIME_HIGH and low bits tell together, and bits of the low.
fn time_bits(encoding: Encoding) -> (u32, u32) {
    match encoding {
        Encoding::Evt2 | Encoding::Evt21(_) | Encoding::Evt4 => (34, 6),
        Encoding::Evt3 => (24, 12),
    }
}

/// Naive: a step back is told when its TIME_HIGH lies in the same wrap and at most half a range back.
fn tells(encoding: Encoding, from: u64, to: u64) -> bool {
    let (bits, low) = time_bits(encoding);
    to >= from || (from >> bits == to >> bits && (from >> low) - (to >> low) <= 1 << (bits - low - 1))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..Default::default() })]

    #[test]
    fn events_come_back_or_are_refused(events in streams::stream(LARGEST, 60)) {
        for encoding in Encoding::ALL {
            let mut kept: Vec<Timed> = vec![];
            let mut refused = vec![];
            for timed in &events {
                match kept.last() {
                    Some(last) if !tells(*encoding, last.t, timed.t) => {
                        refused.push(Refused::StepBack { from: last.t, to: timed.t });
                    }
                    None if timed.t > START_MAX_US => refused.push(Refused::StartTooLate { t: timed.t }),
                    _ => kept.push(*timed),
                }
            }
            prop_assert_eq!(round_trip(*encoding, &events), (kept, refused), "{}", encoding);
        }
    }
}

#[test]
fn every_pixel_and_polarity_comes_back() {
    for encoding in Encoding::ALL {
        for y in 0..2048 {
            let pixel = |x: u16| {
                // Runs of a polarity, so that vectors form and break.
                let on = (x / 5 + y / 3 + x % 2 * (y % 2)) % 2;
                Timed::new(100 + u64::from(y) * 7, x, y, Polarity::from_bit(on))
            };
            let row: Vec<Timed> = (0..2048).map(pixel).collect();
            let turned: Vec<Timed> = row
                .iter()
                .map(|it| Timed::new(it.t, it.event.x(), y, Polarity::from_bit(!it.event.is_on() as u16)))
                .collect();
            for events in [row, turned] {
                assert!(round_trip(*encoding, &events) == (events, vec![]), "{encoding} row {y}");
            }
        }
    }
}

#[test]
fn starts_and_silence_keep_absolute_time() {
    let hour = 3_600_000_000;
    let times = [
        0,
        1,
        1 << 24,
        1 << 33,
        (1 << 34) - 1,
        1 << 34,
        (1 << 34) + (1 << 33),
        START_MAX_US - 1,
        START_MAX_US,
    ];
    for encoding in Encoding::ALL {
        for start in times {
            for gap in [
                0,
                1,
                (1 << 23) + 5,
                1 << 24,
                1 << 31,
                1 << 32,
                hour,
                3 * hour,
                (1 << 33) + 1,
                5 * hour,
                100 * hour,
            ] {
                let events = [start, start + gap, start + gap + 1].map(|t| Timed::new(t, 7, 9, Polarity::On));
                assert_eq!(
                    round_trip(*encoding, &events),
                    (events.to_vec(), vec![]),
                    "{encoding} {start} + {gap}"
                );
            }
        }
    }
}

#[test]
fn a_wrap_costs_two_words_at_most() {
    for encoding in Encoding::ALL {
        let (bits, _) = time_bits(*encoding);
        let cost =
            |t: u64| encode_whole(AnyEncoder::new(*encoding), &[Timed::new(t, 0, 0, Polarity::On)]).len();
        let word = encoding.word_bytes();
        assert!(
            cost(START_MAX_US) - cost(1) <= ((START_MAX_US >> bits) as usize * 2 + 1) * word,
            "{encoding}"
        );
    }
}

#[test]
fn what_no_format_holds_is_refused() {
    let epoch = 1_744_227_144_732_712;
    let cases = [
        (Timed::new(epoch, 0, 0, Polarity::On), Refused::StartTooLate { t: epoch }),
        (Timed::new(0, 2048, 0, Polarity::On), Refused::OffFormat { x: 2048, y: 0 }),
        (Timed::new(0, 0, 2048, Polarity::On), Refused::OffFormat { x: 0, y: 2048 }),
        (Timed::new(0, u16::MAX, 32767, Polarity::On), Refused::OffFormat { x: u16::MAX, y: 32767 }),
    ];
    for encoding in Encoding::ALL {
        for (event, reason) in cases {
            let fine = Timed::new(5, 1, 1, Polarity::Off);
            assert_eq!(round_trip(*encoding, &[event, fine]), (vec![fine], vec![reason]), "{encoding}");
        }
    }
}

/// Largest number of a trigger input in the format.
fn channel_max(encoding: Encoding) -> u8 {
    match encoding {
        Encoding::Evt2 | Encoding::Evt21(_) | Encoding::Evt4 => 31,
        Encoding::Evt3 => 15,
    }
}

/// Encodes with an output of `room` bytes at a time: an event before each trigger and one after the last.
fn encode_triggers(encoding: Encoding, triggers: &[Trigger], room: usize) -> Vec<u8> {
    let mut encoder = AnyEncoder::new(encoding);
    let (mut bytes, mut out) = (vec![], vec![0; room]);
    let event = |t: u64| [Event::new(t as u32, 3, 4, Polarity::On)];
    let mut put = |encoder: &mut AnyEncoder, t: u64, trigger: Option<Trigger>| loop {
        let events = event(t);
        let done = match trigger {
            Some(trigger) => encoder.trigger(trigger, &mut out),
            None => {
                encoder.encode(Span { t_first: t, t_last: t, geometry: LARGEST, events: &events }, &mut out)
            }
        };
        assert_eq!(done.refused, None);
        bytes.extend(&out[..done.bytes]);
        if done.events == 1 {
            break;
        }
    };
    for trigger in triggers {
        put(&mut encoder, trigger.t, None);
        put(&mut encoder, trigger.t, Some(*trigger));
    }
    put(&mut encoder, triggers.last().map_or(0, |last| last.t), None);
    loop {
        let n = encoder.finish(&mut out);
        if n == 0 {
            break bytes;
        }
        bytes.extend(&out[..n]);
    }
}

#[test]
fn triggers_come_back_at_their_place() {
    for encoding in Encoding::ALL.iter().copied() {
        let channels = 0..=channel_max(encoding);
        let edges = [Polarity::On, Polarity::Off];
        let kinds = channels.flat_map(|channel| edges.map(|edge| (channel, edge)));
        let times = [0, 1, 63, 64, 4095, 4096, 1 << 24, 1 << 34, (1 << 40) + 5];
        let triggers: Vec<_> = (1..)
            .zip(kinds.zip(times.into_iter().chain(1 << 41..)))
            .map(|(ordinal, ((channel, edge), t))| Trigger { t, ordinal, channel, edge })
            .collect();
        let bytes = encode_triggers(encoding, &triggers, 1000);
        assert_eq!(encode_triggers(encoding, &triggers, 1), bytes, "{encoding}: by any size of output");

        let (mut events, mut told) = (vec![], vec![]);
        let (mut events_memory, mut triggers_memory) = ([Event::default(); 64], [Trigger::default(); 8]);
        let mut decoder = AnyDecoder::new(encoding, LARGEST);
        let mut rest = &bytes[..];
        while !rest.is_empty() {
            let mut sink = Sink::with_triggers(&mut events_memory, &mut triggers_memory);
            rest = &rest[decoder.decode(rest, &mut sink)..];
            told.extend_from_slice(sink.triggers());
            events.extend_from_slice(sink.block(LARGEST).span().events);
        }
        assert_eq!((events.len(), told), (triggers.len() + 1, triggers), "{encoding}");
    }
}

#[test]
fn a_trigger_that_the_format_cannot_hold_is_refused() {
    for encoding in Encoding::ALL.iter().copied() {
        let mut encoder = AnyEncoder::new(encoding);
        let channel = channel_max(encoding) + 1;
        let mut refused = |trigger| encoder.trigger(trigger, &mut [0; 64]).refused;
        assert_eq!(refused(Trigger { channel, ..Trigger::default() }), Some(Refused::NoChannel { channel }));
        let t = START_MAX_US + 1;
        assert_eq!(refused(Trigger { t, ..Trigger::default() }), Some(Refused::StartTooLate { t }));
    }
}
