//! The link: against frames made and read by other people's code, in any split, through garbage and losses.

use crate::chunk_invariance::Splits;
use lobula_core::link::{Fault, Ledger, Message, bulk, serial};
use lobula_core::wire::Encoding;
use proptest::prelude::*;

/// A message with its bytes, since it borrows.
#[derive(Clone, Debug, PartialEq)]
enum Owned {
    Ping(u32),
    Words(u64, Vec<u8>),
    Hello(u16, String),
    Losses(u32, u32),
}

impl Owned {
    fn borrow(&self) -> Message<'_> {
        match self {
            Self::Ping(token) => Message::Ping { token: *token },
            Self::Words(t_base, bytes) => Message::Words { t_base: *t_base, bytes },
            Self::Hello(width, name) => {
                Message::Hello { protocol: Message::PROTOCOL, width: *width, height: 7, encoding: 3, name }
            }
            Self::Losses(packets, bytes) => {
                Message::Losses { packets: *packets, bytes: *bytes, faults: 0, off_sensor: 9 }
            }
        }
    }
}

fn bytes() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        proptest::collection::vec(any::<u8>(), 0..600),
        proptest::collection::vec(prop_oneof![Just(0), Just(0xFF), Just(0x4C), Just(0xB5)], 0..40),
        (0usize..600).prop_map(|len| vec![1; len]),
    ]
}

fn messages() -> impl Strategy<Value = Vec<Owned>> {
    let message = prop_oneof![
        any::<u32>().prop_map(Owned::Ping),
        (any::<u64>(), bytes()).prop_map(|(t_base, bytes)| Owned::Words(t_base, bytes)),
        (any::<u16>(), "[a-z]{0,9}").prop_map(|(width, name)| Owned::Hello(width, name)),
        any::<(u32, u32)>().prop_map(|(packets, bytes)| Owned::Losses(packets, bytes)),
    ];
    proptest::collection::vec(message, 0..20)
}

/// A frame by others' code: postcard, crc32fast, cobs.
fn frame_of_others(sequence: u16, message: &Message<'_>) -> Vec<u8> {
    let mut memory = [0; 2000];
    let message = postcard::to_slice(message, &mut memory).unwrap();
    let content = [&sequence.to_le_bytes()[..], message].concat();
    let crc = crc32fast::hash(&content).to_le_bytes();
    [cobs::encode_vec(&[&content[..], &crc].concat()), vec![0]].concat()
}

/// Every frame of a stream whose checksum is right, by others' code: cut at zeros.
fn read_by_others(stream: &[u8]) -> Vec<(u16, String)> {
    let frames = stream.split_inclusive(|byte| *byte == 0).filter(|frame| frame.ends_with(&[0]));
    let frame = |stuffed: &[u8]| {
        let content = cobs::decode_vec(&stuffed[..stuffed.len() - 1]).ok()?;
        let (content, crc) = content.split_last_chunk::<4>()?;
        let (sequence, message) = content.split_first_chunk::<2>()?;
        let message: Message<'_> = postcard::from_bytes(message).ok()?;
        (crc32fast::hash(content) == u32::from_le_bytes(*crc))
            .then(|| (u16::from_le_bytes(*sequence), format!("{message:?}")))
    };
    frames.filter_map(frame).collect()
}

fn encode(messages: &[Owned]) -> Vec<Vec<u8>> {
    let mut encoder = serial::Encoder::new();
    let mut out = [0; 2000];
    let frame = |message: &Owned| {
        let len = encoder.encode(&message.borrow(), &mut out).unwrap();
        out[..len].to_vec()
    };
    messages.iter().map(frame).collect()
}

/// What a receiver with this much memory sees.
fn receive(stream: &[u8], memory: usize, splits: &mut Splits) -> (Vec<(String, u16)>, Ledger) {
    let mut decoder = serial::Decoder::new(vec![0; memory]);
    let mut found = vec![];
    let mut rest = stream;
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(splits.next(rest.len()));
        decoder.decode(piece, |frame| found.push((format!("{:?}", frame.message), frame.lost_before)));
        rest = after;
    }
    (found, *decoder.ledger())
}

/// Changes bytes, takes some out, puts some in.
fn damage(mut stream: Vec<u8>, changes: &[(u16, u8, u8)]) -> Vec<u8> {
    for (at, byte, what) in changes {
        let at = usize::from(*at) % stream.len().max(1);
        match what % 3 {
            0 => stream.insert(at.min(stream.len()), *byte),
            _ if stream.is_empty() => {}
            1 => stream[at] = *byte,
            _ => drop(stream.remove(at)),
        }
    }
    stream
}

fn changes() -> impl Strategy<Value = Vec<(u16, u8, u8)>> {
    proptest::collection::vec(any::<(u16, u8, u8)>(), 0..12)
}

/// Frames of words, with what their headers say.
fn stretches() -> impl Strategy<Value = Vec<(u32, u8, Vec<u8>)>> {
    proptest::collection::vec((any::<u32>(), 0u8..3, bytes()), 0..12)
}

fn encode_bulk(stretches: &[(u32, u8, Vec<u8>)]) -> Vec<Vec<u8>> {
    let mut encoder = bulk::Encoder::new();
    let mut out = [0; 2000];
    let frame = |(t_base, overruns, words): &(u32, u8, Vec<u8>)| {
        let header = bulk::Header { t_base: *t_base, encoding: 3, overruns: *overruns };
        let len = encoder.encode(header, words, &mut out).unwrap();
        out[..len].to_vec()
    };
    stretches.iter().map(frame).collect()
}

type Stretch = (u32, u8, u16, Vec<u8>);

fn receive_bulk(stream: &[u8], memory: usize, splits: &mut Splits) -> (Vec<Stretch>, Ledger, u64, usize) {
    let mut decoder = bulk::Decoder::new(vec![0; memory]);
    let mut found = vec![];
    let mut rest = stream;
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(splits.next(rest.len()));
        decoder.decode(piece, |frame| {
            let bulk::Header { t_base, overruns, .. } = frame.header;
            found.push((t_base, overruns, frame.lost_before, frame.words.to_vec()));
        });
        rest = after;
    }
    (found, *decoder.ledger(), decoder.skipped_bytes(), decoder.pending())
}

/// Frames by their definition, from the whole stream: at each place one is, or is not.
fn read_bulk(stream: &[u8], memory: usize) -> Vec<Vec<u8>> {
    let (mut at, mut found) = (0, vec![]);
    while at + 16 <= stream.len() {
        let len = 16 + usize::from(u16::from_le_bytes([stream[at + 8], stream[at + 9]]));
        let is_frame = stream[at..].starts_with(&[0x4C, 0xB5]) && len <= memory;
        if is_frame && at + len > stream.len() {
            break; // may become one yet: nothing behind it is looked at
        }
        let crc = |frame: &[u8]| crc32fast::hash(&[&frame[..12], &frame[16..]].concat()).to_le_bytes();
        if is_frame && crc(&stream[at..at + len]) == stream[at + 12..at + 16] {
            found.push(stream[at + 16..at + len].to_vec());
            at += len;
        } else {
            at += 1;
        }
    }
    found
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn frames_are_those_of_other_code(messages in messages()) {
        for (sequence, (frame, message)) in encode(&messages).iter().zip(&messages).enumerate() {
            prop_assert_eq!(frame, &frame_of_others(sequence as u16, &message.borrow()));
        }
    }

    #[test]
    fn what_arrives_is_what_was_sent_less_what_was_lost(
        messages in messages(),
        lost in proptest::collection::vec(any::<bool>(), 20),
    ) {
        let frames = encode(&messages);
        let sent: Vec<_> = frames.iter().zip(&messages).zip(&lost).filter(|(_, lost)| !**lost).collect();
        let stream: Vec<u8> = sent.iter().flat_map(|((frame, _), _)| frame.iter().copied()).collect();
        let (found, ledger) = receive(&stream, 2000, &mut Splits::Random(3));
        let expected: Vec<String> = sent.iter().map(|((_, message), _)| format!("{:?}", message.borrow())).collect();
        prop_assert_eq!(found.iter().map(|(message, _)| message.clone()).collect::<Vec<_>>(), expected);
        // Between the first and the last that came.
        let came = |message: &usize| !lost[*message];
        let (first, last) = ((0..frames.len()).find(came), (0..frames.len()).rfind(came));
        let between = first.zip(last).map_or(0, |(first, last)| (first..last).filter(|i| lost[*i]).count());
        prop_assert_eq!(ledger.lost, between as u64);
        prop_assert_eq!(found.iter().map(|(_, lost)| u64::from(*lost)).sum::<u64>(), between as u64);
        prop_assert_eq!(ledger.frames, found.len() as u64);
    }

    #[test]
    fn damaged_streams_read_as_by_other_code(messages in messages(), changes in changes()) {
        let stream = damage(encode(&messages).concat(), &changes);
        let (found, ledger) = receive(&stream, 2000, &mut Splits::Whole);
        let expected = read_by_others(&stream);
        prop_assert_eq!(found.len() as u64, ledger.frames);
        let found: Vec<String> = found.into_iter().map(|(message, _)| message).collect();
        prop_assert_eq!(found, expected.into_iter().map(|(_, message)| message).collect::<Vec<_>>());
    }

    #[test]
    fn damaged_bulk_streams_read_as_by_definition(stretches in stretches(), changes in changes()) {
        let stream = damage(encode_bulk(&stretches).concat(), &changes);
        let (found, ledger, skipped, pending) = receive_bulk(&stream, 1000, &mut Splits::Random(9));
        let in_frames: usize = found.iter().map(|(_, _, _, words)| 16 + words.len()).sum();
        let expected = read_bulk(&stream, 1000);
        prop_assert_eq!(found.iter().map(|(_, _, _, words)| words.clone()).collect::<Vec<_>>(), expected);
        prop_assert_eq!(ledger.frames, found.len() as u64);
        // Every byte is in one count.
        prop_assert_eq!(in_frames + skipped as usize + pending, stream.len());
    }

    /// Bytes of no meaning, into memory of any size.
    #[test]
    fn noise_is_survived(stream in bytes(), memory in 0usize..40) {
        receive(&stream, memory, &mut Splits::Random(5));
        let (_, _, skipped, pending) = receive_bulk(&stream, memory, &mut Splits::Random(5));
        prop_assert!(skipped as usize + pending <= stream.len());
    }
}

chunk_invariance!(custom serial_in_any_split, (messages(), changes()), |(messages, changes): &(Vec<Owned>, Vec<_>), splits: &mut Splits| {
    receive(&damage(encode(messages).concat(), changes), 300, splits)
});
chunk_invariance!(custom bulk_in_any_split, (stretches(), changes()), |(stretches, changes): &(Vec<_>, Vec<_>), splits: &mut Splits| {
    receive_bulk(&damage(encode_bulk(stretches).concat(), changes), 300, splits)
});

/// Each fault by its name.
#[test]
fn tells_what_was_wrong() {
    let frames = encode(&[Owned::Ping(1), Owned::Words(2, vec![7; 100]), Owned::Ping(3)]);
    let faults = |stream: &[u8], memory: usize| {
        let (_, ledger) = receive(stream, memory, &mut Splits::Whole);
        Fault::ALL.map(|fault| ledger.faults(fault))
    };
    assert_eq!(faults(&frames.concat(), 200), [0, 0, 0, 0]);
    assert_eq!(faults(&[&[0, 0, 0][..], &frames.concat(), &[0]].concat(), 200), [0, 0, 0, 0]);
    assert_eq!(faults(&frames.concat(), 100), [0, 1, 0, 0]);
    let cut = [&frames[1][..50], &[0], &frames[2]].concat();
    assert_eq!(faults(&cut, 200), [1, 0, 0, 0]);
    let mut flipped = frames.concat();
    flipped[4] ^= 2;
    assert_eq!(faults(&flipped, 200), [0, 0, 1, 0]);
    let content = [0, 0, 250]; // sequence 0, a variant of tomorrow
    let crc = crc32fast::hash(&content).to_le_bytes();
    let unknown = [cobs::encode_vec(&[&content[..], &crc].concat()), vec![0]].concat();
    assert_eq!(faults(&unknown, 200), [0, 0, 0, 1]);
}

#[test]
fn overruns_of_the_sender_are_added_up() {
    let stream = encode_bulk(&[(1, 0, vec![1]), (2, 3, vec![]), (3, 255, vec![4, 5])]).concat();
    let (found, ledger, skipped, pending) = receive_bulk(&stream, 64, &mut Splits::Ones);
    assert_eq!((found.len(), ledger.overruns, ledger.starts, skipped, pending), (3, 258, 1, 0, 0));
}

#[test]
fn what_does_not_fit_is_refused_and_not_counted_as_sent() {
    let mut encoder = serial::Encoder::new();
    let mut out = [0; 64];
    let long = Message::Words { t_base: 0, bytes: &[1; 100] };
    assert_eq!(encoder.encode(&long, &mut out), Err(serial::TooLong { room: 64 }));
    let len = encoder.encode(&Message::Start, &mut out).unwrap();
    assert_eq!(out[..len], frame_of_others(0, &Message::Start));

    let mut encoder = bulk::Encoder::new();
    let header = bulk::Header { t_base: 0, encoding: 2, overruns: 0 };
    assert_eq!(encoder.encode(header, &[1; 49], &mut out), Err(bulk::TooLong { len: 65, room: 64 }));
    assert!(encoder.header(header, &vec![0; bulk::WORDS_BYTES_MAX + 1]).is_none());
    assert_eq!(encoder.header(header, &[]).unwrap()[2..4], [0, 0]);
}

/// The layout, spelt out.
#[test]
fn a_bulk_header_is_sixteen_bytes() {
    let mut out = [0; 20];
    let header = bulk::Header { t_base: 0x0403_0201, encoding: 3, overruns: 5 };
    assert_eq!(bulk::Encoder::new().encode(header, &[9, 8, 7, 6], &mut out), Ok(20));
    let told = [0x4C, 0xB5, 0, 0, 1, 2, 3, 4, 4, 0, 3, 5];
    let crc = crc32fast::hash(&[&told[..], &[9, 8, 7, 6]].concat()).to_le_bytes();
    assert_eq!(out[..], [&told[..], &crc, &[9, 8, 7, 6]].concat());
}

#[test]
fn every_format_has_a_number() {
    for encoding in Encoding::ALL {
        assert_eq!(bulk::encoding(bulk::number(*encoding)), Some(*encoding));
    }
    assert_eq!(bulk::encoding(0), None);
}
