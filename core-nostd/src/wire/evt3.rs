//! EVT3: Prophesee's vectorised stream of 16-bit little-endian words, 1.3 to 3 bytes an event.
//!
//! Spec: <https://docs.prophesee.ai/stable/data/encoding_formats/evt3.html>; the rules of time are OpenEB's.
//!
//! ```text
//!  15..12  word          11..0
//!  0x0     ADDR_Y        11: system type (ignored), 10..0: row of the events after it
//!  0x2     ADDR_X        11: polarity, 10..0: column: one event
//!  0x3     VECT_BASE_X   11: polarity, 10..0: column of the vectors after it
//!  0x4     VECT_12       11..0: an event at base + i for each bit i; then base += 12
//!  0x5     VECT_8        7..0: the same of 8 columns; then base += 8
//!  0x6     TIME_LOW      bits 11..0 of the time in µs
//!  0x8     TIME_HIGH     bits 23..12 of the time in µs
//!  0xA     EXT_TRIGGER   11..8: channel, 0: edge
//!  0x7, 0xF, 0xE         CONTINUED_4, CONTINUED_12, OTHERS: well formed, nothing to us
//! ```
//!
//! Time: a TIME_HIGH that repeats keeps the low bits, one that differs sets them to 0; a step back of TIME_HIGH is a
//! wrap only beyond half the range ([`Unwrap`]), and a smaller one steps time back, as TIME_LOW may.

use crate::{
    Counters, Decode, Encode, Encoded, Event, Fault, Geometry, Polarity, Refused, Sink, Span, Trigger,
    Unwrap, full_time,
};

#[cfg(target_arch = "x86_64")]
mod avx512;
mod branching;
mod kernel;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
mod neon;
mod portable;
#[cfg(test)]
mod tests;

use super::kernel::Chosen;
pub use super::kernel::Kernel;
use kernel::Steady;

const ADDR_Y: u16 = 0x0;
const ADDR_X: u16 = 0x2;
const VECT_BASE_X: u16 = 0x3;
const VECT_12: u16 = 0x4;
const VECT_8: u16 = 0x5;
const TIME_LOW: u16 = 0x6;
const CONTINUED_4: u16 = 0x7;
const TIME_HIGH: u16 = 0x8;
const EXT_TRIGGER: u16 = 0xA;
const OTHERS: u16 = 0xE;
const CONTINUED_12: u16 = 0xF;

/// Bits of a coordinate.
const COORDINATE: u16 = 0x7FF;
/// Bit of the polarity in ADDR_X and VECT_BASE_X.
const POLARITY_SHIFT: u32 = 11;
/// Largest number of a trigger input, and where it stands in EXT_TRIGGER.
const CHANNEL_MAX: u8 = 0xF;
const CHANNEL_SHIFT: u32 = 8;
/// Bits of a word beside its type.
const PAYLOAD: u16 = 0xFFF;
/// After how many µs the time wraps.
pub(super) const WRAP_US: u64 = 1 << (2 * TIME_BITS);
/// Bits of time in each of TIME_LOW and TIME_HIGH.
const TIME_BITS: u32 = 12;
/// Events of the largest word: a decoder stops before any word when the sink has less room.
const WORD_EVENTS_MAX: usize = 12;

const fn word(kind: u16, payload: u16) -> u16 {
    kind << 12 | payload & PAYLOAD
}

/// The bits of a mask that are 1, upwards.
fn ones(mut mask: u32) -> impl Iterator<Item = u32> {
    core::iter::from_fn(move || {
        let lowest = (mask != 0).then_some(mask.trailing_zeros())?;
        mask &= mask - 1;
        Some(lowest)
    })
}

/// What a decoder knows of stream time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Clock {
    /// Nothing yet: waits for TIME_HIGH, whose low bits count as 0.
    Unset,
    /// Bytes were lost: waits for TIME_HIGH, nearest to the hint if there is one.
    Lost { near: Option<u64> },
    /// Has TIME_HIGH after a loss. It may be one that repeats, so the low bits must come too.
    LostLow,
    /// Known.
    Set,
}

/// What words leave behind for the words after them.
#[derive(Clone, Copy, Debug)]
struct State {
    clock: Clock,
    high: Unwrap<TIME_BITS>,
    /// Last known time in µs.
    time: u64,
    row: Option<u16>,
    /// Column and polarity of the next vector.
    base: Option<(u16, Polarity)>,
}

/// EVT3 bytes in, events out.
///
/// ```
/// use lobula_core::{Decode, Event, Geometry, Polarity, Sink, wire::evt3::Decoder};
/// let bytes = [0x01, 0x80, 0x02, 0x60, 0x07, 0x00, 0x05, 0x28]; // TIME_HIGH 1, TIME_LOW 2, ADDR_Y 7, ADDR_X 5 ON
/// let mut memory = [Event::default(); Sink::LEN_MIN];
/// let mut sink = Sink::new(&mut memory);
/// let mut decoder = Decoder::new(Geometry::new(1280, 720));
/// assert_eq!(decoder.decode(&bytes, &mut sink), 8);
/// assert_eq!(sink.block(decoder.geometry()).span().events, [Event::new(4098, 5, 7, Polarity::On)]);
/// ```
#[derive(Clone, Debug)]
pub struct Decoder {
    geometry: Geometry,
    kernel: Chosen,
    state: State,
    /// The first byte of a word whose second has not come.
    carry: Option<u8>,
    counters: Counters,
}

impl Decoder {
    /// A decoder at the start of a stream of a sensor of this size, with the fastest kernel of this CPU.
    pub fn new(geometry: Geometry) -> Self {
        Self::with_kernel(geometry, Kernel::best())
    }

    /// The same with a kernel of choice; one that this CPU lacks is replaced by the best that it has.
    pub fn with_kernel(geometry: Geometry, kernel: Kernel) -> Self {
        let state = State { clock: Clock::Unset, high: Unwrap::near(0), time: 0, row: None, base: None };
        Self { geometry, kernel: kernel.choose(), state, carry: None, counters: Counters::default() }
    }

    /// Decodes whole words and returns how many: steady stretches by the kernel, what comes between them one by one.
    fn words(&mut self, words: &[[u8; 2]], sink: &mut Sink<'_>) -> usize {
        let mut rest = words;
        loop {
            let done = self.stretch(rest, sink);
            rest = rest.get(done..).unwrap_or_default();
            let between = rest.get(..Self::BETWEEN).unwrap_or(rest);
            let done = self.one_by_one(between, sink);
            rest = rest.get(done..).unwrap_or_default();
            if done < Self::BETWEEN {
                return words.len() - rest.len();
            }
        }
    }

    /// Words to take one by one before the kernel is tried again.
    const BETWEEN: usize = 8;

    fn one_by_one(&mut self, words: &[[u8; 2]], sink: &mut Sink<'_>) -> usize {
        let fits =
            |bytes: &&[u8; 2]| sink.room() >= WORD_EVENTS_MAX && self.word(u16::from_le_bytes(**bytes), sink);
        words.iter().take_while(fits).count()
    }

    /// Decodes a steady stretch, if the stream is in one.
    fn stretch(&mut self, words: &[[u8; 2]], sink: &mut Sink<'_>) -> usize {
        let Some(mut steady) = self.state.steady(self.geometry, sink) else { return 0 };
        let done = kernel::run(self.kernel, &mut steady, words, sink.spare());
        let time = |event: &Event| full_time(self.state.time, event.t());
        if let Some([first, .., last] | [first @ last]) = sink.spare().get(..done.events) {
            let (first, last) = (time(first), time(last));
            sink.commit(done.events, first, last);
        }
        self.counters.bytes_decoded += 2 * done.words as u64;
        self.counters.events += done.events as u64;
        self.state.time = full_time(self.state.time, steady.time);
        self.state.row = Some(steady.row);
        self.state.base = steady.base;
        done.words
    }

    /// Decodes one word. False, and nothing is done, when the sink cannot take what it makes.
    fn word(&mut self, word: u16, sink: &mut Sink<'_>) -> bool {
        let payload = word & PAYLOAD;
        let polarity = Polarity::from_bit(word >> POLARITY_SHIFT);
        let outcome = match word >> 12 {
            ADDR_Y => self.set(|state| state.row = Some(word & COORDINATE)),
            VECT_BASE_X => self.set(|state| state.base = Some((word & COORDINATE, polarity))),
            TIME_LOW => self.set(|state| state.time_low(payload)),
            TIME_HIGH => self.set(|state| state.time_high(payload)),
            ADDR_X => self.events(word & COORDINATE, polarity, 1, sink),
            VECT_12 => self.vector(payload, 12, sink),
            VECT_8 => self.vector(payload & 0xFF, 8, sink),
            EXT_TRIGGER => self.trigger(payload, sink),
            OTHERS | CONTINUED_4 | CONTINUED_12 => Outcome::Decoded,
            _ => Outcome::Faulty(Fault::UnknownWord),
        };
        match outcome {
            Outcome::Decoded => self.counters.bytes_decoded += 2,
            Outcome::Faulty(fault) => {
                self.counters.bytes_faulty += 2;
                self.counters.faults.count(fault);
            }
            Outcome::NoRoom => return false,
        }
        true
    }

    fn set(&mut self, change: impl FnOnce(&mut State)) -> Outcome {
        change(&mut self.state);
        Outcome::Decoded
    }

    /// An event at column `x + i` for each bit `i` of `mask`.
    fn events(&mut self, x: u16, polarity: Polarity, mask: u16, sink: &mut Sink<'_>) -> Outcome {
        if self.state.clock != Clock::Set {
            return Outcome::Faulty(Fault::BeforeTime);
        }
        let Some(y) = self.state.row else { return Outcome::Faulty(Fault::BeforeRow) };
        let time = self.state.time;
        let on_sensor = |i: u32| self.geometry.contains(x.saturating_add(i as u16), y);
        if mask != 0 && on_sensor(mask.trailing_zeros()) && !sink.admits(time) {
            return Outcome::NoRoom;
        }
        let mut pushed = 0;
        for i in ones(mask.into()).take_while(|i| on_sensor(*i)) {
            let event = Event::new(time as u32, x.saturating_add(i as u16), y, polarity);
            pushed += u64::from(sink.push(time, event));
        }
        let events = u64::from(mask.count_ones());
        self.counters.events += events;
        self.counters.off_sensor += events - pushed;
        Outcome::Decoded
    }

    /// A vector: the events at the base, which moves on by `width`, also where nothing can be emitted yet.
    fn vector(&mut self, mask: u16, width: u16, sink: &mut Sink<'_>) -> Outcome {
        let (x, polarity) = self.state.base.unwrap_or((0, Polarity::Off));
        let outcome = match self.state.base {
            None if self.state.clock == Clock::Set && self.state.row.is_some() => {
                Outcome::Faulty(Fault::BeforeBase)
            }
            _ => self.events(x, polarity, mask, sink),
        };
        if let (Some((x, _)), true) = (self.state.base.as_mut(), outcome != Outcome::NoRoom) {
            *x = x.saturating_add(width);
        }
        outcome
    }

    fn trigger(&mut self, payload: u16, sink: &mut Sink<'_>) -> Outcome {
        if self.state.clock != Clock::Set {
            return Outcome::Faulty(Fault::BeforeTime);
        }
        let trigger = Trigger {
            t: self.state.time,
            ordinal: self.counters.events - self.counters.off_sensor,
            channel: (payload >> 8) as u8,
            edge: Polarity::from_bit(payload),
        };
        if !sink.push_trigger(trigger) {
            return Outcome::NoRoom;
        }
        self.counters.triggers += 1;
        Outcome::Decoded
    }

    /// Counts a byte without its other half.
    fn drop_carry(&mut self) {
        if self.carry.take().is_some() {
            self.counters.bytes_faulty += 1;
            self.counters.faults.count(Fault::CutShort);
        }
    }
}

/// What became of a word.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Decoded,
    Faulty(Fault),
    NoRoom,
}

impl State {
    /// What a kernel needs, if time and row are known and the sink takes every time that TIME_LOW can tell.
    fn steady(&self, geometry: Geometry, sink: &Sink<'_>) -> Option<Steady> {
        let row = self.row?;
        let high = self.high.value();
        let (earliest, latest) = (high << TIME_BITS, high << TIME_BITS | u64::from(PAYLOAD));
        let steady = Steady {
            geometry,
            time: self.time as u32,
            row,
            base: self.base,
            repeated: word(TIME_HIGH, high as u16),
        };
        (self.clock == Clock::Set && sink.admits(earliest) && sink.admits(latest)).then_some(steady)
    }

    fn time_low(&mut self, low: u16) {
        if matches!(self.clock, Clock::Set | Clock::LostLow) {
            self.clock = Clock::Set;
            self.time = self.high.value() << TIME_BITS | u64::from(low);
        }
    }

    fn time_high(&mut self, reading: u16) {
        let before = self.high.value();
        let high = match self.clock {
            Clock::Lost { near: Some(near) } => self.high.resume(reading.into(), near >> TIME_BITS),
            _ => self.high.push(reading.into()),
        };
        match self.clock {
            Clock::Set if high == before => {}
            Clock::Set | Clock::Unset => {
                self.clock = Clock::Set;
                self.time = high << TIME_BITS;
            }
            Clock::Lost { .. } | Clock::LostLow => self.clock = Clock::LostLow,
        }
    }
}

impl Decode for Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> usize {
        let mut rest = bytes;
        if let (Some(first), Some((&second, tail))) = (self.carry, bytes.split_first()) {
            if self.words(&[[first, second]], sink) == 0 {
                return 0;
            }
            self.carry = None;
            rest = tail;
        }
        let (words, odd) = rest.as_chunks::<2>();
        let done = self.words(words, sink);
        let mut taken = bytes.len() - rest.len() + 2 * done;
        if let (true, [byte]) = (done == words.len(), odd) {
            self.carry = Some(*byte);
            taken += 1;
        }
        taken
    }

    fn finish(&mut self) {
        self.drop_carry();
    }

    /// Time counts as known again after a TIME_HIGH and the TIME_LOW that follows it.
    fn gap(&mut self, near: Option<u64>) {
        self.drop_carry();
        self.state = State { clock: Clock::Lost { near }, row: None, base: None, ..self.state };
    }

    fn now(&self) -> u64 {
        self.state.time
    }

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn pending(&self) -> usize {
        usize::from(self.carry.is_some())
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

/// How many of these bytes, which start anywhere between two words of a stream, a fresh decoder must take to know time,
/// row and base: from there on it gives what a decoder gives that read all before, but for whole wraps of time. `None`
/// where the bytes do not tell. Where they hold no vector, the base is left open: a stream may have none, and one that
/// comes without it is a [`Fault::BeforeBase`].
pub(super) fn settled(bytes: &[u8]) -> Option<usize> {
    let (mut high, mut low, mut row, mut base, mut vectors) = (false, false, false, false, false);
    let mut without_base = None;
    for (i, word) in bytes.as_chunks::<2>().0.iter().enumerate() {
        match u16::from_le_bytes(*word) >> TIME_BITS {
            TIME_HIGH => high = true,
            TIME_LOW => low = high,
            ADDR_Y => row = true,
            VECT_BASE_X => base = true,
            VECT_12 | VECT_8 => vectors = true,
            _ => {}
        }
        if low && row {
            let here = (i + 1) * 2;
            if base {
                return Some(here);
            }
            without_base = without_base.or(Some(here));
        }
    }
    without_base.filter(|_| !vectors)
}

/// Events in, EVT3 bytes out: vectors where events share time, row and polarity in ascending columns.
///
/// Time is kept whole: a start or a silent gap of hours costs two TIME_HIGH words per 2^24 µs of it. A vector is held
/// back until an event comes that cannot join it, or [`finish`](Encode::finish). Vectors are whole (VECT_12, VECT_12,
/// VECT_8), since OpenEB's decoder takes them for granted.
///
/// Refused are a start beyond 2^40 µs, coordinates beyond 2047, and steps back in time of more than 2^23 µs or across
/// a multiple of 2^24 µs, which a decoder would read as wraps.
///
/// ```
/// use lobula_core::{Encode, Event, Geometry, Polarity, Span, wire::evt3::Encoder};
/// let events = [Event::new(4098, 5, 7, Polarity::On)];
/// let span = Span { t_first: 4098, t_last: 4098, geometry: Geometry::new(1280, 720), events: &events };
/// let mut bytes = [0; 16];
/// let mut encoder = Encoder::new();
/// let encoded = encoder.encode(span, &mut bytes);
/// let end = encoded.bytes + encoder.finish(&mut bytes[encoded.bytes..]);
/// assert_eq!(bytes[..end], [0x01, 0x80, 0x02, 0x60, 0x07, 0x00, 0x05, 0x28]);
/// ```
#[derive(Clone, Debug, Default)]
pub struct Encoder {
    /// What a decoder knows once it has read what is written and owed.
    decoder: Mirror,
    /// Time of the last event or trigger taken.
    t_last: Option<u64>,
    /// Events taken that others may still join.
    open: Option<Run>,
    /// What is closed and not written yet.
    owed: Owed,
    /// The second byte of a word whose first is written.
    carry: Option<u8>,
}

#[derive(Clone, Debug)]
struct Mirror {
    /// Bits 12 and up of the time.
    high: Option<u64>,
    /// The time, once its TIME_LOW has followed.
    time: Option<u64>,
    /// The row, [`Mirror::NO_ROW`] before the first: looked at for every event, which an option would make two looks.
    row: u16,
    /// Column and polarity of the next vector, as long as time and row stay.
    base: Option<(u16, Polarity)>,
}

/// Events of one time, row and polarity in ascending columns.
#[derive(Clone, Copy, Debug)]
struct Run {
    t: u64,
    y: u16,
    polarity: Polarity,
    /// The first column.
    x: u16,
    /// Which of the columns from the first on have an event.
    mask: u32,
}

/// Words to be written once a decoder knows their time: at most ADDR_Y and four more.
#[derive(Clone, Copy, Debug, Default)]
struct Owed {
    t: u64,
    /// The words, the first one lowest.
    words: u128,
    len: usize,
}

impl Encoder {
    /// Latest time of a first event, in µs: the words for the wraps before it fill 256 KiB.
    pub const START_MAX_US: u64 = 1 << 40;
    /// Largest step back of TIME_HIGH that is not a wrap.
    const STEP_BACK_MAX: u64 = 1 << (TIME_BITS - 1);

    /// An encoder at the start of a stream.
    pub fn new() -> Self {
        Self::default()
    }

    fn refuse(&self, t: u64, event: Event) -> Option<Refused> {
        let (x, y) = (event.x(), event.y());
        if x > COORDINATE || y > COORDINATE { Some(Refused::OffFormat { x, y }) } else { self.refuse_time(t) }
    }

    fn refuse_trigger(&self, trigger: Trigger) -> Option<Refused> {
        let Trigger { t, channel, .. } = trigger;
        if channel > CHANNEL_MAX { Some(Refused::NoChannel { channel }) } else { self.refuse_time(t) }
    }

    fn refuse_time(&self, t: u64) -> Option<Refused> {
        let Some(from) = self.t_last else {
            return (t > Self::START_MAX_US).then_some(Refused::StartTooLate { t });
        };
        let (before, high) = (from >> TIME_BITS, t >> TIME_BITS);
        let wraps = before >> TIME_BITS != high >> TIME_BITS || before.abs_diff(high) > Self::STEP_BACK_MAX;
        (high < before && wraps).then_some(Refused::StepBack { from, to: t })
    }

    /// Adds an event to the open run, if it belongs to it.
    #[inline]
    fn join(&mut self, t: u64, event: Event) -> bool {
        self.open.as_mut().is_some_and(|run| run.join(t, event))
    }

    /// Opens a run, after the one before was flushed.
    #[inline]
    fn open(&mut self, t: u64, event: Event) {
        let run = Run { t, y: event.y(), polarity: event.polarity(), x: event.x(), mask: 1 };
        if self.t_last != Some(t) || self.decoder.row != run.y {
            self.decoder.base = None;
        }
        self.open = Some(run);
        self.t_last = Some(t);
    }

    /// Closes and writes the open run in the most likely case: a single event, of a time that is told. False, and
    /// nothing is done, in any other.
    #[inline]
    fn flush_single(&mut self, out: &mut Out<'_>) -> bool {
        let Some(run) = self.open.filter(|run| run.mask == 1 && self.decoder.time == Some(run.t)) else {
            return false;
        };
        if self.owed.len > 0 || self.carry.is_some() {
            return false;
        }
        let single = u32::from(word(ADDR_X, (run.polarity as u16) << POLARITY_SHIFT | run.x));
        let new_row = self.decoder.row != run.y;
        let words = if new_row { u32::from(word(ADDR_Y, run.y)) | single << 16 } else { single };
        if !out.put_some(words.to_le_bytes(), if new_row { 4 } else { 2 }) {
            return false;
        }
        self.decoder.row = run.y;
        self.open = None;
        true
    }

    /// Closes the open run and writes everything. False when `out` ends before it does.
    fn flush(&mut self, out: &mut Out<'_>) -> bool {
        if !self.drain(out) {
            return false;
        }
        let Some(run) = self.open.take() else { return true };
        self.owed = self.decoder.words(run);
        self.drain(out)
    }

    /// Writes what is owed. False when `out` ends before it does.
    fn drain(&mut self, out: &mut Out<'_>) -> bool {
        if let Some(byte) = self.carry.take() {
            self.carry = out.put(&[byte]).err();
        }
        while self.owed.len > 0 && self.carry.is_none() && !out.is_full() {
            if let Some(word) = self.decoder.next_time(self.owed.t) {
                self.carry = out.put(&word.to_le_bytes()).err();
            } else if out.put_some(self.owed.words.to_le_bytes(), 2 * self.owed.len) {
                self.owed.len = 0;
            } else {
                self.carry = out.put(&self.owed.pop().to_le_bytes()).err();
            }
        }
        self.owed.len == 0 && self.carry.is_none()
    }
}

/// Where an encoder writes.
struct Out<'a> {
    bytes: &'a mut [u8],
    len: usize,
}

impl<'a> Out<'a> {
    fn new(bytes: &'a mut [u8]) -> Self {
        Self { bytes, len: 0 }
    }

    fn is_full(&self) -> bool {
        self.len >= self.bytes.len()
    }

    /// Writes what fits; what does not is the last byte.
    fn put(&mut self, bytes: &[u8]) -> Result<(), u8> {
        for byte in bytes {
            *self.bytes.get_mut(self.len).ok_or(*byte)? = *byte;
            self.len += 1;
        }
        Ok(())
    }

    /// Writes `bytes`, of which `len` count. False, and nothing is done, without room for them all.
    #[inline]
    fn put_some<const N: usize>(&mut self, bytes: [u8; N], len: usize) -> bool {
        let room = self.bytes.get_mut(self.len..).and_then(|room| room.first_chunk_mut());
        let written = room.map(|room| *room = bytes).is_some();
        self.len += if written { len } else { 0 };
        written
    }
}

impl Run {
    /// Columns of the vectors after a base: the bits of a mask.
    const COLUMNS: u16 = 32;

    /// Adds an event if it belongs to the run.
    fn join(&mut self, t: u64, event: Event) -> bool {
        let column = event.x().wrapping_sub(self.x);
        // All at once, without a branch for each.
        let together = (self.t == t) & (self.y == event.y()) & (self.polarity == event.polarity());
        let joins = together & (event.x() <= COORDINATE) && self.mask.checked_shr(column.into()) == Some(0);
        if joins {
            self.mask |= 1 << column;
        }
        joins
    }
}

impl Owed {
    #[inline]
    fn push(&mut self, word: u16) {
        self.words |= u128::from(word).wrapping_shl(16 * self.len as u32);
        self.len += 1;
    }

    fn pop(&mut self) -> u16 {
        let word = self.words as u16;
        self.words >>= 16;
        self.len -= 1;
        word
    }
}

impl Default for Mirror {
    fn default() -> Self {
        Self { high: None, time: None, row: Self::NO_ROW, base: None }
    }
}

impl Mirror {
    const NO_ROW: u16 = u16::MAX;

    /// The words of a run, without those of its time: vectors where they are no more words than single events.
    fn words(&mut self, run: Run) -> Owed {
        let mut owed = Owed { t: run.t, ..Owed::default() };
        if core::mem::replace(&mut self.row, run.y) != run.y {
            owed.push(word(ADDR_Y, run.y));
        }
        let at = |x: u16| (run.polarity as u16) << POLARITY_SHIFT | x;
        let follows = self.base == Some((run.x, run.polarity));
        if run.mask.count_ones() < 3 + u32::from(!follows) {
            ones(run.mask).for_each(|i| owed.push(word(ADDR_X, at(run.x + i as u16))));
            return owed;
        }
        if !follows {
            owed.push(word(VECT_BASE_X, at(run.x)));
        }
        owed.push(word(VECT_12, run.mask as u16));
        owed.push(word(VECT_12, (run.mask >> 12) as u16));
        owed.push(word(VECT_8, (run.mask >> 24) as u16));
        self.base = Some((run.x + Run::COLUMNS, run.polarity));
        owed
    }

    /// The next word on the way to time `t`, over 0xFFF and 0 at each wrap. A TIME_LOW comes after every TIME_HIGH,
    /// since some decoders keep the low bits over it.
    #[inline]
    fn next_time(&mut self, t: u64) -> Option<u16> {
        let high = t >> TIME_BITS;
        if self.time == Some(t) {
            None
        } else if self.high == Some(high) {
            self.time = Some(t);
            Some(word(TIME_LOW, t as u16))
        } else {
            Some(self.next_high(high))
        }
    }

    fn next_high(&mut self, high: u64) -> u16 {
        let at = self.high.unwrap_or_default();
        let next = if at >> TIME_BITS == high >> TIME_BITS {
            high
        } else if at as u16 & PAYLOAD == PAYLOAD {
            at + 1
        } else {
            at | u64::from(PAYLOAD)
        };
        (self.high, self.time) = (Some(next), None);
        word(TIME_HIGH, next as u16)
    }
}

impl Encode for Encoder {
    fn encode(&mut self, span: Span<'_>, out: &mut [u8]) -> Encoded {
        let mut out = Out::new(out);
        let mut events = 0;
        let mut refused = None;
        for event in span.events {
            let t = span.time(*event);
            if !self.join(t, *event) {
                refused = self.refuse(t, *event);
                if refused.is_some() || !(self.flush_single(&mut out) || self.flush(&mut out)) {
                    break;
                }
                self.open(t, *event);
            }
            events += 1;
        }
        Encoded { events, bytes: out.len, refused }
    }

    fn trigger(&mut self, trigger: Trigger, out: &mut [u8]) -> Encoded {
        let mut out = Out::new(out);
        let refused = self.refuse_trigger(trigger);
        let taken = refused.is_none() && self.flush(&mut out);
        if taken {
            let payload = u16::from(trigger.channel) << CHANNEL_SHIFT | trigger.edge as u16;
            self.owed = Owed { t: trigger.t, ..Owed::default() };
            self.owed.push(word(EXT_TRIGGER, payload));
            self.t_last = Some(trigger.t);
            self.drain(&mut out);
        }
        Encoded { events: taken.into(), bytes: out.len, refused }
    }

    fn finish(&mut self, out: &mut [u8]) -> usize {
        let mut out = Out::new(out);
        self.flush(&mut out);
        out.len
    }
}
