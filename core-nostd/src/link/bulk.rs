//! Raw EVT words over USB bulk transfers, or datagrams: a 16-byte header before each stretch of words.
//!
//! ```text
//!  bytes   0..2   2..4      4..8            8..10         10        11        12..16   16..
//!          magic  sequence  t_base (µs)     len in bytes  encoding  overruns  crc32    words
//! ```
//!
//! Integers little-endian. The sequence is that of `serial` frames; `t_base` is stream time before the
//! first word, modulo 2^32; `overruns` is how many packets the sender had to drop just before this frame (255: or
//! more); the CRC-32 is that of the other header bytes and the words. Frames follow each other without padding: a
//! transfer may hold several, or a part of one.

use super::{Crc32, Fault, Ledger};
use crate::wire::{Encoding, WordOrder};

/// Bytes of a header.
pub const HEADER_BYTES: usize = 16;
/// Most bytes of words in a frame.
pub const WORDS_BYTES_MAX: usize = u16::MAX as usize;

const MAGIC: [u8; 2] = [0x4C, 0xB5];

/// The number of a format in a header, and in `Message::Hello`.
pub const fn number(encoding: Encoding) -> u8 {
    match encoding {
        Encoding::Evt2 => 2,
        Encoding::Evt3 => 3,
        Encoding::Evt4 => 4,
        Encoding::Evt21(WordOrder::Little) => 21,
        Encoding::Evt21(_) => 22,
    }
}

/// The format of a number.
pub fn encoding(number: u8) -> Option<Encoding> {
    Encoding::ALL.iter().copied().find(|encoding| self::number(*encoding) == number)
}

/// What a header says of the words after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Stream time before the first word, in µs modulo 2^32.
    pub t_base: u32,
    /// Format of the words, as [`number`] tells.
    pub encoding: u8,
    /// Packets that the sender dropped just before these words; 255: that many or more.
    pub overruns: u8,
}

impl Header {
    fn to_bytes(self, sequence: u16, words: &[u8]) -> Option<[u8; HEADER_BYTES]> {
        let len = u16::try_from(words.len()).ok()?;
        let ([m0, m1], [s0, s1], [l0, l1]) = (MAGIC, sequence.to_le_bytes(), len.to_le_bytes());
        let [t0, t1, t2, t3] = self.t_base.to_le_bytes();
        let told = [m0, m1, s0, s1, t0, t1, t2, t3, l0, l1, self.encoding, self.overruns];
        let [c0, c1, c2, c3] = checksum(&told, words).to_le_bytes();
        let [.., encoding, overruns] = told;
        Some([m0, m1, s0, s1, t0, t1, t2, t3, l0, l1, encoding, overruns, c0, c1, c2, c3])
    }
}

fn checksum(told: &[u8], words: &[u8]) -> u32 {
    let mut crc = Crc32::new();
    crc.extend(told);
    crc.extend(words);
    crc.value()
}

/// Words to frames.
///
/// ```
/// use lobula_core::link::bulk::{Decoder, Encoder, Header};
/// let header = Header { t_base: 5, encoding: 3, overruns: 0 };
/// let mut wire = [0; 64];
/// let len = Encoder::new().encode(header, &[1, 2, 3, 4], &mut wire)?;
/// let mut decoder = Decoder::new([0; 64]);
/// let mut found = vec![];
/// decoder.decode(&wire[..len], |frame| found.push((frame.header, frame.words.to_vec())));
/// assert_eq!(found, [(header, vec![1, 2, 3, 4])]);
/// # Ok::<(), lobula_core::link::bulk::TooLong>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Encoder {
    sequence: u16,
}

/// The words do not fit a frame, or the frame does not fit the memory given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong {
    /// Bytes of the frame.
    pub len: usize,
    /// Bytes given.
    pub room: usize,
}

impl core::fmt::Display for TooLong {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { len, room } = self;
        write!(
            f,
            "a frame of {len} bytes does not fit {room}, or is beyond {WORDS_BYTES_MAX} of words: send less"
        )
    }
}

impl core::error::Error for TooLong {}

impl Encoder {
    /// An encoder at the start of a run.
    pub const fn new() -> Self {
        Self { sequence: 0 }
    }

    /// The header of the next frame, for senders that hand header and words to the hardware in two pieces. `None`, and
    /// nothing counts as sent, for more than [`WORDS_BYTES_MAX`].
    pub fn header(&mut self, header: Header, words: &[u8]) -> Option<[u8; HEADER_BYTES]> {
        let bytes = header.to_bytes(self.sequence, words)?;
        self.sequence = Ledger::after(self.sequence);
        Some(bytes)
    }

    /// Writes the next frame to the start of `out`; returns its bytes.
    pub fn encode(&mut self, header: Header, words: &[u8], out: &mut [u8]) -> Result<usize, TooLong> {
        let (len, room) = (HEADER_BYTES.saturating_add(words.len()), out.len());
        let too_long = TooLong { len, room };
        let (head, rest) = out.split_first_chunk_mut::<HEADER_BYTES>().ok_or(too_long)?;
        let body = rest.get_mut(..words.len()).ok_or(too_long)?;
        *head = self.header(header, words).ok_or(too_long)?;
        body.copy_from_slice(words);
        Ok(len)
    }
}

/// Words that arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// What its header says.
    pub header: Header,
    /// Frames lost just before it: like overruns, a [`gap`](crate::Decode::gap) for a decoder of events.
    pub lost_before: u16,
    /// The words.
    pub words: &'a [u8],
}

/// Frames to words, split anywhere.
///
/// `S` is memory for the longest frame, header included. A checksum that does not fit means that the search for the
/// next frame goes on behind the first byte of this one, so that a damaged length swallows none.
#[derive(Clone, Debug)]
pub struct Decoder<S> {
    memory: S,
    len: usize,
    /// Whether the last bytes were no frame: one stretch of them is one fault.
    astray: bool,
    skipped_bytes: u64,
    ledger: Ledger,
}

/// What is at the start of a stretch of bytes.
enum Found {
    /// Too little to say.
    More,
    /// A frame of so many bytes.
    Frame { len: usize, sequence: u16 },
    /// None.
    Fault(Fault),
}

impl<S: AsRef<[u8]> + AsMut<[u8]>> Decoder<S> {
    /// A decoder that may start anywhere in a stream.
    pub fn new(memory: S) -> Self {
        Self { memory, len: 0, astray: false, skipped_bytes: 0, ledger: Ledger::default() }
    }

    /// What came so far.
    pub const fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// Bytes that belonged to no frame.
    pub const fn skipped_bytes(&self) -> u64 {
        self.skipped_bytes
    }

    /// Bytes of a frame that is not complete yet.
    pub const fn pending(&self) -> usize {
        self.len
    }

    /// Takes bytes and calls `each` with every frame that they complete.
    pub fn decode(&mut self, bytes: &[u8], mut each: impl FnMut(Frame<'_>)) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let free = self.memory.as_mut().get_mut(self.len..).unwrap_or_default();
            let n = free.len().min(rest.len());
            let (Some(free), Some((now, after))) = (free.get_mut(..n), rest.split_at_checked(n)) else {
                return;
            };
            free.copy_from_slice(now);
            rest = after;
            self.len = self.len.saturating_add(n);
            let before = self.len;
            self.take(&mut each);
            if n == 0 && self.len == before {
                return self.skip(rest.len(), Fault::TooLong); // memory for not even a header
            }
        }
    }

    /// Counts bytes that belong to no frame. Those of one stretch are one fault, named for its start.
    fn skip(&mut self, bytes: usize, fault: Fault) {
        self.skipped_bytes = self.skipped_bytes.saturating_add(bytes as u64);
        if !core::mem::replace(&mut self.astray, true) {
            self.ledger.count(fault);
        }
    }

    /// Takes the frames that are whole out of the memory.
    fn take(&mut self, each: &mut impl FnMut(Frame<'_>)) {
        let mut at = 0;
        loop {
            let memory = self.memory.as_ref();
            let bytes = memory.get(at..self.len).unwrap_or_default();
            match found(bytes, memory.len()) {
                Found::More => break,
                Found::Fault(fault) => {
                    let skipped = 1 + to_magic(bytes.get(1..).unwrap_or_default());
                    at += skipped;
                    self.skip(skipped, fault);
                }
                Found::Frame { len, sequence } => {
                    self.astray = false;
                    let lost_before = self.ledger.arrived(sequence);
                    if let Some(frame) = frame(bytes.get(..len).unwrap_or_default(), lost_before) {
                        self.ledger.frames = self.ledger.frames.saturating_add(1);
                        let overruns = frame.header.overruns.into();
                        self.ledger.overruns = self.ledger.overruns.saturating_add(overruns);
                        each(frame);
                    }
                    at += len;
                }
            }
        }
        let len = self.len.saturating_sub(at);
        if at > 0
            && let Some(memory) = self.memory.as_mut().get_mut(..self.len)
        {
            move_down(memory, at);
        }
        self.len = len;
    }
}

/// Moves all but the first `by` bytes to the front.
fn move_down(bytes: &mut [u8], by: usize) {
    if by <= bytes.len() {
        bytes.copy_within(by.., 0);
    }
}

/// How many bytes come before the next that may be a frame's first.
fn to_magic(bytes: &[u8]) -> usize {
    let [first, second] = MAGIC;
    let may_be = |pair: &[u8]| matches!(pair, [a, b] if *a == first && *b == second);
    let whole = bytes.windows(2).position(may_be);
    whole.unwrap_or(match bytes {
        [.., last] if *last == first => bytes.len() - 1,
        _ => bytes.len(),
    })
}

fn found(bytes: &[u8], room: usize) -> Found {
    let [first, second] = MAGIC;
    match bytes {
        [a, ..] if *a != first => return Found::Fault(Fault::Framing),
        [_, b, ..] if *b != second => return Found::Fault(Fault::Framing),
        _ => {}
    }
    let Some(&[_, _, s0, s1, _, _, _, _, l0, l1, _, _, c0, c1, c2, c3]) = bytes.first_chunk::<HEADER_BYTES>()
    else {
        return Found::More;
    };
    let len = HEADER_BYTES.saturating_add(u16::from_le_bytes([l0, l1]).into());
    if len > room {
        return Found::Fault(Fault::TooLong);
    }
    let Some((head, words)) = bytes.get(..len).and_then(|frame| frame.split_at_checked(HEADER_BYTES)) else {
        return Found::More;
    };
    let told = head.get(..HEADER_BYTES - size_of::<u32>()).unwrap_or_default();
    if checksum(told, words) != u32::from_le_bytes([c0, c1, c2, c3]) {
        return Found::Fault(Fault::Checksum);
    }
    Found::Frame { len, sequence: u16::from_le_bytes([s0, s1]) }
}

/// A frame that was found.
fn frame(bytes: &[u8], lost_before: u16) -> Option<Frame<'_>> {
    let (head, words) = bytes.split_first_chunk::<HEADER_BYTES>()?;
    let [_, _, _, _, t0, t1, t2, t3, _, _, encoding, overruns, ..] = *head;
    let t_base = u32::from_le_bytes([t0, t1, t2, t3]);
    Some(Frame { header: Header { t_base, encoding, overruns }, lost_before, words })
}
