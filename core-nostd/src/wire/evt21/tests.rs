use super::*;
use crate::Polarity;
use crate::wire::oracle::{self, any_geometry, any_splits, any_words};
use crate::wire::testing::{decode_in, decode_words, tell};
use proptest::prelude::*;

const GEOMETRY: Geometry = Geometry::new(1280, 720);

/// The same words in both orders.
fn bytes_of(words: &str, order: WordOrder) -> Vec<u8> {
    let halves = |word: &str| {
        let (head, mask) = word.split_once(':').unwrap();
        let half = |hex: &str| u32::from_str_radix(hex, 16).unwrap().to_le_bytes();
        match order {
            WordOrder::Little => [half(mask), half(head)],
            WordOrder::Legacy => [half(head), half(mask)],
        }
    };
    words.split_whitespace().flat_map(halves).flatten().collect()
}

#[track_caller]
fn check(words: &str, told: &str) {
    for order in [WordOrder::Little, WordOrder::Legacy] {
        assert_eq!(tell(Decoder::new(GEOMETRY, order), &bytes_of(words, order)), told, "{order:?} {words}");
    }
}

#[test]
fn the_orders_are_those_of_the_specification() {
    // Its example: how two sensors send 0x0102030405060708.
    let word = Word { head: 0x0102_0304, mask: 0x0506_0708 };
    assert_eq!(word.to_bytes(WordOrder::Little), [8, 7, 6, 5, 4, 3, 2, 1]);
    assert_eq!(word.to_bytes(WordOrder::Legacy), [4, 3, 2, 1, 8, 7, 6, 5]);
    for order in [WordOrder::Little, WordOrder::Legacy] {
        assert_eq!(Word::from_bytes(word.to_bytes(order), order), word);
    }
}

#[test]
fn events_and_triggers() {
    check("80000001:0 10000000:1", "t=64 x=0 y=0 p=1");
    check("80000001:0 0fc10001:80000001", "t=127 x=32 y=1 p=0, t=127 x=63 y=1 p=0");
    check("80000001:0 10000000:0", "");
    check("80000002:0 a5400301:0", "trigger t=149 after=0 channel=3 p=1");
    check(
        "80000002:0 10000000:6 a0000000:0",
        "t=128 x=1 y=0 p=1, t=128 x=2 y=0 p=1, trigger t=128 after=2 channel=0 p=0",
    );
}

#[test]
fn events_off_the_sensor_are_counted_and_dropped() {
    // x = 1264, which is no multiple of 32: half of the vector is on the sensor.
    check("80000000:0 10278000:18000", "off sensor 1, t=0 x=1279 y=0 p=1");
    check("80000000:0 102802cf:3", "off sensor 2");
    check("80000000:0 100002d0:ffffffff", "off sensor 32");
    check("80000000:0 103ff800:80000000", "off sensor 1");
}

#[test]
fn what_cannot_be_placed_or_known_is_counted() {
    check("10000000:1 a0000000:0 80000000:0 10000000:1", "before_time 2, t=0 x=0 y=0 p=1");
    check("80000000:0 20000000:1 c0000000:1 e0000000:1 f0000000:1", "unknown_word 2");
}

#[test]
fn after_a_gap_time_must_come_again() {
    let order = WordOrder::Little;
    let mut decoder = Decoder::new(GEOMETRY, order);
    decode_words(&mut decoder, &bytes_of("80000001:0 10000000:1", order));
    decode_words(&mut decoder, &[1, 2, 3, 4, 5, 6, 7]);
    decoder.gap(Some(1 << 40));
    assert_eq!((decoder.pending(), decoder.counters().bytes_faulty), (0, 7));
    let events = decode_words(&mut decoder, &bytes_of("10000000:1 80000001:0 10000000:1", order));
    assert_eq!(events.iter().map(|(t, _)| *t).collect::<Vec<_>>(), [(1 << 40) + 64]);
}

#[test]
fn a_sink_with_less_room_than_a_vector_stops_before_it() {
    let bytes = bytes_of("80000000:0 10000000:1", WordOrder::Little);
    let mut decoder = Decoder::new(GEOMETRY, WordOrder::Little);
    let mut memory = [Event::default(); VECTOR_LEN - 1];
    assert_eq!(decoder.decode(&bytes, &mut Sink::new(&mut memory)), 0);
    let mut memory = [Event::default(); VECTOR_LEN];
    assert_eq!(decoder.decode(&bytes, &mut Sink::new(&mut memory)), 16);
}

#[test]
fn events_share_a_word_only_to_the_right() {
    let events = [(5, 1), (5, 2), (5, 31), (5, 32), (5, 30), (6, 31), (6, 31)];
    let events = events.map(|(t, x)| Event::new(t, x, 7, Polarity::On));
    let span = Span { t_first: 5, t_last: 6, geometry: GEOMETRY, events: &events };
    let mut bytes = [0; 100];
    let mut encoder = Encoder::new(WordOrder::Legacy);
    let done = encoder.encode(span, &mut bytes);
    let len = done.bytes + encoder.finish(&mut bytes[done.bytes..]);
    let words =
        "80000000:0 11400007:80000006 11410007:1 11400007:40000000 11800007:80000000 11800007:80000000";
    assert_eq!(bytes[..len], bytes_of(words, WordOrder::Legacy));
}

proptest! {
    #[test]
    fn every_kernel_tells_what_the_specification_says(
        words in any_words(),
        geometry in any_geometry(),
        (pieces, room, triggers) in any_splits(),
    ) {
        let expected = oracle::tell(&words, WORD_BYTES as u64, geometry);
        for order in [WordOrder::Little, WordOrder::Legacy] {
            let in_order = |word: &oracle::Word| match order {
                WordOrder::Little => [word.mask, word.head],
                WordOrder::Legacy => [word.head, word.mask],
            };
            let bytes: Vec<u8> = words.iter().flat_map(in_order).flat_map(u32::to_le_bytes).collect();
            for kernel in Kernel::available() {
                for (pieces, room, triggers) in [(&[usize::MAX][..], 1 << 14, 1 << 12), (&pieces, room, triggers)] {
                    let mut decoder = Decoder::with_kernel(geometry, order, kernel);
                    let told = decode_in(&mut decoder, &bytes, pieces, room, triggers);
                    prop_assert_eq!(&told, &expected, "{:?} {:?}", kernel, order);
                }
            }
        }
    }
}
