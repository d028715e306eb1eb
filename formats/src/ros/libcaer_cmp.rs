//! `libcaer_cmp`: the compressed encoding of iniVation cameras in ROS 2, columns with vectors of 8 rows.
//!
//! Spec: <https://github.com/ros-event-camera/libcaer_driver>, whose `compression_tokens.hpp` has the words, and
//! event_camera_codecs, whose decoder has their meaning.
//!
//! ```text
//!  15..12  word (16-bit little-endian)   11..0
//!  0       TIME_HIGH    bits 23..12 of the time in µs since the message's time_base
//!  1       TIME_LOW     bits 11..0 of it
//!  2       ADDR_X       10..0: column of what comes after it
//!  3       ADDR_Y       11: polarity, 10..0: row: one event
//!  4       VECT_BASE_Y  11: polarity, 10..0: row of the vectors after it
//!  5       VECT_8       7..0: an event at base + i for each bit i; then base += 8
//! ```
//!
//! Every message begins at its time_base, so that one lost harms no other.

use crate::byte_cursor::{Bad, Step};
use crate::intake::{Intake, Taken};
use lobula_core::{Fault, Sink, Unwrap};

const WORD_BYTES: usize = 2;
const TIME_HIGH: u16 = 0;
const TIME_LOW: u16 = 1;
const ADDR_X: u16 = 2;
const ADDR_Y: u16 = 3;
const VECT_BASE_Y: u16 = 4;
const VECT_8: u16 = 5;
/// Bits of a coordinate.
const COORDINATE: u16 = 0x7FF;
/// Bits of a word beside its kind.
const PAYLOAD: u16 = 0xFFF;
/// Bits of the time in a word.
const TIME_BITS: u32 = 12;
/// Bit of the polarity.
const ON: u16 = 1 << 11;
/// Most events of a word.
const WORD_EVENTS_MAX: usize = 8;

/// Words in, events out.
#[derive(Clone, Debug)]
pub(crate) struct Decoder {
    pub intake: Intake,
    base_us: i64,
    high: Unwrap<TIME_BITS>,
    low: u16,
    column: Option<u16>,
    /// Row and polarity of the next vector.
    base: Option<(u16, bool)>,
}

impl Decoder {
    pub fn new(intake: Intake) -> Self {
        Self { intake, base_us: 0, high: Unwrap::near(0), low: 0, column: None, base: None }
    }

    /// A message begins.
    pub fn begin(&mut self, time_base_ns: u64) {
        *self = Self::new(self.intake.clone());
        self.base_us = (time_base_ns / 1000) as i64;
    }

    /// Decodes whole words.
    pub fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        let (words, _) = bytes.as_chunks::<WORD_BYTES>();
        for (i, word) in words.iter().enumerate() {
            let offset = i * WORD_BYTES;
            let taken = self.word(u16::from_le_bytes(*word), sink);
            if taken.map_err(|bad| Bad { offset, ..bad })? == Taken::Full {
                return Ok(Step { taken: offset, full: true });
            }
        }
        Ok(Step { taken: words.len() * WORD_BYTES, full: false })
    }

    fn word(&mut self, word: u16, sink: &mut Sink<'_>) -> Result<Taken, Bad> {
        let done = match word >> TIME_BITS {
            TIME_HIGH => {
                self.high.push(u64::from(word & PAYLOAD));
                Ok(Taken::Yes)
            }
            TIME_LOW => {
                self.low = word & PAYLOAD;
                Ok(Taken::Yes)
            }
            ADDR_X => {
                self.column = Some(word & COORDINATE);
                Ok(Taken::Yes)
            }
            ADDR_Y => self.events(word & COORDINATE, word & ON != 0, 1, sink)?,
            VECT_BASE_Y => {
                self.base = Some((word & COORDINATE, word & ON != 0));
                Ok(Taken::Yes)
            }
            VECT_8 => self.vector(word, sink)?,
            _ => Err(Fault::UnknownWord),
        };
        match done {
            Ok(Taken::Full) => return Ok(Taken::Full),
            Ok(Taken::Yes) => self.intake.other(WORD_BYTES as u64),
            Err(fault) => self.intake.fault(fault, WORD_BYTES as u64),
        }
        Ok(Taken::Yes)
    }

    fn vector(&mut self, word: u16, sink: &mut Sink<'_>) -> Result<Result<Taken, Fault>, Bad> {
        let Some((row, on)) = self.base else { return Ok(Err(Fault::BeforeBase)) };
        let done = self.events(row, on, word as u8, sink)?;
        if done == Ok(Taken::Yes) {
            self.base = Some((row.saturating_add(8), on));
        }
        Ok(done)
    }

    /// Events at `row + i` for each bit i; all of them or, where the sink may not take them, none.
    #[inline]
    fn events(
        &mut self,
        row: u16,
        on: bool,
        mut bits: u8,
        sink: &mut Sink<'_>,
    ) -> Result<Result<Taken, Fault>, Bad> {
        let Some(x) = self.column else { return Ok(Err(Fault::BeforeRow)) };
        let t = self.base_us.saturating_add((self.high.value() << TIME_BITS | u64::from(self.low)) as i64);
        if sink.room() < WORD_EVENTS_MAX || !sink.admits(self.intake.time(t)?) {
            return Ok(Ok(Taken::Full));
        }
        while bits != 0 {
            let y = i64::from(row) + i64::from(bits.trailing_zeros());
            self.intake.push(sink, t, (x.into(), y), on, 0)?;
            bits &= bits - 1;
        }
        Ok(Ok(Taken::Yes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::OpenOptions;
    use lobula_core::{Event, Geometry};

    /// Decodes a message in pieces; its events and faults in words.
    fn told(words: &[u16], piece: usize) -> String {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let geometry = Geometry::new(346, 260);
        let mut decoder = Decoder::new(Intake::new(geometry, &OpenOptions::default()));
        decoder.begin(5_000_999);
        let (mut at, mut end) = (0, 0);
        let mut told = Vec::new();
        let mut memory = [Event::default(); Sink::LEN_MIN];
        while end < bytes.len() || at < end {
            end = (end + piece).min(bytes.len());
            let mut sink = Sink::new(&mut memory);
            at += decoder.decode(&bytes[at..end], &mut sink).unwrap().taken;
            let block = sink.block(geometry);
            let span = block.span();
            let tell = |e: &Event| format!("{} {} {} {}", span.time(*e), e.x(), e.y(), u8::from(e.is_on()));
            told.extend(span.events.iter().map(tell));
        }
        let counters = decoder.intake.counters;
        if counters.faults.total() > 0 || counters.off_sensor > 0 {
            told.push(format!("faults {:?} off {}", counters.faults, counters.off_sensor));
        }
        assert_eq!(counters.bytes_decoded + counters.bytes_faulty, bytes.len() as u64);
        told.join(", ")
    }

    #[track_caller]
    fn check(words: &[u16], expected: &str) {
        for piece in [2, 3, 7, 1000] {
            assert_eq!(told(words, piece), expected, "in pieces of {piece}");
        }
    }

    #[test]
    fn single_events_and_vectors() {
        check(&[0x2003, 0x3805, 0x1010, 0x3006], "5000 3 5 1, 5016 3 6 0");
        check(&[0x2003, 0x4808, 0x5081, 0x5001], "5000 3 8 1, 5000 3 15 1, 5000 3 16 1");
        check(&[0x2003, 0x0002, 0x1001, 0x3004], "13193 3 4 0");
    }

    #[test]
    fn time_high_wraps_beyond_half_its_range() {
        check(&[0x2001, 0x0FFF, 0x3002, 0x0000, 0x3002], "16778120 1 2 0, 16782216 1 2 0");
    }

    #[test]
    fn what_cannot_be_placed_is_counted() {
        check(&[0x3001, 0x5001, 0x6000, 0xF000], "faults Faults([2, 0, 1, 1, 0, 0]) off 0");
        check(
            &[0x2001, 0x30FF, 0x3104, 0x2200, 0x3001],
            "5000 1 255 0, faults Faults([0, 0, 0, 0, 0, 0]) off 2",
        );
    }
}
