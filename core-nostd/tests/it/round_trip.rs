//! Events through the encoder and the decoder of every format: the same events, or a refusal, and nothing between.

use crate::chunk_invariance::{Splits, decode, encode, encode_whole};
use crate::streams::{self, START_MAX_US, Timed};
use lobula_core::wire::{AnyDecoder, AnyEncoder, Encoding};
use lobula_core::{Geometry, Polarity, Refused};
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
        Encoding::Evt2 | Encoding::Evt21(_) => (34, 6),
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
        let word = match encoding {
            Encoding::Evt2 => 4,
            Encoding::Evt21(_) => 8,
            Encoding::Evt3 => 2,
        };
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
