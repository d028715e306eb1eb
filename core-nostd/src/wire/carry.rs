//! Words out of bytes, and words into bytes: what makes every decoder and encoder resumable at any byte.

use super::time_high::{self, ClockOut};
use crate::{Counters, Encoded, Event, Fault, Refused, Sink, Span, Trigger};

/// The bytes of a word of `N` bytes whose rest is still to come.
#[derive(Clone, Copy, Debug)]
pub(super) struct Carry<const N: usize> {
    bytes: [u8; N],
    len: usize,
}

impl<const N: usize> Carry<N> {
    pub(super) const fn new() -> Self {
        Self { bytes: [0; N], len: 0 }
    }

    /// Number of bytes held, less than `N`.
    pub(super) const fn len(&self) -> usize {
        self.len
    }

    /// Adds from `bytes` what fits; the word if it is complete now, and how many bytes that took. The carry itself is
    /// left as it is: the word may yet be refused.
    fn joined(&self, bytes: &[u8]) -> (Self, usize) {
        let mut joined = *self;
        let mut used = 0;
        for (slot, byte) in joined.bytes.iter_mut().skip(self.len).zip(bytes) {
            *slot = *byte;
            used += 1;
        }
        joined.len += used;
        (joined, used)
    }

    /// The word will never be complete: its bytes become a fault.
    pub(super) fn cut_short(&mut self, counters: &mut Counters) {
        if self.len > 0 {
            counters.faults.count(Fault::CutShort);
            counters.bytes_faulty += self.len as u64;
            self.len = 0;
        }
    }
}

/// Counts a word of so many bytes by what became of it; false for one that the sink did not take.
#[inline]
pub(super) fn count(taken: Result<bool, Fault>, bytes: usize, counters: &mut Counters) -> bool {
    match taken {
        Ok(true) => counters.bytes_decoded += bytes as u64,
        Ok(false) => return false,
        Err(fault) => {
            counters.faults.count(fault);
            counters.bytes_faulty += bytes as u64;
        }
    }
    true
}

/// A decoder of words of `N` bytes.
pub(super) trait Words<const N: usize> {
    fn carry(&mut self) -> &mut Carry<N>;

    /// Decodes whole words and returns how many were taken; fewer than given means that the sink takes no more.
    fn words(&mut self, words: &[[u8; N]], sink: &mut Sink<'_>) -> usize;
}

/// [`Decode::decode`](crate::Decode::decode) for a decoder of words: completes the word begun before, takes the
/// whole words in place, keeps the rest.
#[inline]
pub(super) fn decode<const N: usize>(
    decoder: &mut impl Words<N>,
    bytes: &[u8],
    sink: &mut Sink<'_>,
) -> usize {
    let mut taken = 0;
    if decoder.carry().len > 0 {
        let (joined, used) = decoder.carry().joined(bytes);
        if joined.len < N {
            *decoder.carry() = joined;
            return used;
        }
        if decoder.words(&[joined.bytes], sink) == 0 {
            return 0;
        }
        *decoder.carry() = Carry::new();
        taken = used;
    }
    let (words, tail) = bytes.get(taken..).unwrap_or_default().as_chunks();
    let done = decoder.words(words, sink);
    taken += done * N;
    if done == words.len() {
        *decoder.carry() = Carry::new().joined(tail).0;
        taken += tail.len();
    }
    taken
}

/// Words into bytes: the rest of a word that did not fit the caller's buffer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held<const N: usize> {
    bytes: [u8; N],
    /// Where the bytes still to write begin; `N` when none are.
    from: usize,
}

impl<const N: usize> Held<N> {
    pub(super) const fn new() -> Self {
        Self { bytes: [0; N], from: N }
    }

    /// Holds a word, after the one before was [written](Self::write).
    pub(super) const fn set(&mut self, word: [u8; N]) {
        self.bytes = word;
        self.from = 0;
    }

    /// Writes what is held to `out` from `at` on as far as it goes, and moves `at`. Whether nothing is left.
    #[inline]
    pub(super) fn write(&mut self, out: &mut [u8], at: &mut usize) -> bool {
        let room = out.get_mut(*at..).unwrap_or_default();
        let rest = self.bytes.get(self.from..).unwrap_or_default();
        let n = rest.len().min(room.len());
        for (to, byte) in room.iter_mut().zip(rest) {
            *to = *byte;
        }
        *at += n;
        self.from += n;
        self.from == N
    }
}

/// An encoder that goes word by word, each held until it is written.
pub(super) trait Steps {
    /// Types of words.
    const TIME_HIGH: u32;
    const EXT_TRIGGER: u32;

    fn clock(&mut self) -> &mut ClockOut;

    /// Holds a word that has no mask.
    fn hold(&mut self, word: u32);

    /// Writes what is held to `out` from `at` on as far as it goes, and moves `at`. Whether nothing is left.
    fn write(&mut self, out: &mut [u8], at: &mut usize) -> bool;

    /// One step toward an event: it is taken (true), or a word that must come before it is held to be sent.
    fn step(&mut self, t: u64, event: Event) -> Result<bool, Refused>;

    /// Holds a word still open to be sent; whether there was one.
    #[inline]
    fn close(&mut self) -> bool {
        false
    }

    /// The same as [`step`](Self::step) toward a trigger.
    fn step_trigger(&mut self, trigger: Trigger) -> Result<bool, Refused> {
        let word = time_high::trigger_word(Self::EXT_TRIGGER, trigger)?;
        let ready = self.ready(trigger.t)?;
        if ready {
            self.hold(word);
        }
        Ok(ready)
    }

    /// Whether a word of time `t` may come next; else the word that must come before it is held to be sent.
    #[inline]
    fn ready(&mut self, t: u64) -> Result<bool, Refused> {
        if self.close() {
            return Ok(false);
        }
        let time_high = self.clock().toward(t)?;
        if let Some(reading) = time_high {
            self.hold(Self::TIME_HIGH << 28 | reading as u32);
        }
        Ok(time_high.is_none())
    }
}

/// [`Encode::encode`](crate::Encode::encode) for an encoder that goes word by word.
#[inline]
pub(super) fn encode(encoder: &mut impl Steps, span: Span<'_>, out: &mut [u8]) -> Encoded {
    let mut done = Encoded { events: 0, bytes: 0, refused: None };
    for event in span.events {
        loop {
            if !encoder.write(out, &mut done.bytes) {
                return done;
            }
            match encoder.step(span.time(*event), *event) {
                Ok(true) => break,
                Ok(false) => {}
                Err(refused) => return Encoded { refused: Some(refused), ..done },
            }
        }
        done.events += 1;
    }
    encoder.write(out, &mut done.bytes);
    done
}

/// [`Encode::trigger`](crate::Encode::trigger) for one.
#[inline]
pub(super) fn encode_trigger(encoder: &mut impl Steps, trigger: Trigger, out: &mut [u8]) -> Encoded {
    let mut done = Encoded { events: 0, bytes: 0, refused: None };
    while done.events == 0 && encoder.write(out, &mut done.bytes) {
        match encoder.step_trigger(trigger) {
            Ok(taken) => done.events = taken.into(),
            Err(refused) => return Encoded { refused: Some(refused), ..done },
        }
    }
    encoder.write(out, &mut done.bytes);
    done
}

/// [`Encode::finish`](crate::Encode::finish) for one.
#[inline]
pub(super) fn finish(encoder: &mut impl Steps, out: &mut [u8]) -> usize {
    let mut bytes = 0;
    if encoder.write(out, &mut bytes) && encoder.close() {
        encoder.write(out, &mut bytes);
    }
    bytes
}
