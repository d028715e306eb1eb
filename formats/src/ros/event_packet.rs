//! `event_camera_msgs/EventPacket`: a camera's bytes as they came, or packed by its driver.
//!
//! Spec: <https://github.com/ros-event-camera/event_camera_msgs>, and event_camera_codecs for the encodings.
//!
//! ```text
//! header, u32 height, u32 width, u64 seq, u64 time_base (ns), string encoding, bool is_bigendian, u8[] events
//! ```
//!
//! `evt3`, `evt2`, `evt21`: the bytes go on from message to message, time_base says nothing; a seq that is missing
//! is a gap. `libcaer_cmp`: every message begins anew at time_base.

use super::fields::{CDR_TAIL_BYTES_MAX, Fields, Stamp, Wire};
use super::{libcaer_cmp, log};
use crate::byte_cursor::{Bad, Step};
use crate::intake::Intake;
use crate::{OpenOptions, raw};
use lobula_core::wire::{AnyDecoder, Encoding, WordOrder};
use lobula_core::{Counters, Decode, Fault, Geometry, Sink};

/// Name of the encoding that we write.
pub(crate) const EVT3: &str = "evt3";
/// Name of the encoding that is no camera's.
const LIBCAER_CMP: &str = "libcaer_cmp";
/// What can be read, for messages to people.
pub(crate) const ENCODINGS: &str = "evt3, evt2, evt21, libcaer_cmp";

/// What comes before the camera's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Head<'a> {
    pub stamp: Stamp,
    /// Columns and rows of the sensor.
    pub size: [u32; 2],
    pub seq: u64,
    pub time_base_ns: u64,
    pub encoding: &'a [u8],
    pub is_bigendian: bool,
    /// Bytes of the camera.
    pub events_bytes: u32,
    /// Bytes of the head.
    pub bytes: usize,
}

impl<'a> Head<'a> {
    pub fn parse(message: &'a [u8], wire: Wire) -> Option<Self> {
        let mut fields = Fields::new(message, wire)?;
        let stamp = fields.header()?;
        let (height, width) = (fields.u32()?, fields.u32()?);
        let (seq, time_base_ns) = (fields.u64()?, fields.u64()?);
        let encoding = fields.string()?;
        let is_bigendian = fields.u8()? != 0;
        let events_bytes = fields.u32()?;
        let bytes = fields.offset();
        let size = [width, height];
        Some(Self { stamp, size, seq, time_base_ns, encoding, is_bigendian, events_bytes, bytes })
    }
}

/// How the bytes of the messages are decoded.
#[derive(Clone, Debug)]
enum Codec {
    Camera(AnyDecoder, Encoding),
    LibcaerCmp(libcaer_cmp::Decoder),
}

/// Decodes the events of one message after the other.
#[derive(Clone, Debug)]
pub(crate) struct EventPackets {
    codec: Codec,
    /// What is not the codec's to count.
    counters: Counters,
    /// Sequence number of the message before, and its time.
    before: Option<(u64, Stamp)>,
    /// Messages that are missing by their sequence numbers.
    missing: u64,
    /// Whether a message of a camera's bytes was passed over.
    skipped: bool,
    /// Camera's bytes of this message still to come.
    left: u64,
    /// Whether it began with other messages than the first.
    in_piece: bool,
}

/// What an encoding's name stands for.
pub(crate) fn encoding(name: &[u8]) -> Option<Option<Encoding>> {
    match name {
        name if name == EVT3.as_bytes() => Some(Some(Encoding::Evt3)),
        b"evt2" => Some(Some(Encoding::Evt2)),
        b"evt21" => Some(Some(Encoding::Evt21(WordOrder::Little))),
        name if name == LIBCAER_CMP.as_bytes() => Some(None),
        _ => None,
    }
}

impl EventPackets {
    /// For messages of this encoding; none is `libcaer_cmp`.
    pub fn new(encoding: Option<Encoding>, geometry: Geometry, options: &OpenOptions) -> Self {
        let codec = match encoding {
            Some(encoding) => Codec::Camera(AnyDecoder::new(encoding, geometry), encoding),
            None => Codec::LibcaerCmp(libcaer_cmp::Decoder::new(Intake::new(geometry, options))),
        };
        Self {
            codec,
            counters: Counters::new(),
            before: None,
            missing: 0,
            skipped: false,
            left: 0,
            in_piece: false,
        }
    }

    /// Largest sensor that eleven bits of x and y can tell.
    pub const GEOMETRY_MAX: Geometry = raw::GEOMETRY_MAX;

    pub fn encoding(&self) -> Option<Encoding> {
        match &self.codec {
            Codec::Camera(_, encoding) => Some(*encoding),
            Codec::LibcaerCmp(_) => None,
        }
    }

    /// After how many µs the encoding's time wraps; 0: messages tell it whole.
    pub fn wrap_us(&self) -> u64 {
        self.encoding().map_or(0, Encoding::wrap_us)
    }

    /// From here on it is a piece of a recording.
    pub fn begin_piece(&mut self) {
        self.in_piece = true;
    }

    /// Begins with a message of `bytes` bytes; false where it is another encoding's or not as long as it says.
    pub fn begin(&mut self, head: Head<'_>, bytes: u64) -> bool {
        let behind = bytes.saturating_sub(head.bytes as u64).checked_sub(head.events_bytes.into());
        if behind.is_none_or(|behind| behind > CDR_TAIL_BYTES_MAX)
            || head.is_bigendian
            || encoding(head.encoding) != Some(self.encoding())
        {
            return false;
        }
        self.mind_gaps(&head);
        if let Codec::LibcaerCmp(decoder) = &mut self.codec {
            decoder.begin(head.time_base_ns);
        }
        self.left = head.events_bytes.into();
        self.counters.bytes_decoded += head.bytes as u64;
        true
    }

    /// Tells the decoder where messages are missing, with the time that passed by the messages' stamps.
    fn mind_gaps(&mut self, head: &Head<'_>) {
        let before = self.before.replace((head.seq, head.stamp));
        let Some((seq, stamp)) = before.filter(|(seq, _)| seq.wrapping_add(1) != head.seq) else { return };
        // A number that steps back is a driver started anew: nobody knows how many are missing, but one at least.
        self.missing += head.seq.checked_sub(seq.wrapping_add(1)).unwrap_or(1).max(1);
        self.lost(stamp, head.stamp);
    }

    fn lost(&mut self, from: Stamp, to: Stamp) {
        if let Codec::Camera(decoder, _) = &mut self.codec {
            let passed = to.us().saturating_sub(from.us());
            decoder.gap(Some(decoder.now().saturating_add_signed(passed)));
        }
    }

    /// A message that is damaged or cut was passed over.
    pub fn skip(&mut self) {
        if let (Codec::Camera(decoder, _), true) = (&mut self.codec, self.before.is_some()) {
            self.skipped = true;
            decoder.gap(Some(decoder.now()));
        }
    }

    /// Decodes bytes; those behind the camera's are left.
    pub fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        let len = usize::try_from(self.left).unwrap_or(usize::MAX).min(bytes.len());
        let bytes = bytes.get(..len).unwrap_or_default();
        let step = match &mut self.codec {
            Codec::Camera(decoder, _) => {
                let taken = decoder.decode(bytes, sink);
                Step { taken, full: taken < bytes.len() }
            }
            Codec::LibcaerCmp(decoder) => decoder.decode(bytes, sink)?,
        };
        self.left -= step.taken as u64;
        Ok(step)
    }

    /// The message ends after these bytes that were not taken.
    pub fn finish(&mut self, unread: u64) {
        match self.left {
            0 => self.counters.bytes_decoded += unread,
            _ => log::fault(&mut self.counters, Fault::CutShort, unread),
        }
        self.left = 0;
    }

    /// There are no more messages.
    pub fn end(&mut self) {
        if let Codec::Camera(decoder, _) = &mut self.codec {
            decoder.finish();
        }
    }

    pub fn counters(&self) -> Counters {
        let mut counters = match &self.codec {
            Codec::Camera(decoder, _) => *decoder.counters(),
            Codec::LibcaerCmp(decoder) => decoder.intake.counters,
        };
        counters.add(&self.counters);
        counters
    }

    pub fn missing(&self) -> u64 {
        self.missing
    }

    /// Whether the bytes so far end inside a word.
    pub fn is_in_word(&self) -> bool {
        matches!(&self.codec, Codec::Camera(decoder, _) if decoder.pending() > 0)
    }

    /// Stream time in µs, of a camera's bytes.
    pub fn now(&self) -> u64 {
        match &self.codec {
            Codec::Camera(decoder, _) => decoder.now(),
            Codec::LibcaerCmp(_) => 0,
        }
    }

    /// Whether a piece met a gap: its length tells wraps only where the time before it is known, and the messages that
    /// are missing are counted from the start.
    pub fn in_the_dark(&self) -> bool {
        self.in_piece && (self.missing > 0 || self.skipped)
    }
}
