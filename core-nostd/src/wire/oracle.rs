//! EVT 2.0 and 2.1 read field by field from the specification, with nothing of the decoders', to test them against.

use super::testing::Told;
use crate::{Event, Fault, Geometry, Polarity, Trigger};
use proptest::prelude::*;

/// A word of either format: EVT 2.0 as the upper half, with the mask of its one event.
#[derive(Clone, Copy, Debug)]
pub(super) struct Word {
    pub head: u32,
    pub mask: u32,
}

/// What a decoder must tell of whole words of `word_bytes` bytes.
pub(super) fn tell(words: &[Word], word_bytes: u64, geometry: Geometry) -> Told {
    let mut told = Told::default();
    let mut high: Option<u64> = None; // time / 64, unwrapped
    for Word { head, mask } in words {
        let bits = |from: u32, n: u32| u64::from(head >> from) % (1 << n);
        let t = high.map(|high| high * 64 + bits(22, 6));
        let fault = match (bits(28, 4), t) {
            (0x0 | 0x1 | 0xA, None) => Some(Fault::BeforeTime),
            (polarity @ (0x0 | 0x1), Some(t)) => {
                for bit in (0..32).filter(|bit| mask >> bit & 1 == 1) {
                    let (x, y) = (bits(11, 11) as u16 + bit, bits(0, 11) as u16);
                    told.counters.events += 1;
                    if x < geometry.width && y < geometry.height {
                        told.events
                            .push((t, Event::new(t as u32, x, y, Polarity::from_bit(polarity as u16))));
                    } else {
                        told.counters.off_sensor += 1;
                    }
                }
                told.now = t;
                None
            }
            (0x8, _) => {
                let before = high.unwrap_or(0);
                let (wraps, low) = (before >> 28, before % (1 << 28));
                let back = low.saturating_sub(bits(0, 28));
                let wraps = if back > 1 << 27 { wraps + 1 } else { wraps };
                let next = wraps * (1 << 28) + bits(0, 28);
                if told.now / 64 != next {
                    told.now = next * 64;
                }
                high = Some(next);
                None
            }
            (0xA, Some(t)) => {
                let ordinal = told.events.len() as u64;
                let edge = Polarity::from_bit(bits(0, 1) as u16);
                told.triggers.push(Trigger { t, ordinal, channel: bits(8, 5) as u8, edge });
                told.counters.triggers += 1;
                told.now = t;
                None
            }
            (0xE | 0xF, _) => None,
            _ => Some(Fault::UnknownWord),
        };
        match fault {
            Some(fault) => {
                told.counters.faults.count(fault);
                told.counters.bytes_faulty += word_bytes;
            }
            None => told.counters.bytes_decoded += word_bytes,
        }
    }
    told
}

/// Sensors: as cameras have them, as large as the format, larger, and too small for a vector.
pub(super) fn any_geometry() -> impl Strategy<Value = Geometry> {
    let sizes = [(640, 480), (1280, 720), (2048, 2048), (u16::MAX, u16::MAX), (37, 20), (31, 1), (0, 0)];
    prop::sample::select(sizes.map(|(width, height)| Geometry::new(width, height)).to_vec())
}

/// Streams of events with time running on, with everything between them that is allowed and more.
pub(super) fn any_words() -> impl Strategy<Value = Vec<Word>> {
    let mask = prop_oneof![
        12 => (0..32u32).prop_map(|bit| 1 << bit),
        3 => any::<(u32, u32, u32)>().prop_map(|(a, b, c)| a & b & c),
        1 => any::<u32>(),
        1 => prop::sample::select(vec![0, u32::MAX]),
    ];
    let near = (0..2u32, 0..64u32, 0..20u32, 0..20u32);
    let far = (0..2u32, 0..64u32, 0..2048u32, 0..2048u32);
    let event =
        prop_oneof![12 => near, 1 => far].prop_map(|(p, low, x, y)| p << 28 | low << 22 | x << 11 | y);
    let step =
        prop_oneof![8 => 0..3i64, 1 => -3..0i64, 1 => -(1 << 27) - 1..(1i64 << 28), 1 => 0..1i64 << 21];
    let run = (step, prop::collection::vec(event, 0..40), prop::collection::vec(any::<u32>(), 0..2));
    let other = prop_oneof![30 => Just(None), 1 => any::<u32>().prop_map(Some), 1 => any::<u32>().prop_map(|w| Some(0xA << 28 | w >> 4))];
    let start = prop_oneof![
        Just(None),
        (0..100u32).prop_map(Some),
        Just(Some((1 << 28) - 3)),
        (0..1u32 << 28).prop_map(Some)
    ];
    let heads = (start, prop::collection::vec((run, other), 0..40)).prop_map(|(start, runs)| {
        let mut high = i64::from(start.unwrap_or(0));
        let mut heads = Vec::from_iter(start.map(|high| 0x8 << 28 | high));
        for ((step, events, any), other) in runs {
            high += step;
            heads.extend(other);
            heads.push(0x8 << 28 | (high as u32) & 0xFFF_FFFF);
            heads.extend(events);
            heads.extend(any.into_iter().filter(|word| word % 8 == 0));
        }
        heads
    });
    // Streams in which no word has more than two events are a kernel's own case.
    let few = (0..32u32, 0..32u32).prop_map(|(a, b)| 1 << a | 1 << b);
    let masks = prop_oneof![prop::collection::vec(mask, 1..50), prop::collection::vec(few, 1..50)];
    (heads, masks).prop_map(|(heads, masks)| {
        heads.into_iter().zip(masks.into_iter().cycle()).map(|(head, mask)| Word { head, mask }).collect()
    })
}

/// How a test cuts the bytes, and the room of the sinks for events and triggers.
pub(super) fn any_splits() -> impl Strategy<Value = (Vec<usize>, usize, usize)> {
    let pieces = prop::collection::vec(prop_oneof![1..50usize, 50..3000usize], 1..8);
    (pieces, prop_oneof![32..200usize, 200..3000usize], 1..4usize)
}
