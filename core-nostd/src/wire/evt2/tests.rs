use super::*;
use crate::wire::oracle::{self, any_geometry, any_splits, any_words};
use crate::wire::testing::{decode_in, decode_words, tell};
use proptest::prelude::*;

const GEOMETRY: Geometry = Geometry::new(640, 480);

fn bytes_of(words: &str) -> Vec<u8> {
    words.split_whitespace().flat_map(|word| u32::from_str_radix(word, 16).unwrap().to_le_bytes()).collect()
}

#[track_caller]
fn check(words: &str, told: &str) {
    assert_eq!(tell(Decoder::new(GEOMETRY), &bytes_of(words)), told, "{words}");
}

#[test]
fn events_and_triggers() {
    check("80000001 10000000", "t=64 x=0 y=0 p=1");
    check("80000001 0fc00801", "t=127 x=1 y=1 p=0");
    check("80000001 113ff9df 0003f9de", "off sensor 1, t=64 x=127 y=478 p=0");
    check("80000002 a5400301", "trigger t=149 after=0 channel=3 p=1");
    check("80000002 10000000 a0001f00", "t=128 x=0 y=0 p=1, trigger t=128 after=1 channel=31 p=0");
}

#[test]
fn time_wraps_only_beyond_half_the_range() {
    check("8fffffff 10000000", "t=17179869120 x=0 y=0 p=1");
    check("8fffffff 87ffffff 10000000", "t=8589934528 x=0 y=0 p=1");
    check("8fffffff 87fffffe 10000000", "t=25769803648 x=0 y=0 p=1");
    check("80000005 10000000 80000004 10400000", "t=320 x=0 y=0 p=1, t=257 x=0 y=0 p=1");
}

#[test]
fn what_cannot_be_placed_or_known_is_counted() {
    check("10000000 a0000000 80000000 10000000", "before_time 2, t=0 x=0 y=0 p=1");
    check("80000000 20000000 d0000000 e0000000 f0000000", "unknown_word 2");
    let mut bytes = bytes_of("80000000 10000000");
    bytes.truncate(7);
    assert_eq!(tell(Decoder::new(GEOMETRY), &bytes), "cut_short 1");
}

#[test]
fn after_a_gap_time_must_come_again() {
    let mut decoder = Decoder::new(GEOMETRY);
    decode_words(&mut decoder, &bytes_of("80000001 10000000"));
    assert_eq!(decoder.now(), 64);
    decode_words(&mut decoder, &[1, 2, 3]);
    assert_eq!(decoder.pending(), 3);
    decoder.gap(Some((3 << 34) - 5));
    assert_eq!((decoder.pending(), decoder.counters().faults.get(Fault::CutShort)), (0, 1));
    assert_eq!(decode_words(&mut decoder, &bytes_of("10000000")), []);
    assert_eq!(decoder.counters().faults.get(Fault::BeforeTime), 1);
    // The hint says how often 34 bits wrapped; the reading lies just beyond the wrap that the hint lies before.
    let events = decode_words(&mut decoder, &bytes_of("80000002 10000000"));
    assert_eq!(events.iter().map(|(t, _)| *t).collect::<Vec<_>>(), [(3 << 34) + 128]);
    decoder.gap(None);
    let events = decode_words(&mut decoder, &bytes_of("10000000 80000003 10000000"));
    assert_eq!(events.iter().map(|(t, _)| *t).collect::<Vec<_>>(), [(3 << 34) + 192]);
}

proptest! {
    #[test]
    fn every_kernel_tells_what_the_specification_says(
        words in any_words(),
        geometry in any_geometry(),
        (pieces, room, triggers) in any_splits(),
    ) {
        let words: Vec<_> = words.into_iter().map(|word| oracle::Word { mask: 1, ..word }).collect();
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.head.to_le_bytes()).collect();
        let expected = oracle::tell(&words, WORD_BYTES as u64, geometry);
        for kernel in Kernel::available() {
            for (pieces, room, triggers) in [(&[usize::MAX][..], 1 << 14, 1 << 12), (&pieces, room, triggers)] {
                let mut decoder = Decoder::with_kernel(geometry, kernel);
                let told = decode_in(&mut decoder, &bytes, pieces, room, triggers);
                prop_assert_eq!(&told, &expected, "{:?}", kernel);
            }
        }
    }
}
