//! EVT 4.0: 32-bit little-endian words, one for an event or two for up to 32 of one time, row and polarity.
//!
//! Prophesee's pages do not tell this format yet; OpenEB 5 does: `metavision/hal/decoders/evt4/evt4_event_types.h` and
//! `evt4_decoder.h` (<https://github.com/prophesee-ai/openeb>).
//!
//! ```text
//!  bits     31..28  27..22       21..11  10..0
//!  CD_OFF   0xA     time, low 6  x       y
//!  CD_ON    0xB     time, low 6  x       y
//!  CD_VEC_OFF 0xC   time, low 6  x of bit 0   y; the next word is the mask: bit i = event at x + i
//!  CD_VEC_ON  0xD   the same
//!  TIME_HIGH 0xE    time >> 6 (27..0)
//!  EXT_TRIGGER 0x9  time, low 6  21..13 unused, 12..8 channel, 7..1 count, 0 edge
//!  OTHER 0x6, CONTINUED 0x7, PADDING 0xFFFFFFFF    vendor's own or nothing: skipped
//! ```
//!
//! But for the types a word is laid out as in [EVT 2.0](super::evt2), and a vector as in [EVT 2.1](super::evt21) at any
//! column. A stream can only be read from its start: a mask can look like any word.

#[cfg(test)]
mod tests;

use super::carry::{self, Carry, Held, Steps, Words};
use super::evt21::{VECTOR_LEN, Word};
use super::mask::{self, Vector, Vectors};
use super::time_high::{self, Clock, ClockOut};
use crate::{Counters, Decode, Encode, Encoded, Event, Fault, Geometry, Refused, Sink, Span, Trigger};

const WORD_BYTES: usize = 4;
const OTHER: u32 = 0x6;
const CONTINUED: u32 = 0x7;
const EXT_TRIGGER: u32 = 0x9;
const CD_OFF: u32 = 0xA;
const CD_ON: u32 = 0xB;
const CD_VEC_OFF: u32 = 0xC;
const CD_VEC_ON: u32 = 0xD;
const TIME_HIGH: u32 = 0xE;
const PADDING: u32 = u32::MAX;
/// The bits below the type.
const BELOW_KIND: u32 = 0xFFF_FFFF;

const fn kind(word: u32) -> u32 {
    word >> 28
}

/// The events of a word and its mask, as EVT 2.1 has them.
const fn masked(word: u32, mask: u32) -> Word {
    Word { head: (kind(word) & 1) << 28 | word & BELOW_KIND, mask }
}

/// EVT 4.0 bytes to events; those of one vector come by rising x.
///
/// ```
/// use lobula_core::{Decode, Event, Geometry, Polarity, Sink, wire::evt4};
/// let words: [u32; 3] = [0xE000_0001, 0xD000_0000 | 5 << 22 | 320 << 11 | 240, 0b101];
/// let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
/// let mut decoder = evt4::Decoder::new(Geometry::new(640, 480));
/// let mut memory = [Event::default(); 64];
/// let mut sink = Sink::new(&mut memory);
/// assert_eq!(decoder.decode(&bytes, &mut sink), 12);
/// let events = [Event::new(69, 320, 240, Polarity::On), Event::new(69, 322, 240, Polarity::On)];
/// assert_eq!(sink.block(decoder.geometry()).span().events, events);
/// ```
#[derive(Clone, Debug)]
pub struct Decoder {
    geometry: Geometry,
    carry: Carry<WORD_BYTES>,
    /// The first word of a vector whose mask is still to come.
    open: Option<u32>,
    clock: Clock,
    counters: Counters,
}

impl Decoder {
    /// A decoder for a sensor of this size.
    pub const fn new(geometry: Geometry) -> Self {
        Self { geometry, carry: Carry::new(), open: None, clock: Clock::new(), counters: Counters::new() }
    }

    /// Takes a word; false when the sink takes no more.
    #[inline]
    fn word(&mut self, word: u32, sink: &mut Sink<'_>) -> bool {
        let (taken, words) = match self.open {
            Some(head) => (self.events(masked(head, word), sink), 2),
            None if matches!(kind(word), CD_VEC_OFF | CD_VEC_ON) => {
                self.open = Some(word);
                return true;
            }
            None => (self.single(word, sink), 1),
        };
        let is_taken = carry::count(taken, words * WORD_BYTES, &mut self.counters);
        if is_taken {
            self.open = None;
        }
        is_taken
    }

    /// Takes a word that is no part of a vector.
    #[inline]
    fn single(&mut self, word: u32, sink: &mut Sink<'_>) -> Result<bool, Fault> {
        match kind(word) {
            CD_OFF | CD_ON => self.events(masked(word, 1), sink),
            TIME_HIGH => {
                self.clock.time_high(word.into());
                Ok(true)
            }
            EXT_TRIGGER => self.clock.trigger(word, &mut self.counters, sink),
            OTHER | CONTINUED => Ok(true),
            _ if word == PADDING => Ok(true),
            _ => Err(Fault::UnknownWord),
        }
    }

    #[inline]
    fn events(&mut self, word: Word, sink: &mut Sink<'_>) -> Result<bool, Fault> {
        word.push(self.geometry, &mut self.clock, &mut self.counters, sink)
    }

    fn cut_short(&mut self) {
        if self.open.take().is_some() {
            self.counters.bytes_faulty += WORD_BYTES as u64;
            if self.carry.len() == 0 {
                self.counters.faults.count(Fault::CutShort);
            }
        }
        self.carry.cut_short(&mut self.counters);
    }
}

impl Words<WORD_BYTES> for Decoder {
    fn carry(&mut self) -> &mut Carry<WORD_BYTES> {
        &mut self.carry
    }

    fn words(&mut self, words: &[[u8; WORD_BYTES]], sink: &mut Sink<'_>) -> usize {
        let mut rest = words;
        while let Some((word, after)) = rest.split_first() {
            if sink.room() < VECTOR_LEN || !self.word(u32::from_le_bytes(*word), sink) {
                break;
            }
            rest = after;
        }
        words.len() - rest.len()
    }
}

impl Decode for Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> usize {
        carry::decode(self, bytes, sink)
    }

    fn finish(&mut self) {
        self.cut_short();
    }

    fn gap(&mut self, near: Option<u64>) {
        self.cut_short();
        self.clock.gap(near);
    }

    fn now(&self) -> u64 {
        self.clock.now()
    }

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn pending(&self) -> usize {
        self.carry.len() + self.open.map_or(0, |_| WORD_BYTES)
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

/// Events to EVT 4.0 bytes. Events that follow each other by rising x within 32 columns make a vector.
///
/// Keeps order, absolute time (up to 2^40 µs at the start) and silent gaps of any length, at two TIME_HIGH words at
/// most for each wrap of the 34 bits.
#[derive(Clone, Debug)]
pub struct Encoder {
    clock: ClockOut,
    open: Option<Vector>,
    held: Held<WORD_BYTES>,
    held_mask: Held<WORD_BYTES>,
}

impl Encoder {
    /// An encoder at the start of a stream.
    pub const fn new() -> Self {
        Self { clock: ClockOut::new(), open: None, held: Held::new(), held_mask: Held::new() }
    }
}

impl Default for Encoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Steps for Encoder {
    const TIME_HIGH: u32 = TIME_HIGH;
    const EXT_TRIGGER: u32 = EXT_TRIGGER;

    fn clock(&mut self) -> &mut ClockOut {
        &mut self.clock
    }

    #[inline]
    fn hold(&mut self, word: u32) {
        self.held.set(word.to_le_bytes());
    }

    #[inline]
    fn write(&mut self, out: &mut [u8], at: &mut usize) -> bool {
        self.held.write(out, at) && self.held_mask.write(out, at)
    }

    #[inline]
    fn step(&mut self, t: u64, event: Event) -> Result<bool, Refused> {
        mask::step(self, t, event)
    }

    #[inline]
    fn close(&mut self) -> bool {
        let Some(Vector { t, first, mask }) = self.open.take() else { return false };
        let is_one = mask == 1;
        let kind = if is_one { CD_OFF } else { CD_VEC_OFF };
        self.hold(time_high::event_word(kind | first.is_on() as u32, t, first));
        if !is_one {
            self.held_mask.set(mask.to_le_bytes());
        }
        true
    }
}

impl Vectors for Encoder {
    #[inline]
    fn open(&mut self) -> &mut Option<Vector> {
        &mut self.open
    }

    fn first_x(x: u16) -> u16 {
        x
    }
}

impl Encode for Encoder {
    fn encode(&mut self, span: Span<'_>, out: &mut [u8]) -> Encoded {
        carry::encode(self, span, out)
    }

    fn trigger(&mut self, trigger: Trigger, out: &mut [u8]) -> Encoded {
        carry::encode_trigger(self, trigger, out)
    }

    fn finish(&mut self, out: &mut [u8]) -> usize {
        carry::finish(self, out)
    }
}
