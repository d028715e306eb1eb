//! Messages over a UART: postcard, a sequence number, a CRC-32, COBS.
//!
//! ```text
//!  COBS( sequence: u16 | message (postcard) | crc32 of both: u32 ) 0         integers little-endian
//! ```
//!
//! The sequence is 0 in the first frame of a run, then 1 to 65535 and 1 again. CRC-32 as in zip.

use super::cobs::{self, Full, Reader, Unstuffed};
use super::{Crc32, Fault, Ledger, Message};
use postcard::ser_flavors::Flavor;
use serde::Serialize;

const SEQUENCE_BYTES: usize = size_of::<u16>();
const CRC_BYTES: usize = size_of::<u32>();

/// Bytes of a frame besides its message's, for messages of up to 248; every 254 more cost one.
pub const OVERHEAD: usize = cobs::len_max(SEQUENCE_BYTES + CRC_BYTES);

/// The frame does not fit the memory given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong {
    /// Bytes given.
    pub room: usize,
}

impl core::fmt::Display for TooLong {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "the frame does not fit {} bytes: send less in one message, or give more", self.room)
    }
}

impl core::error::Error for TooLong {}

/// Messages to bytes.
#[derive(Clone, Debug, Default)]
pub struct Encoder {
    sequence: u16,
}

impl Encoder {
    /// An encoder at the start of a run.
    pub const fn new() -> Self {
        Self { sequence: 0 }
    }

    /// Writes the frame of a message to the start of `out`; returns its bytes. Where it does not fit, nothing counts
    /// as sent.
    pub fn encode(&mut self, message: &Message<'_>, out: &mut [u8]) -> Result<usize, TooLong> {
        let room = out.len();
        let len = self.frame(message, out).ok_or(TooLong { room })?;
        self.sequence = Ledger::after(self.sequence);
        Ok(len)
    }

    fn frame(&self, message: &Message<'_>, out: &mut [u8]) -> Option<usize> {
        let mut framer = Framer { writer: cobs::Writer::new(out), crc: Crc32::new() };
        framer.try_extend(&self.sequence.to_le_bytes()).ok()?;
        let mut serializer = postcard::Serializer { output: framer };
        message.serialize(&mut serializer).ok()?;
        serializer.output.finalize().ok()
    }
}

/// Takes the bytes of a frame as postcard makes them.
struct Framer<'o> {
    writer: cobs::Writer<'o>,
    crc: Crc32,
}

impl From<Full> for postcard::Error {
    fn from(_: Full) -> Self {
        Self::SerializeBufferFull
    }
}

impl Flavor for Framer<'_> {
    type Output = usize;

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.crc.push(byte);
        Ok(self.writer.push(byte)?)
    }

    fn finalize(mut self) -> postcard::Result<usize> {
        for byte in self.crc.value().to_le_bytes() {
            self.writer.push(byte)?;
        }
        Ok(self.writer.finish()?)
    }
}

/// A message that arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// The message.
    pub message: Message<'a>,
    /// Frames lost just before it; 65535: that many or more.
    pub lost_before: u16,
}

/// Bytes to messages, split anywhere.
///
/// `S` is memory for one frame: 6 bytes more than the longest message.
#[derive(Clone, Debug)]
pub struct Decoder<S> {
    memory: S,
    len: usize,
    too_long: bool,
    /// Whether a byte of the open frame has come.
    open: bool,
    reader: Reader,
    /// Frames lost before the next whole one.
    lost: u16,
    ledger: Ledger,
}

impl<S: AsRef<[u8]> + AsMut<[u8]>> Decoder<S> {
    /// A decoder that may start anywhere in a stream.
    pub fn new(memory: S) -> Self {
        let (len, too_long, open, lost) = (0, false, false, 0);
        Self { memory, len, too_long, open, reader: Reader::default(), lost, ledger: Ledger::default() }
    }

    /// What came so far.
    pub const fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// Takes bytes and calls `each` with every message that they complete.
    pub fn decode(&mut self, bytes: &[u8], mut each: impl FnMut(Frame<'_>)) {
        for byte in bytes {
            match self.reader.push(*byte) {
                Unstuffed::End(whole) => self.end(whole, &mut each),
                Unstuffed::Byte(byte) => self.keep(byte),
                Unstuffed::Nothing => self.open = true,
            }
        }
    }

    fn keep(&mut self, byte: u8) {
        match self.memory.as_mut().get_mut(self.len) {
            Some(slot) => {
                *slot = byte;
                self.len += 1;
            }
            None => self.too_long = true,
        }
    }

    fn end(&mut self, whole: bool, each: &mut impl FnMut(Frame<'_>)) {
        let (len, too_long) = (core::mem::take(&mut self.len), core::mem::take(&mut self.too_long));
        if !core::mem::take(&mut self.open) {
            return; // two ends in a row: a sender may begin with one
        }
        let frame = self.memory.as_ref().get(..len).unwrap_or_default();
        let fault = match sequence_and_message(frame) {
            _ if too_long => Fault::TooLong,
            _ if !whole => Fault::Framing,
            Err(fault) => fault,
            Ok((sequence, message)) => {
                let lost_before = self.lost.saturating_add(self.ledger.arrived(sequence));
                self.lost = lost_before;
                match postcard::from_bytes(message) {
                    Ok(message) => {
                        self.lost = 0;
                        self.ledger.frames = self.ledger.frames.saturating_add(1);
                        return each(Frame { message, lost_before });
                    }
                    Err(_) => Fault::Message,
                }
            }
        };
        self.ledger.count(fault);
    }
}

/// The parts of a frame, if its checksum fits.
fn sequence_and_message(frame: &[u8]) -> Result<(u16, &[u8]), Fault> {
    let (content, crc) = frame.split_last_chunk::<CRC_BYTES>().ok_or(Fault::Framing)?;
    let (sequence, message) = content.split_first_chunk::<SEQUENCE_BYTES>().ok_or(Fault::Framing)?;
    if Crc32::of(content) != u32::from_le_bytes(*crc) {
        return Err(Fault::Checksum);
    }
    Ok((u16::from_le_bytes(*sequence), message))
}
