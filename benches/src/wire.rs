//! What the decoders of EVT 2.0 and 2.1 are measured on: a real recording repeated in time, at word level, or what our
//! encoder makes of the synthetic scene.

use std::path::Path;

use lobula_core::wire::{AnyDecoder, AnyEncoder, Encoding, Kernel, WordOrder, evt2, evt21};
use lobula_core::{Decode, Encode, Event, Geometry, Sink};

use crate::input::{PACKET_EVENTS, Scene, body, file_of, packets};

/// Type of the words that tell the upper bits of the time, in the upper half of EVT 2.1's, and bits of time they carry.
const TIME_HIGH: u32 = 0x8;
const HIGH_BITS: u32 = 28;
/// Bits of time in the other words.
const LOW_BITS: u32 = 6;

/// A stream of 32-bit or 64-bit words in memory.
pub struct Wire {
    /// The format.
    pub encoding: Encoding,
    /// Words of the stream, without a file's header.
    pub bytes: Vec<u8>,
    /// The sensor's size.
    pub geometry: Geometry,
    /// Every event of it, in stream order, as the kernel that takes one word after another finds them.
    pub events: Vec<Event>,
}

impl Wire {
    /// The format's recording repeated to at least `events` events, else those of the scene encoded.
    ///
    /// # Errors
    /// A sentence, where the recording is there and cannot be used, or the repetition does not add up.
    pub fn load(encoding: Encoding, scene: &Scene, events: usize) -> Result<Self, String> {
        match recording(encoding).and_then(|(name, geometry)| Some((file_of(name)?, geometry))) {
            Some((path, geometry)) => Self::repeated(encoding, &path, geometry, events),
            None => Self::encoded(encoding, scene),
        }
    }

    /// A decoder of it with this kernel.
    pub fn decoder(&self, kernel: Kernel) -> AnyDecoder {
        decoder(self.encoding, self.geometry, kernel)
    }

    fn repeated(encoding: Encoding, path: &Path, geometry: Geometry, events: usize) -> Result<Self, String> {
        let file = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
        let words = Words::of(encoding, body(&file));
        let once = decode(encoding, geometry, &words.bytes(0))?;
        let copies = events.div_ceil(once.len().max(1));
        let bytes: Vec<u8> = (0..copies as u32).flat_map(|copy| words.bytes(copy)).collect();
        let all = decode(encoding, geometry, &bytes)?;
        let later = |(i, event): (usize, &Event)| {
            let shift = (i / once.len()) as u32 * (words.period << LOW_BITS);
            let first = once[i % once.len()];
            *event == Event::new(first.t().wrapping_add(shift), first.x(), first.y(), first.polarity())
        };
        if all.len() != copies * once.len() || !all.iter().enumerate().all(later) {
            return Err(format!("{}: {copies} copies are not the recording repeated", path.display()));
        }
        Ok(Self { encoding, bytes, geometry, events: all })
    }

    fn encoded(encoding: Encoding, scene: &Scene) -> Result<Self, String> {
        let mut encoder = AnyEncoder::new(encoding);
        let (mut bytes, mut out) = (Vec::new(), vec![0; 1 << 16]);
        for mut packet in packets(scene.span(scene.events.len())) {
            while !packet.events.is_empty() {
                let done = encoder.encode(packet, &mut out);
                done.refused.map_or(Ok(()), |refused| Err(format!("{encoding}: {refused:?}")))?;
                bytes.extend_from_slice(&out[..done.bytes]);
                packet = packet.with_events(&packet.events[done.events..]);
            }
        }
        while let n @ 1.. = encoder.finish(&mut out) {
            bytes.extend_from_slice(&out[..n]);
        }
        let events = decode(encoding, scene.geometry, &bytes)?;
        Ok(Self { encoding, bytes, geometry: scene.geometry, events })
    }
}

/// Name and sensor of the format's recording in `data/` of the shared folder.
fn recording(encoding: Encoding) -> Option<(&'static str, Geometry)> {
    match encoding {
        Encoding::Evt2 => Some(("evt2_gen3_640x480.raw", Geometry::new(640, 480))),
        Encoding::Evt21(WordOrder::Little) => Some(("evt21_le_1280x720.raw", Geometry::new(1280, 720))),
        Encoding::Evt21(WordOrder::Legacy) => Some(("evt21_legacy_1280x720.raw", Geometry::new(1280, 720))),
        Encoding::Evt3 | Encoding::Evt4 => None,
    }
}

fn decoder(encoding: Encoding, geometry: Geometry, kernel: Kernel) -> AnyDecoder {
    match encoding {
        Encoding::Evt2 => AnyDecoder::Evt2(evt2::Decoder::with_kernel(geometry, kernel)),
        Encoding::Evt21(order) => AnyDecoder::Evt21(evt21::Decoder::with_kernel(geometry, order, kernel)),
        Encoding::Evt3 | Encoding::Evt4 => AnyDecoder::new(encoding, geometry),
    }
}

/// Every event, word after word.
pub(crate) fn decode(encoding: Encoding, geometry: Geometry, bytes: &[u8]) -> Result<Vec<Event>, String> {
    let mut decoder = decoder(encoding, geometry, Kernel::Plain);
    let mut buffer = vec![Event::default(); PACKET_EVENTS];
    let mut events = Vec::new();
    let mut rest = bytes;
    while !rest.is_empty() {
        let mut sink = Sink::new(&mut buffer);
        let taken = decoder.decode(rest, &mut sink);
        if taken == 0 && sink.is_empty() {
            return Err("the decoder stands still".into());
        }
        events.extend_from_slice(sink.block(geometry).span().events);
        rest = &rest[taken..];
    }
    Ok(events)
}

/// A recording's words by halves of 32 bits, of which some hold a word's type.
struct Words {
    halves: Vec<u32>,
    /// Which halves hold the type: each `stride`, from `first` on.
    first: usize,
    stride: usize,
    /// From a copy to the next, in units of TIME_HIGH.
    period: u32,
}

impl Words {
    fn of(encoding: Encoding, bytes: &[u8]) -> Self {
        let (first, stride) = match encoding {
            Encoding::Evt21(WordOrder::Little) => (1, 2),
            Encoding::Evt21(WordOrder::Legacy) => (0, 2),
            _ => (0, 1),
        };
        let whole = bytes.len() - bytes.len() % (4 * stride);
        let halves = bytes[..whole].as_chunks().0.iter().map(|half| u32::from_le_bytes(*half)).collect();
        let mut words = Self { halves, first, stride, period: 0 };
        let readings = || words.heads().map(|head| words.halves[head]).filter_map(reading);
        words.period = readings().max().unwrap_or(0) - readings().min().unwrap_or(0) + 1;
        words
    }

    fn heads(&self) -> impl Iterator<Item = usize> {
        (self.first..self.halves.len()).step_by(self.stride)
    }

    /// The recording `copy` periods later. Nothing but the TIME_HIGH words differs.
    fn bytes(&self, copy: u32) -> Vec<u8> {
        let mut halves = self.halves.clone();
        for head in self.heads() {
            if let Some(reading) = reading(halves[head]) {
                let later = reading + copy * self.period;
                halves[head] = TIME_HIGH << HIGH_BITS | later & ((1 << HIGH_BITS) - 1);
            }
        }
        halves.into_iter().flat_map(u32::to_le_bytes).collect()
    }
}

fn reading(head: u32) -> Option<u32> {
    (head >> HIGH_BITS == TIME_HIGH).then_some(head & ((1 << HIGH_BITS) - 1))
}
