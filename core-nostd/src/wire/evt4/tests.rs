use super::*;
use crate::Polarity;
use crate::wire::oracle::{self, any_geometry, any_splits, any_words};
use crate::wire::testing::{decode_in, decode_words, tell};
use proptest::prelude::*;

const GEOMETRY: Geometry = Geometry::new(1280, 720);

fn bytes_of(words: &str) -> Vec<u8> {
    let word = |hex: &str| u32::from_str_radix(hex, 16).unwrap().to_le_bytes();
    words.split_whitespace().flat_map(word).collect()
}

#[track_caller]
fn check(words: &str, told: &str) {
    assert_eq!(tell(Decoder::new(GEOMETRY), &bytes_of(words)), told, "{words}");
}

#[test]
fn events_and_triggers() {
    check("e0000001 b0000000", "t=64 x=0 y=0 p=1");
    check("e0000001 afd00001", "t=127 x=512 y=1 p=0");
    check("e0000001 cfd00801 80000001", "t=127 x=513 y=1 p=0, t=127 x=544 y=1 p=0");
    check("e0000001 d0000000 0", "");
    // The count of a trigger, 0x7f here, is no part of its channel.
    check("e0000002 954003ff", "trigger t=149 after=0 channel=3 p=1");
    check("e0000002 b0000000 90000000", "t=128 x=0 y=0 p=1, trigger t=128 after=1 channel=0 p=0");
}

#[test]
fn masks_are_no_words() {
    check(
        "e0000000 d0000000 e0000001 b0000000",
        "t=0 x=0 y=0 p=1, t=0 x=29 y=0 p=1, t=0 x=30 y=0 p=1, t=0 x=31 y=0 p=1, t=0 x=0 y=0 p=1",
    );
    check(
        "e0000000 d0000000 ffffffff ffffffff",
        &(0..32).map(|x| format!("t=0 x={x} y=0 p=1")).collect::<Vec<_>>().join(", "),
    );
}

#[test]
fn events_off_the_sensor_are_counted_and_dropped() {
    check("e0000000 d027f800 3", "off sensor 1, t=0 x=1279 y=0 p=1");
    check("e0000000 b02802cf", "off sensor 1");
    check("e0000000 d00002d0 ffffffff", "off sensor 32");
    check("e0000000 d03ff800 80000000", "off sensor 1");
}

#[test]
fn what_cannot_be_placed_or_known_is_counted() {
    check("b0000000 d0000000 e0000001 90000000 e0000000 b0000000", "before_time 3, t=0 x=0 y=0 p=1");
    check("e0000000 00000001 10000001 80000001 f0000000 ffffffff 60000014 70000001", "unknown_word 4");
}

#[test]
fn a_vector_may_be_cut_anywhere() {
    let bytes = bytes_of("e0000001 d0000000 5 b0000001");
    let expected = decode_words(&mut Decoder::new(GEOMETRY), &bytes);
    assert_eq!(expected.len(), 3);
    for at in 0..bytes.len() {
        let mut decoder = Decoder::new(GEOMETRY);
        let mut events = decode_words(&mut decoder, &bytes[..at]);
        let counters = decoder.counters();
        assert_eq!(counters.bytes_decoded as usize + decoder.pending(), at);
        events.extend(decode_words(&mut decoder, &bytes[at..]));
        assert_eq!(events, expected, "{at}");
        let mut cut = Decoder::new(GEOMETRY);
        decode_words(&mut cut, &bytes[..at]);
        cut.finish();
        let (counters, is_cut) = (cut.counters(), at % 4 > 0 || at == 8);
        assert_eq!(counters.bytes_decoded + counters.bytes_faulty, at as u64);
        assert_eq!(counters.faults.get(Fault::CutShort), u64::from(is_cut), "{at}");
    }
}

#[test]
fn after_a_gap_time_must_come_again() {
    let mut decoder = Decoder::new(GEOMETRY);
    decode_words(&mut decoder, &bytes_of("e0000001 b0000000 d0000000"));
    decode_words(&mut decoder, &[1, 2, 3]);
    decoder.gap(Some(1 << 40));
    assert_eq!((decoder.pending(), decoder.counters().bytes_faulty), (0, 7));
    let events = decode_words(&mut decoder, &bytes_of("b0000000 e0000001 b0000000"));
    assert_eq!(events.iter().map(|(t, _)| *t).collect::<Vec<_>>(), [(1 << 40) + 64]);
}

#[test]
fn events_make_a_vector_only_to_the_right() {
    let events = [(5, 1), (5, 2), (5, 32), (5, 33), (5, 30), (6, 31), (6, 31)];
    let events = events.map(|(t, x)| Event::new(t, x, 7, Polarity::On));
    let span = Span { t_first: 5, t_last: 6, geometry: GEOMETRY, events: &events };
    let mut bytes = [0; 100];
    let mut encoder = Encoder::new();
    let done = encoder.encode(span, &mut bytes);
    let len = done.bytes + encoder.finish(&mut bytes[done.bytes..]);
    let words = "e0000000 d1400807 80000003 b1410807 b140f007 b180f807 b180f807";
    assert_eq!(bytes[..len], bytes_of(words));
}

/// The words of EVT 4.0 that say what one of the oracle's says.
fn words_of(word: &oracle::Word) -> Vec<u32> {
    const UNKNOWN: [u32; 4] = [0x0, 0x5, 0x8, 0x1];
    let below = word.head & BELOW_KIND;
    let of = |kind: u32| kind << 28 | below;
    match (kind(word.head), word.mask) {
        (p @ 0..=1, 1) => vec![of(CD_OFF | p)],
        (p @ 0..=1, mask) => vec![of(CD_VEC_OFF | p), mask],
        (0x8, _) => vec![of(TIME_HIGH)],
        (0xA, _) => vec![of(EXT_TRIGGER)],
        (0xE, _) => vec![of(OTHER)],
        (0xF, mask) if mask % 2 == 0 => vec![PADDING],
        (0xF, _) => vec![of(CONTINUED)],
        (other, _) => vec![of(UNKNOWN[other as usize % UNKNOWN.len()])],
    }
}

proptest! {
    #[test]
    fn tells_what_the_words_say(
        words in any_words(),
        geometry in any_geometry(),
        (pieces, room, triggers) in any_splits(),
    ) {
        let mut expected = oracle::tell(&words, WORD_BYTES as u64, geometry);
        let bytes: Vec<u8> = words.iter().flat_map(words_of).flat_map(u32::to_le_bytes).collect();
        for (pieces, room, triggers) in [(&[usize::MAX][..], 1 << 14, 1 << 12), (&pieces, room, triggers)] {
            let told = decode_in(&mut Decoder::new(geometry), &bytes, pieces, room, triggers);
            prop_assert_eq!(told.counters.bytes_decoded + told.counters.bytes_faulty, bytes.len() as u64);
            // A vector is two words here.
            expected.counters.bytes_decoded = told.counters.bytes_decoded;
            expected.counters.bytes_faulty = told.counters.bytes_faulty;
            prop_assert_eq!(&told, &expected);
        }
    }
}
