use super::*;
use crate::wire::testing::{Told, decode_in};
use proptest::prelude::*;
use std::{format, string::String, vec, vec::Vec};

const HD: Geometry = Geometry::new(1280, 720);
const FULL: Geometry = Geometry::new(2048, 2048);

/// What every kernel tells of `bytes`.
fn decode(geometry: Geometry, bytes: &[u8]) -> Told {
    let mut all = Kernel::available().map(|kernel| {
        let mut decoder = Decoder::with_kernel(geometry, kernel);
        let mut told = decode_in(&mut decoder, bytes, &[usize::MAX], 4096, 64);
        decoder.finish();
        told.counters = *decoder.counters();
        told
    });
    let told = all.next().unwrap();
    all.for_each(|other| assert_eq!(other, told));
    told
}

fn bytes_of(words: &str) -> Vec<u8> {
    words.split_whitespace().flat_map(|w| u16::from_str_radix(w, 16).unwrap().to_le_bytes()).collect()
}

fn tell(told: &Told) -> String {
    let event = |(t, e): &(u64, Event)| format!("t={t} x={} y={} p={}", e.x(), e.y(), e.is_on() as u8);
    told.events.iter().map(event).collect::<Vec<_>>().join(", ")
}

fn check(words: &str, events: &str) {
    assert_eq!(tell(&decode(HD, &bytes_of(words))), events, "{words}");
}

fn faults(words: &str) -> Vec<(&'static str, u64)> {
    let counters = decode(HD, &bytes_of(words)).counters;
    assert_eq!(counters.bytes_faulty, 2 * counters.faults.total());
    Fault::ALL.into_iter().map(|f| (f.name(), counters.faults.get(f))).filter(|(_, n)| *n > 0).collect()
}

#[test]
fn single_events() {
    check("8000 6001 0000 2000", "t=1 x=0 y=0 p=0");
    check("8001 6002 0007 2805", "t=4098 x=5 y=7 p=1");
    check("8FFF 6FFF 0ACF 2CFF", "t=16777215 x=1279 y=719 p=1"); // bit 11 of ADDR_Y is not the row's
}

#[test]
fn vectors_count_on_from_their_base() {
    check("8000 6001 0002 3810 4801", "t=1 x=16 y=2 p=1, t=1 x=27 y=2 p=1");
    check(
        "8000 0002 3010 4000 4001 5081 4001",
        "t=0 x=28 y=2 p=0, t=0 x=40 y=2 p=0, t=0 x=47 y=2 p=0, t=0 x=48 y=2 p=0",
    );
    check("8000 0002 3010 5F00 5001", "t=0 x=24 y=2 p=0"); // the upper bits of VECT_8 are no events
    check("8000 0002 3000 2005 4001", "t=0 x=5 y=2 p=0, t=0 x=0 y=2 p=0"); // ADDR_X leaves the base
    check("8000 0002 3000 4001 0003 4001", "t=0 x=0 y=2 p=0, t=0 x=12 y=3 p=0"); // so does ADDR_Y
}

#[test]
fn time_high_that_repeats_keeps_the_low_bits() {
    check(
        "8001 6064 0000 2000 8001 2000 6065 2000",
        "t=4196 x=0 y=0 p=0, t=4196 x=0 y=0 p=0, t=4197 x=0 y=0 p=0",
    );
    check("8001 6064 0000 8002 2000", "t=8192 x=0 y=0 p=0");
}

#[test]
fn a_step_back_is_a_wrap_only_beyond_half_the_range() {
    check("8F3C 0000 2000 8032 2000", "t=15974400 x=0 y=0 p=0, t=16982016 x=0 y=0 p=0");
    check("8900 0000 2000 8100 2000", "t=9437184 x=0 y=0 p=0, t=1048576 x=0 y=0 p=0");
    check("8900 0000 2000 80FF 2000", "t=9437184 x=0 y=0 p=0, t=17821696 x=0 y=0 p=0");
    check("8001 6064 0000 2000 6060 2000", "t=4196 x=0 y=0 p=0, t=4192 x=0 y=0 p=0");
}

#[test]
fn nothing_before_time_row_and_base_are_known() {
    check("0000 2000 6001 2000 8000 2000", "t=0 x=0 y=0 p=0");
    assert_eq!(faults("0000 2000 6001 2000 8000 2000"), [("before_time", 2)]);
    assert_eq!(faults("8000 2000 3000 4FFF"), [("before_row", 2)]);
    assert_eq!(faults("8000 0000 4FFF 50FF 2000"), [("before_base", 2)]);
    assert_eq!(faults("A001 3000 4000"), [("before_time", 2)]);
    check("3000 4FFF 8000 0000 4001", "t=0 x=12 y=0 p=0"); // the base moves on where nothing is emitted
}

#[test]
fn words_without_meaning_are_skipped() {
    for kind in ["1", "9", "B", "C", "D"] {
        check(&format!("8000 0001 {kind}123 2002"), "t=0 x=2 y=1 p=0");
        assert_eq!(faults(&format!("8000 0001 {kind}123 2002")), [("unknown_word", 1)]);
    }
    assert_eq!(faults("E123 7123 F123"), []);
}

#[test]
fn events_off_the_sensor_are_counted() {
    let told = decode(HD, &bytes_of("8000 02CF 2500 24FF 02D0 2000 02CF 34FE 400F 4001"));
    assert_eq!(tell(&told), "t=0 x=1279 y=719 p=0, t=0 x=1278 y=719 p=0, t=0 x=1279 y=719 p=0");
    assert_eq!((told.counters.events, told.counters.off_sensor), (8, 5));
}

#[test]
fn triggers_know_their_place() {
    let told = decode(HD, &bytes_of("8000 6007 0000 2000 2500 A801 6009 A600"));
    let trigger = |t, channel, edge| Trigger { t, ordinal: 1, channel, edge };
    assert_eq!(told.triggers, [trigger(7, 8, Polarity::On), trigger(9, 6, Polarity::Off)]);
    assert_eq!(told.counters.triggers, 2);
}

#[test]
fn a_word_cut_short_is_a_fault() {
    let told = decode(HD, &[0x00, 0x80, 0x00]);
    assert_eq!((told.counters.bytes_decoded, told.counters.bytes_faulty), (2, 1));
    assert_eq!(told.counters.faults.get(Fault::CutShort), 1);
}

#[test]
fn after_a_gap_time_row_and_base_must_come_again() {
    let after = |near, words: &str| {
        let mut decoder = Decoder::new(HD);
        decode_in(&mut decoder, &bytes_of("8FF0 6001 0005 3000 2000"), &[3], 64, 1);
        decoder.gap(near);
        tell(&decode_in(&mut decoder, &bytes_of(words), &[usize::MAX], 64, 1))
    };
    assert_eq!(
        after(None, "6002 2001 8FF0 2002 4001 6003 2003 4001 0006 4001 2004"),
        "t=16711683 x=4 y=6 p=0"
    );
    assert_eq!(after(None, "8001 6000 0000 2000"), "t=16781312 x=0 y=0 p=0");
    assert_eq!(after(Some(100 << 24), "8001 6000 0000 2000"), "t=1677725696 x=0 y=0 p=0");
    assert_eq!(
        after(Some(100 << 24), "8FFF 6000 0000 2000 8000 2000"),
        "t=1677717504 x=0 y=0 p=0, t=1677721600 x=0 y=0 p=0"
    );
}

#[test]
fn a_gap_drops_half_a_word() {
    let mut decoder = Decoder::new(HD);
    decode_in(&mut decoder, &[0x00], &[1], 64, 1);
    assert_eq!(decoder.pending(), 1);
    decoder.gap(None);
    assert_eq!((decoder.pending(), decoder.counters().bytes_faulty), (0, 1));
}

#[test]
fn a_block_ends_where_32_bits_of_time_do() {
    let mut words = String::from("8000 6000 0000 2000 ");
    words.push_str(&"8FFF 8000 ".repeat(128));
    words.push_str("2001 6001 2002");
    let mut memory = [Event::default(); 64];
    let mut sink = Sink::new(&mut memory);
    let bytes = bytes_of(&words);
    let mut decoder = Decoder::new(HD);
    assert_eq!(decoder.decode(&bytes, &mut sink), bytes.len() - 6);
    assert_eq!(sink.len(), 1);
    assert_eq!(decode(HD, &bytes).events[2].0, (1 << 31) + 1);
}

#[test]
fn kernels_agree_on_real_recordings() {
    for name in ["evt3_gen41_1280x720.raw", "evt3_trigger_1280x720.raw"] {
        let Some(path) = lobula_tests::data(name) else { continue };
        let file = std::fs::read(path).unwrap();
        let told = decode(HD, lobula_tests::words_of_raw(&file));
        assert!(told.counters.events > 80_000 && told.counters.bytes_faulty == 0);
    }
}

fn encode(events: &[(u64, Event)], out_len: usize) -> Result<Vec<u8>, Refused> {
    let mut encoder = Encoder::new();
    let mut bytes = Vec::new();
    let mut out = vec![0; out_len];
    for (t, event) in events {
        let span = Span { t_first: *t, t_last: *t, geometry: FULL, events: &[*event] };
        loop {
            let encoded = encoder.encode(span, &mut out);
            bytes.extend_from_slice(&out[..encoded.bytes]);
            if let Some(refused) = encoded.refused {
                return Err(refused);
            }
            if encoded.events == 1 {
                break;
            }
            assert!(encoded.bytes > 0, "no progress");
        }
    }
    loop {
        match encoder.finish(&mut out) {
            0 => return Ok(bytes),
            n => bytes.extend_from_slice(&out[..n]),
        }
    }
}

fn event(t: u64, x: u16, y: u16, polarity: Polarity) -> (u64, Event) {
    (t, Event::new(t as u32, x, y, polarity))
}

fn check_encoded(events: &[(u64, Event)], words: &str) {
    let hex = |bytes: &[u8]| -> Vec<String> {
        bytes.as_chunks().0.iter().map(|w| format!("{:04X}", u16::from_le_bytes(*w))).collect()
    };
    assert_eq!(hex(&encode(events, 64).unwrap()).join(" "), words);
    assert_eq!(decode(FULL, &bytes_of(words)).events, events);
}

#[test]
fn few_events_are_single_and_many_a_vector() {
    let on = |x| event(4098, x, 7, Polarity::On);
    check_encoded(&[on(5)], "8001 6002 0007 2805");
    check_encoded(&[on(5), on(6), on(7)], "8001 6002 0007 2805 2806 2807");
    check_encoded(&[on(5), on(6), on(17), on(36)], "8001 6002 0007 3805 4003 4001 5080");
    check_encoded(&[on(7), on(6)], "8001 6002 0007 2807 2806");
    let row: Vec<_> = (100..164).map(on).collect();
    check_encoded(&row, "8001 6002 0007 3864 4FFF 4FFF 50FF 4FFF 4FFF 50FF");
}

#[test]
fn time_is_written_whole() {
    let at = |t| event(t, 0, 0, Polarity::Off);
    check_encoded(&[at(0), at(1), at(0)], "8000 6000 0000 2000 6001 2000 6000 2000");
    check_encoded(&[at(3 << 24)], "8FFF 8000 8FFF 8000 8FFF 8000 6000 0000 2000");
    check_encoded(&[at(0xFFE000), at(0x1001007)], "8FFE 6000 0000 2000 8FFF 8000 8001 6007 2000");
    check_encoded(&[at(0xFFF000), at(0x7FF000)], "8FFF 6000 0000 2000 87FF 6000 2000");
}

#[test]
fn what_the_format_cannot_hold_is_refused() {
    let at = |t| event(t, 0, 0, Polarity::Off);
    let refused = |events: &[_]| encode(events, 64).unwrap_err();
    let t = (1 << 40) + 1;
    assert_eq!(refused(&[at(t)]), Refused::StartTooLate { t });
    assert_eq!(refused(&[at(0xFFF000), at(0x7FEFFF)]), Refused::StepBack { from: 0xFFF000, to: 0x7FEFFF });
    assert_eq!(
        refused(&[at(1 << 24), at((1 << 24) - 1)]),
        Refused::StepBack { from: 1 << 24, to: (1 << 24) - 1 }
    );
    assert_eq!(refused(&[event(0, 2048, 0, Polarity::On)]), Refused::OffFormat { x: 2048, y: 0 });
    assert_eq!(refused(&[event(0, 0, 2048, Polarity::On)]), Refused::OffFormat { x: 0, y: 2048 });
}

#[test]
fn triggers_are_encoded_between_events() {
    let mut encoder = Encoder::new();
    let mut bytes = [0; 64];
    let (t, on) = event(9, 1, 1, Polarity::On);
    let span = Span { t_first: t, t_last: t, geometry: FULL, events: &[on] };
    let mut len = encoder.encode(span, &mut bytes).bytes;
    let trigger = Trigger { t: 11, ordinal: 1, channel: 6, edge: Polarity::On };
    loop {
        let out = &mut bytes[len..len + 1];
        let encoded = encoder.trigger(trigger, out);
        len += encoded.bytes;
        if encoded.events == 1 {
            break;
        }
    }
    len += encoder.encode(span, &mut bytes[len..]).bytes;
    len += encoder.finish(&mut bytes[len..]);
    let told = decode(FULL, &bytes[..len]);
    assert_eq!((told.events.len(), told.triggers), (2, vec![trigger]));
}

/// Streams of every step of time that the format can hold: runs to the right, at once or later, between jumps.
fn any_events() -> impl Strategy<Value = Vec<(u64, Event)>> {
    let dt = prop_oneof![4 => Just(0i64), 6 => 1..50i64, 2 => -20..0i64, 1 => -(1 << 22)..(1i64 << 25), 1 => 0..(1i64 << 34)];
    let jump = (dt, 0..2048u16, 0..2048u16, any::<bool>());
    let run = prop::collection::vec(prop_oneof![9 => 1..4u16, 1 => 0..60u16], 0..60);
    let start =
        prop_oneof![8 => 0..1u64 << 25, 1 => 0..=Encoder::START_MAX_US, 1 => Just(Encoder::START_MAX_US)];
    (start, prop::collection::vec((jump, run), 0..20)).prop_map(|(start, stretches)| {
        let mut t = start;
        let mut events: Vec<(u64, Event)> = Vec::new();
        for ((dt, x, y, on), run) in stretches {
            let next = if events.is_empty() { t } else { t.saturating_add_signed(dt) };
            t = if next < t && next >> 24 != t >> 24 { t } else { next };
            let mut x = x;
            for step in core::iter::once(0).chain(run) {
                x = (x + step) % 2048;
                events.push(event(t, x, y, Polarity::from_bit(on.into())));
            }
        }
        events
    })
}

proptest! {
    #[test]
    fn what_is_encoded_is_decoded(events in any_events(), out_len in 1..40usize, piece in 1..40usize) {
        let bytes = encode(&events, out_len).unwrap();
        prop_assert_eq!(&bytes, &encode(&events, 1 << 16).unwrap());
        for kernel in Kernel::available() {
            let told = decode_in(&mut Decoder::with_kernel(FULL, kernel), &bytes, &[piece], 64, 1);
            prop_assert_eq!(&told.events, &events);
            prop_assert_eq!(told.counters.bytes_decoded, bytes.len() as u64);
            prop_assert_eq!(told.counters.faults.total(), 0);
        }
    }

    #[test]
    fn kernels_and_splits_change_nothing(
        bytes in any_bytes(),
        pieces in prop::collection::vec(prop_oneof![1..50usize, 50..2000usize], 1..8),
        room in prop_oneof![12..200usize, 200..3000usize],
        triggers in 1..4usize,
        geometry in prop::sample::select(vec![HD, HD, FULL, Geometry::new(u16::MAX, u16::MAX), Geometry::new(37, 20)]),
        gap in prop::option::of((any::<prop::sample::Index>(), prop::option::of(0..1u64 << 36))),
    ) {
        let run = |kernel, pieces: &[usize], room, triggers| {
            let mut decoder = Decoder::with_kernel(geometry, kernel);
            let (before, after) = bytes.split_at(gap.map_or(0, |(at, _)| at.index(bytes.len() + 1)));
            let first = decode_in(&mut decoder, before, pieces, room, triggers);
            if let Some((_, near)) = gap {
                decoder.gap(near);
            }
            [first, decode_in(&mut decoder, after, pieces, room, triggers)]
        };
        let plain = run(Kernel::Plain, &[usize::MAX], 1 << 16, 1 << 12);
        for kernel in Kernel::available() {
            prop_assert_eq!(&run(kernel, &[usize::MAX], 1 << 16, 1 << 12), &plain);
            prop_assert_eq!(&run(kernel, &pieces, room, triggers), &plain);
        }
    }
}

/// Words of every kind in any order, and stretches as cameras make them.
fn any_bytes() -> impl Strategy<Value = Vec<u8>> {
    let kind = prop_oneof![
        8 => prop::sample::select(vec![ADDR_Y, ADDR_X, VECT_BASE_X, VECT_12, VECT_8, TIME_LOW]),
        1 => Just(TIME_HIGH),
        1 => 0..16u16,
    ];
    let payload = prop_oneof![3 => 0..0x1000u16, 1 => 0..8u16];
    let any_word = (kind, payload).prop_map(|(kind, payload)| vec![word(kind, payload)]);
    let vectors = (VECT_12..=VECT_8, 0..8000usize).prop_map(|(kind, n)| vec![word(kind, 0); n]); // far off
    let some_word = prop_oneof![200 => any_word, 200 => likely_words(), 1 => vectors];
    let stretch = prop::collection::vec(some_word, 0..400);
    let likely = prop::collection::vec(likely_words(), 0..400);
    let start = prop::sample::select(vec![vec![], vec![0x8001, 0x0000], vec![0x8FFF, 0x0000, 0x3000]]);
    (start, prop_oneof![stretch, likely]).prop_map(|(start, words)| {
        core::iter::once(start).chain(words).flatten().flat_map(u16::to_le_bytes).collect()
    })
}

/// Words on the sensor, with vectors of few events or many.
fn likely_words() -> impl Strategy<Value = Vec<u16>> {
    let mask = || prop_oneof![Just(0u16), (0..12u32).prop_map(|i| 1 << i), 0..0x1000u16, Just(PAYLOAD)];
    let x = (0..1280u16, any::<bool>()).prop_map(|(x, on)| u16::from(on) << POLARITY_SHIFT | x);
    let vector = (x.clone(), mask(), mask(), mask()).prop_map(|(x, a, b, c)| {
        vec![word(VECT_BASE_X, x), word(VECT_12, a), word(VECT_12, b), word(VECT_8, c)]
    });
    let lone_vector = (VECT_12..=VECT_8, mask()).prop_map(|(kind, mask)| vec![word(kind, mask)]);
    prop_oneof![
        20 => x.prop_map(|x| vec![word(ADDR_X, x)]),
        8 => (0..720u16, any::<bool>()).prop_map(|(y, bit)| vec![word(ADDR_Y, u16::from(bit) << 11 | y)]),
        3 => (0..0x1000u16).prop_map(|low| vec![word(TIME_LOW, low)]),
        2 => vector,
        1 => lone_vector,
        1 => prop::sample::select(vec![word(OTHERS, 1), word(CONTINUED_4, 2), word(CONTINUED_12, 3), 0x8001, 0x8002])
            .prop_map(|word| vec![word]),
    ]
}
