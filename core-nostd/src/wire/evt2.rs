//! EVT 2.0: a 32-bit little-endian word per event, as Gen3 and GenX320 sensors send.
//!
//! Spec: <https://docs.prophesee.ai/stable/data/encoding_formats/evt2.html>
//!
//! ```text
//!  bits     31..28  27..22       21..11  10..0
//!  CD_OFF   0x0     time, low 6  x       y
//!  CD_ON    0x1     time, low 6  x       y
//!  TIME_HIGH 0x8    time >> 6 (27..0)
//!  EXT_TRIGGER 0xA  time, low 6  21..13 unused, 12..8 channel, 7..1 unused, 0 edge
//!  OTHERS 0xE, CONTINUED 0xF     vendor's own: skipped
//! ```

#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
mod neon;
mod portable;
#[cfg(test)]
mod tests;

use super::carry::{self, Carry, Held, Steps, Words};
#[cfg(not(target_arch = "x86_64"))]
use super::kernel::absent as avx512;
#[cfg(not(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little")))]
use super::kernel::absent as neon;
use super::kernel::{Chosen, Done, Kernel};
use super::steady::Steady;
use super::time_high::{self, Clock, ClockOut};
use crate::event::packed::pack;
use crate::{
    Counters, Decode, Encode, Encoded, Event, Fault, Geometry, Refused, Sink, Span, Trigger, full_time,
};

const WORD_BYTES: usize = 4;
const CD_ON: u32 = 0x1;
const TIME_HIGH: u32 = 0x8;
const EXT_TRIGGER: u32 = 0xA;
const OTHERS: u32 = 0xE;
const CONTINUED: u32 = 0xF;

const fn kind(word: u32) -> u32 {
    word >> 28
}

const fn is_cd(word: u32) -> bool {
    kind(word) <= CD_ON
}

/// The pixel and polarity of a CD word, as [`pack`] wants it.
#[inline(always)]
pub(super) const fn pixel(word: u32) -> u32 {
    coordinates(word) | word << 3 & 0x8000_0000
}

#[inline(always)]
const fn coordinates(word: u32) -> u32 {
    word >> 11 & 0x7FF | word << 16 & 0x7FF_0000
}

/// The sensor's size, to test both coordinates of a word by one subtraction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits(pub(super) u32);

impl Limits {
    /// A bit over each coordinate.
    pub(super) const GUARDS: u32 = 0x8000_8000;

    pub(super) fn new(geometry: Geometry) -> Self {
        // A coordinate beyond the last pixel borrows the guard over it. With no pixel at all, guards are missing.
        let last = |pixels: u16| if pixels > 0x800 { 0x87FF } else { 0x7FFF + pixels as u32 };
        Self(last(geometry.height) << 16 | last(geometry.width))
    }

    /// [`GUARDS`](Self::GUARDS) among the bits if the CD word's pixel is on the sensor.
    #[inline(always)]
    pub(super) const fn guards(self, word: u32) -> u32 {
        self.0.wrapping_sub(coordinates(word))
    }

    #[inline(always)]
    pub(super) const fn contain(self, word: u32) -> bool {
        self.guards(word) & Self::GUARDS == Self::GUARDS
    }
}

/// EVT 2.0 bytes to events.
///
/// ```
/// use lobula_core::{Decode, Event, Geometry, Polarity, Sink, wire::evt2};
/// let words: [u32; 2] = [0x8000_0001, 0x1000_0000 | 5 << 22 | 320 << 11 | 240];
/// let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
/// let mut decoder = evt2::Decoder::new(Geometry::new(640, 480));
/// let mut memory = [Event::default(); 64];
/// let mut sink = Sink::new(&mut memory);
/// assert_eq!(decoder.decode(&bytes, &mut sink), 8);
/// assert_eq!(sink.block(decoder.geometry()).span().events, [Event::new(64 + 5, 320, 240, Polarity::On)]);
/// ```
#[derive(Clone, Debug)]
pub struct Decoder {
    geometry: Geometry,
    kernel: Chosen,
    carry: Carry<WORD_BYTES>,
    clock: Clock,
    counters: Counters,
}

impl Decoder {
    /// A decoder for a sensor of this size, with the fastest kernel of this CPU.
    pub fn new(geometry: Geometry) -> Self {
        Self::with_kernel(geometry, Kernel::best())
    }

    /// The same with a kernel of choice; one that this CPU lacks is replaced by the best that it has.
    pub fn with_kernel(geometry: Geometry, kernel: Kernel) -> Self {
        let (carry, clock, counters) = (Carry::new(), Clock::new(), Counters::new());
        Self { geometry, kernel: kernel.choose(), carry, clock, counters }
    }

    /// Takes a steady stretch from the start of `words`; how many.
    #[inline]
    fn run(&mut self, words: &[[u8; WORD_BYTES]], sink: &mut Sink<'_>) -> usize {
        let (Some(reach), Some(base)) = (self.clock.reach(sink), self.clock.base()) else { return 0 };
        let mut steady = Steady { limits: Limits::new(self.geometry), reach, base: base as u32 };
        let spare = sink.spare();
        let wide = match self.kernel {
            Chosen::Plain => return 0,
            Chosen::Branching | Chosen::Portable => Done::default(),
            Chosen::Neon(cpu) => neon::run(cpu, &mut steady, words, spare),
            Chosen::Avx512(cpu) => avx512::run(cpu, &mut steady, words, spare),
        };
        let rest = words.get(wide.words..).unwrap_or_default();
        let done = wide + portable::run(&mut steady, rest, spare.get_mut(wide.events..).unwrap_or_default());
        let taken = words.get(..done.words).unwrap_or_default();
        if let Some([first, .., last] | [first @ last]) = spare.get(..done.events) {
            let first = full_time(base, first.t());
            let last = self.clock.reached(last.t());
            sink.commit(done.events, first, last);
        }
        let head = |word: &[u8; WORD_BYTES]| u32::from_le_bytes(*word);
        let times = taken.iter().rev().take_while(|word| reach.contains(head(word))).count();
        for word in taken.get(taken.len() - times..).unwrap_or_default() {
            self.clock.time_high(head(word).into());
        }
        self.counters.events += done.events as u64;
        self.counters.bytes_decoded += size_of_val(taken) as u64;
        done.words
    }

    /// Takes a word of any kind; false when the sink takes no more.
    fn word(&mut self, word: u32, sink: &mut Sink<'_>) -> bool {
        let taken = match kind(word) {
            0..=CD_ON => self.cd(word, sink),
            TIME_HIGH => {
                self.clock.time_high(word.into());
                Ok(true)
            }
            EXT_TRIGGER => self.clock.trigger(word, &mut self.counters, sink),
            OTHERS | CONTINUED => Ok(true),
            _ => Err(Fault::UnknownWord),
        };
        carry::count(taken, WORD_BYTES, &mut self.counters)
    }

    fn cd(&mut self, word: u32, sink: &mut Sink<'_>) -> Result<bool, Fault> {
        let t = self.clock.base().ok_or(Fault::BeforeTime)? | u64::from(time_high::time_low(word));
        let event = bytemuck::cast(pack(t as u32, pixel(word)));
        if !Limits::new(self.geometry).contain(word) {
            self.counters.off_sensor += 1;
        } else if !sink.push(t, event) {
            return Ok(false);
        }
        self.counters.events += 1;
        self.clock.set_now(t);
        Ok(true)
    }
}

impl Words<WORD_BYTES> for Decoder {
    fn carry(&mut self) -> &mut Carry<WORD_BYTES> {
        &mut self.carry
    }

    fn words(&mut self, words: &[[u8; WORD_BYTES]], sink: &mut Sink<'_>) -> usize {
        let mut rest = words;
        loop {
            rest = rest.get(self.run(rest, sink)..).unwrap_or_default();
            let Some((word, after)) = rest.split_first() else { break };
            if sink.room() == 0 || !self.word(u32::from_le_bytes(*word), sink) {
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

/// How many of these bytes, which start anywhere between two words of a stream, a fresh decoder must take to know the
/// time: from there on it gives what a decoder gives that read all before, but for whole wraps of time.
pub(super) fn settled(bytes: &[u8]) -> Option<usize> {
    let kinds = bytes.as_chunks::<WORD_BYTES>().0.iter().map(|word| u32::from_le_bytes(*word) >> 28);
    time_high::settled(kinds.map(|kind| (kind == TIME_HIGH, kind <= CD_ON))).map(|words| words * WORD_BYTES)
}

/// Events to EVT 2.0 bytes.
///
/// Keeps absolute time (up to 2^40 µs at the start) and silent gaps of any length, at two TIME_HIGH words at most for
/// each wrap of the 34 bits.
#[derive(Clone, Debug)]
pub struct Encoder {
    clock: ClockOut,
    held: Held<WORD_BYTES>,
}

impl Encoder {
    /// An encoder at the start of a stream.
    pub const fn new() -> Self {
        Self { clock: ClockOut::new(), held: Held::new() }
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
        self.held.write(out, at)
    }

    #[inline]
    fn step(&mut self, t: u64, event: Event) -> Result<bool, Refused> {
        time_high::check_pixel(event)?;
        let ready = self.ready(t)?;
        if ready {
            self.hold(time_high::event_word(event.is_on() as u32, t, event));
        }
        Ok(ready)
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
