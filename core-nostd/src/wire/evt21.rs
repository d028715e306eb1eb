//! EVT 2.1: a 64-bit word for up to 32 events of one time, row and polarity, as IMX636 and GenX320 sensors send.
//!
//! Spec: <https://docs.prophesee.ai/stable/data/encoding_formats/evt21.html>
//!
//! ```text
//!  bits     63..60  59..54       53..43  42..32  31..0
//!  EVT_NEG  0x0     time, low 6  x of bit 0, a multiple of 32   y   mask: bit i = event at x + i
//!  EVT_POS  0x1     time, low 6  x       y       mask
//!  TIME_HIGH 0x8    time >> 6 (59..32)           unused
//!  EXT_TRIGGER 0xA  time, low 6  53..45 unused, 44..40 channel, 39..33 unused, 32 edge   unused
//!  OTHERS 0xE, CONTINUED 0xF     vendor's own: skipped
//! ```
//!
//! The upper half of a word is laid out as a word of [EVT 2.0](super::evt2). Which half comes first differs by sensor:
//! see [`WordOrder`].

#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
mod neon;
mod portable;
#[cfg(test)]
mod tests;

#[cfg(not(target_arch = "x86_64"))]
use self::absent as avx512;
#[cfg(not(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little")))]
use self::absent as neon;
use super::carry::{self, Carry, Held, Steps, Words};
use super::evt2::{Limits, pixel};
use super::kernel::{Chosen, Done, Kernel};
use super::mask::{self, Vector, Vectors};
use super::steady::Steady;
use super::time_high::{self, Clock, ClockOut};
use crate::event::packed::{COLUMN, pack};
use crate::{
    Counters, Decode, Encode, Encoded, Event, Fault, Geometry, Refused, Sink, Span, Trigger, full_time,
};

const WORD_BYTES: usize = 8;
/// Events that one word can hold.
pub(super) const VECTOR_LEN: usize = 32;
const EVT_POS: u32 = 0x1;
const TIME_HIGH: u32 = 0x8;
const EXT_TRIGGER: u32 = 0xA;
const OTHERS: u32 = 0xE;
const CONTINUED: u32 = 0xF;
/// Largest coordinate of 11 bits.
const COORDINATE_MAX: u16 = 0x7FF;

/// Order of a word's two halves on the wire; each half is little-endian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum WordOrder {
    /// The whole 64-bit word little-endian: the mask first (GenX320).
    #[default]
    Little,
    /// The upper half first, then the mask: `endianness=legacy` in a RAW header (IMX636).
    Legacy,
}

/// [`WordOrder`] as a parameter of functions, so that a loop need not ask for each word.
const LITTLE: u8 = 0;
const LEGACY: u8 = 1;

impl WordOrder {
    const fn from_const(order: u8) -> Self {
        if order == LEGACY { Self::Legacy } else { Self::Little }
    }
}

/// A word's upper half, laid out as EVT 2.0, and its mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Word {
    pub(super) head: u32,
    pub(super) mask: u32,
}

impl Word {
    #[inline]
    const fn from_bytes(bytes: [u8; WORD_BYTES], order: WordOrder) -> Self {
        let word = u64::from_le_bytes(bytes);
        match order {
            WordOrder::Little => Self { head: (word >> 32) as u32, mask: word as u32 },
            WordOrder::Legacy => Self { head: word as u32, mask: (word >> 32) as u32 },
        }
    }

    #[inline]
    const fn to_bytes(self, order: WordOrder) -> [u8; WORD_BYTES] {
        let (head, mask) = (self.head as u64, self.mask as u64);
        match order {
            WordOrder::Little => head << 32 | mask,
            WordOrder::Legacy => mask << 32 | head,
        }
        .to_le_bytes()
    }

    const fn kind(self) -> u32 {
        self.head >> 28
    }

    const fn time_low(self) -> u32 {
        time_high::time_low(self.head)
    }

    const fn x(self) -> u16 {
        (self.head >> 11) as u16 & COORDINATE_MAX
    }

    const fn y(self) -> u16 {
        self.head as u16 & COORDINATE_MAX
    }

    /// The event of bit 0, packed, of this time but for the word's low bits.
    #[inline(always)]
    const fn first(self, base: u32) -> u64 {
        pack(base | self.time_low(), pixel(self.head))
    }

    /// The mask without the events off the sensor.
    #[inline]
    const fn mask_on(self, geometry: Geometry) -> u32 {
        let columns = geometry.width.saturating_sub(self.x()) as u32;
        let in_columns = if columns >= VECTOR_LEN as u32 { u32::MAX } else { (1 << columns) - 1 };
        if self.y() < geometry.height { self.mask & in_columns } else { 0 }
    }

    /// Gives the sink the events; false when it takes no more.
    #[inline]
    pub(super) fn push(
        self,
        geometry: Geometry,
        clock: &mut Clock,
        counters: &mut Counters,
        sink: &mut Sink<'_>,
    ) -> Result<bool, Fault> {
        let t = clock.base().ok_or(Fault::BeforeTime)? | u64::from(self.time_low());
        let mask = self.mask_on(geometry);
        if mask != 0 && !sink.admits(t) {
            return Ok(false);
        }
        let Some(slots) = sink.spare().first_chunk_mut() else { return Ok(false) };
        expand(mask, self.first(t as u32), slots);
        sink.commit(mask.count_ones() as usize, t, t);
        counters.events += u64::from(self.mask.count_ones());
        counters.off_sensor += u64::from((self.mask & !mask).count_ones());
        clock.set_now(t);
        Ok(true)
    }
}

/// EVT 2.1 bytes to events; those of one word come by rising x.
///
/// ```
/// use lobula_core::wire::evt21::{self, WordOrder};
/// use lobula_core::{Decode, Event, Geometry, Polarity, Sink};
/// let words: [u64; 2] = [0x8000_0001 << 32, (0x1000_0000 | 5 << 22 | 32 << 11 | 7) << 32 | 0b101];
/// let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
/// let mut decoder = evt21::Decoder::new(Geometry::new(1280, 720), WordOrder::Little);
/// let mut memory = [Event::default(); 64];
/// let mut sink = Sink::new(&mut memory);
/// assert_eq!(decoder.decode(&bytes, &mut sink), 16);
/// let events = [Event::new(69, 32, 7, Polarity::On), Event::new(69, 34, 7, Polarity::On)];
/// assert_eq!(sink.block(decoder.geometry()).span().events, events);
/// ```
#[derive(Clone, Debug)]
pub struct Decoder {
    geometry: Geometry,
    order: WordOrder,
    kernel: Chosen,
    carry: Carry<WORD_BYTES>,
    clock: Clock,
    counters: Counters,
}

impl Decoder {
    /// A decoder for a sensor of this size that sends words in this order, with the fastest kernel of this CPU.
    pub fn new(geometry: Geometry, order: WordOrder) -> Self {
        Self::with_kernel(geometry, order, Kernel::best())
    }

    /// The same with a kernel of choice; one that this CPU lacks is replaced by the best that it has.
    pub fn with_kernel(geometry: Geometry, order: WordOrder, kernel: Kernel) -> Self {
        let (carry, clock, counters) = (Carry::new(), Clock::new(), Counters::new());
        Self { geometry, order, kernel: kernel.choose(), carry, clock, counters }
    }

    /// Takes a steady stretch from the start of `words`: vectors that lie on the sensor whole, and times. How many words.
    #[inline]
    fn run<const ORDER: u8>(&mut self, words: &[[u8; WORD_BYTES]], sink: &mut Sink<'_>) -> usize {
        let (Some(reach), Some(base)) = (self.clock.reach(sink), self.clock.base()) else { return 0 };
        let Geometry { width, height } = self.geometry;
        let limits = Limits::new(Geometry::new(width.saturating_sub(VECTOR_LEN as u16 - 1), height));
        let mut steady = Steady { limits, reach, base: base as u32 };
        let spare = sink.spare();
        let wide = match self.kernel {
            Chosen::Plain => return 0,
            Chosen::Branching | Chosen::Portable => Done::default(),
            Chosen::Neon(cpu) => neon::run::<ORDER>(cpu, &mut steady, words, spare),
            Chosen::Avx512(cpu) => avx512::run::<ORDER>(cpu, &mut steady, words, spare),
        };
        let rest = words.get(wide.words..).unwrap_or_default();
        let done = wide
            + portable::run::<ORDER>(&mut steady, rest, spare.get_mut(wide.events..).unwrap_or_default());
        let taken = words.get(..done.words).unwrap_or_default();
        if let Some([first, .., last] | [first @ last]) = spare.get(..done.events) {
            let first = full_time(base, first.t());
            let last = self.clock.reached(last.t());
            sink.commit(done.events, first, last);
        }
        let head = |word: &[u8; WORD_BYTES]| Word::from_bytes(*word, WordOrder::from_const(ORDER)).head;
        let times = taken.iter().rev().take_while(|word| reach.contains(head(word))).count();
        for word in taken.get(taken.len() - times..).unwrap_or_default() {
            self.clock.time_high(head(word).into());
        }
        self.counters.events += done.events as u64;
        self.counters.bytes_decoded += size_of_val(taken) as u64;
        done.words
    }

    /// Takes a word; false when the sink takes no more.
    #[inline]
    fn word(&mut self, word: Word, sink: &mut Sink<'_>) -> bool {
        let taken = match word.kind() {
            0..=EVT_POS => word.push(self.geometry, &mut self.clock, &mut self.counters, sink),
            TIME_HIGH => {
                self.clock.time_high(word.head.into());
                Ok(true)
            }
            EXT_TRIGGER => self.clock.trigger(word.head, &mut self.counters, sink),
            OTHERS | CONTINUED => Ok(true),
            _ => Err(Fault::UnknownWord),
        };
        carry::count(taken, WORD_BYTES, &mut self.counters)
    }
}

impl Words<WORD_BYTES> for Decoder {
    fn carry(&mut self) -> &mut Carry<WORD_BYTES> {
        &mut self.carry
    }

    fn words(&mut self, words: &[[u8; WORD_BYTES]], sink: &mut Sink<'_>) -> usize {
        let mut rest = words;
        loop {
            let taken = match self.order {
                WordOrder::Little => self.run::<LITTLE>(rest, sink),
                WordOrder::Legacy => self.run::<LEGACY>(rest, sink),
            };
            rest = rest.get(taken..).unwrap_or_default();
            let Some((word, after)) = rest.split_first() else { break };
            if sink.room() < VECTOR_LEN || !self.word(Word::from_bytes(*word, self.order), sink) {
                break;
            }
            rest = after;
        }
        words.len() - rest.len()
    }
}

/// Writes the event at each column of `mask`, `first` being that of bit 0, packed, and maybe more after them; how many.
///
/// Most vectors hold one or two events: two are written whatever there is, and only more cost a branch.
#[inline]
fn expand(mask: u32, first: u64, slots: &mut [Event; VECTOR_LEN]) -> usize {
    let event = |left: u32| bytemuck::cast(first.wrapping_add(u64::from(left.trailing_zeros()) * COLUMN));
    let second = mask & mask.wrapping_sub(1);
    let mut left = second & second.wrapping_sub(1);
    slots[0] = event(mask);
    slots[1] = event(second);
    if left == 0 {
        return usize::from(mask != 0) + usize::from(second != 0);
    }
    let mut n = 2;
    for slot in slots.iter_mut().skip(2) {
        *slot = event(left);
        n += 1;
        left &= left.wrapping_sub(1);
        if left == 0 {
            break;
        }
    }
    n
}

impl Decode for Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> usize {
        carry::decode(self, bytes, sink)
    }

    fn finish(&mut self) {
        self.carry.cut_short(&mut self.counters);
    }

    fn gap(&mut self, near: Option<u64>) {
        self.carry.cut_short(&mut self.counters);
        self.clock.gap(near);
    }

    fn now(&self) -> u64 {
        self.clock.now()
    }

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn pending(&self) -> usize {
        self.carry.len()
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

/// How many of these bytes a fresh decoder must take to know the time, as in [EVT 2.0](super::evt2).
pub(super) fn settled(bytes: &[u8], order: WordOrder) -> Option<usize> {
    let words = bytes.as_chunks::<WORD_BYTES>().0.iter();
    let kinds = words.map(|word| Word::from_bytes(*word, order).kind());
    time_high::settled(kinds.map(|kind| (kind == TIME_HIGH, kind <= EVT_POS))).map(|words| words * WORD_BYTES)
}

/// Events to EVT 2.1 bytes. Events that follow each other by rising x within 32 columns share a word.
///
/// Keeps order, absolute time (up to 2^40 µs at the start) and silent gaps of any length, at two TIME_HIGH words at
/// most for each wrap of the 34 bits.
#[derive(Clone, Debug)]
pub struct Encoder {
    order: WordOrder,
    clock: ClockOut,
    open: Option<Vector>,
    held: Held<WORD_BYTES>,
}

impl Encoder {
    /// An encoder at the start of a stream of words in this order.
    pub const fn new(order: WordOrder) -> Self {
        Self { order, clock: ClockOut::new(), open: None, held: Held::new() }
    }

    fn hold_word(&mut self, word: Word) {
        self.held.set(word.to_bytes(self.order));
    }
}

impl Steps for Encoder {
    const TIME_HIGH: u32 = TIME_HIGH;
    const EXT_TRIGGER: u32 = EXT_TRIGGER;

    fn clock(&mut self) -> &mut ClockOut {
        &mut self.clock
    }

    #[inline]
    fn hold(&mut self, head: u32) {
        self.hold_word(Word { head, mask: 0 });
    }

    #[inline]
    fn write(&mut self, out: &mut [u8], at: &mut usize) -> bool {
        self.held.write(out, at)
    }

    #[inline]
    fn step(&mut self, t: u64, event: Event) -> Result<bool, Refused> {
        mask::step(self, t, event)
    }

    #[inline]
    fn close(&mut self) -> bool {
        let Some(Vector { t, first, mask }) = self.open.take() else { return false };
        self.hold_word(Word { head: time_high::event_word(first.is_on() as u32, t, first), mask });
        true
    }
}

impl Vectors for Encoder {
    #[inline]
    fn open(&mut self) -> &mut Option<Vector> {
        &mut self.open
    }

    fn first_x(x: u16) -> u16 {
        x & !(VECTOR_LEN as u16 - 1)
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

/// In place of a kernel that this is not compiled for.
mod absent {
    use super::{Done, Event, Steady, WORD_BYTES};
    use crate::wire::kernel::absent::Cpu;

    pub fn run<const ORDER: u8>(cpu: Cpu, _: &mut Steady, _: &[[u8; WORD_BYTES]], _: &mut [Event]) -> Done {
        match cpu {}
    }
}
