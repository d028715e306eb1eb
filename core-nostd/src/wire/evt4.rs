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
const fn vector(word: u32, mask: u32) -> Word {
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
            Some(head) => (self.events(vector(head, word), sink), 2),
            None if matches!(kind(word), CD_VEC_OFF | CD_VEC_ON) => {
                self.open = Some(word);
                return true;
            }
            None => (self.single(word, sink), 1),
        };
        let bytes = words * WORD_BYTES as u64;
        match taken {
            Ok(true) => self.counters.bytes_decoded += bytes,
            Ok(false) => return false,
            Err(fault) => {
                self.counters.faults.count(fault);
                self.counters.bytes_faulty += bytes;
            }
        }
        self.open = None;
        true
    }

    /// Takes a word that is no part of a vector.
    #[inline]
    fn single(&mut self, word: u32, sink: &mut Sink<'_>) -> Result<bool, Fault> {
        match kind(word) {
            CD_OFF | CD_ON => self.events(vector(word, 1), sink),
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

/// Events still to be sent together: they are of one time, row and polarity, by rising x, within 32 columns.
#[derive(Clone, Copy, Debug)]
struct Vector {
    t: u64,
    first: Event,
    mask: u32,
}

impl Vector {
    /// With the event, if it may join.
    #[inline]
    fn joined(self, t: u64, event: Event) -> Option<Self> {
        let alike = self.t == t && self.first.y() == event.y() && self.first.is_on() == event.is_on();
        let column = u32::from(event.x().checked_sub(self.first.x())?);
        let bit = 1u32.checked_shl(column)?;
        (alike && self.mask < bit).then_some(Self { mask: self.mask | bit, ..self })
    }

    /// The type of its word, and the mask, if it takes one.
    #[inline]
    const fn kind(self) -> (u32, Option<u32>) {
        match self.mask {
            1 => (CD_OFF, None),
            mask => (CD_VEC_OFF, Some(mask)),
        }
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

    /// Whether a word of time `t` may come next; else the word that must come before it is held to be sent.
    #[inline]
    fn ready(&mut self, t: u64) -> Result<bool, Refused> {
        if self.close() {
            return Ok(false);
        }
        let time_high = self.clock.toward(t)?;
        if let Some(reading) = time_high {
            self.held.set((TIME_HIGH << 28 | reading as u32).to_le_bytes());
        }
        Ok(time_high.is_none())
    }
}

impl Default for Encoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Steps for Encoder {
    #[inline]
    fn write(&mut self, out: &mut [u8], at: &mut usize) -> bool {
        self.held.write(out, at) && self.held_mask.write(out, at)
    }

    #[inline]
    fn step(&mut self, t: u64, event: Event) -> Result<bool, Refused> {
        time_high::check_pixel(event)?;
        if let Some(joined) = self.open.and_then(|open| open.joined(t, event)) {
            self.open = Some(joined);
            return Ok(true);
        }
        let ready = self.ready(t)?;
        if ready {
            self.open = Some(Vector { t, first: event, mask: 1 });
        }
        Ok(ready)
    }

    fn step_trigger(&mut self, trigger: Trigger) -> Result<bool, Refused> {
        let word = time_high::trigger_word(EXT_TRIGGER, trigger)?;
        let ready = self.ready(trigger.t)?;
        if ready {
            self.held.set(word.to_le_bytes());
        }
        Ok(ready)
    }

    #[inline]
    fn close(&mut self) -> bool {
        let Some(open) = self.open.take() else { return false };
        let (kind, mask) = open.kind();
        let word = time_high::event_word(kind | open.first.is_on() as u32, open.t, open.first);
        self.held.set(word.to_le_bytes());
        if let Some(mask) = mask {
            self.held_mask.set(mask.to_le_bytes());
        }
        true
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
