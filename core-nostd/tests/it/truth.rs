//! Real recordings against what other programs say is in them.

use crate::chunk_invariance::Splits;
use crate::streams::Timed;
use lobula_core::wire::{AnyDecoder, Encoding, Kernel, WordOrder, evt2, evt3, evt21};
use lobula_core::{Decode, Event, Geometry, Sink};
use sha2::{Digest, Sha256};

/// The Prophesee RAW recordings of the truth, with their format.
const RECORDINGS: [(&str, Encoding); 5] = [
    ("evt2_gen3_640x480.raw", Encoding::Evt2),
    ("evt21_le_1280x720.raw", Encoding::Evt21(WordOrder::Little)),
    ("evt21_legacy_1280x720.raw", Encoding::Evt21(WordOrder::Legacy)),
    ("evt3_gen41_1280x720.raw", Encoding::Evt3),
    ("evt3_trigger_1280x720.raw", Encoding::Evt3),
];

/// Decodes packets of random length with one decoder.
fn decode_all(mut decoder: AnyDecoder, bytes: &[u8], splits: &mut Splits) -> Vec<Timed> {
    let mut out = vec![];
    let mut memory = vec![Event::default(); 4096];
    let mut rest = bytes;
    while !rest.is_empty() {
        let mut sink = Sink::new(&mut memory);
        let n = decoder.decode(&rest[..splits.next(rest.len())], &mut sink);
        rest = &rest[n..];
        let block = sink.block(decoder.geometry());
        out.extend(
            block.span().events.iter().map(|event| Timed { t: block.span().time(*event), event: *event }),
        );
    }
    decoder.finish();
    assert_eq!((decoder.counters().faults.total(), decoder.counters().off_sensor), (0, 0));
    out
}

/// The digest of truth.json: SHA-256 over u64 t, u16 x, u16 y, u8 p of each event, little-endian.
fn digest(events: &[Timed]) -> String {
    let mut hasher = Sha256::new();
    for Timed { t, event } in events {
        hasher.update(t.to_le_bytes());
        hasher.update(event.x().to_le_bytes());
        hasher.update(event.y().to_le_bytes());
        hasher.update([event.is_on() as u8]);
    }
    hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Each decoder of the format, with whole input and split.
fn decoders(encoding: Encoding, geometry: Geometry) -> Vec<(AnyDecoder, Splits)> {
    let with = |kernel| match encoding {
        Encoding::Evt2 => AnyDecoder::Evt2(evt2::Decoder::with_kernel(geometry, kernel)),
        Encoding::Evt21(order) => AnyDecoder::Evt21(evt21::Decoder::with_kernel(geometry, order, kernel)),
        Encoding::Evt3 => AnyDecoder::Evt3(evt3::Decoder::with_kernel(geometry, kernel)),
        Encoding::Evt4 => AnyDecoder::new(encoding, geometry),
    };
    let decoders = Kernel::available().map(with);
    let splits = [Splits::Whole, Splits::random(7)];
    decoders.flat_map(|decoder| splits.clone().map(|splits| (decoder.clone(), splits))).collect()
}

#[test]
fn real_recordings_decode_to_the_truth() {
    let Some(truth) = lobula_tests::data("truth.json") else { return };
    let truth: serde_json::Value = serde_json::from_slice(&std::fs::read(truth).unwrap()).unwrap();
    for (name, encoding) in RECORDINGS {
        let Some(path) = lobula_tests::data(name) else { continue };
        let file = std::fs::read(path).unwrap();
        let truth = &truth[name];
        let size = |of: &str| truth[of].as_u64().unwrap() as u16;
        let geometry = Geometry::new(size("width"), size("height"));
        for (decoder, mut splits) in decoders(encoding, geometry) {
            let events = decode_all(decoder, lobula_tests::words_of_raw(&file), &mut splits);
            assert_eq!(events.len() as u64, truth["events"].as_u64().unwrap(), "{name}");
            assert_eq!(Some(digest(&events).as_str()), truth["sha256"].as_str(), "{name}");
        }
    }
}
