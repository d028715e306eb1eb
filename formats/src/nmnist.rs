//! N-MNIST and N-Caltech101: bare events of five bytes, without a header.
//!
//! Spec: Orchard et al. 2015, <https://www.garrickorchard.com/datasets/n-mnist>, with its `Read_Ndataset.m`
//!
//! ```text
//! big-endian 40 bits:  xxxxxxxx yyyyyyyy p ttttttttttttttttttttttt     t in µs
//! y = 240 is no event: 2^13 µs are added to every time after it
//! ```
//!
//! Nothing in such a file says what it is: it goes by its name, `.bin`, and a length of whole events.

use crate::byte_cursor::{Bad, ByteCursor, ByteDecoder, Step};
use crate::container::{Container, Cursor};
use crate::input::Input;
use crate::intake::{Intake, Taken};
use crate::open::Probe;
use crate::{Error, Format, OpenOptions};
use lobula_core::{Counters, Geometry, Sink};
use std::sync::Arc;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format = Format { name: "N-MNIST", extensions: &["bin"], create: None, probe, open };

/// Bytes of an event.
const EVENT_BYTES: usize = 5;
/// Largest sensor that eight bits of x, and y below the mark, can tell.
const GEOMETRY_MAX: Geometry = Geometry::new(256, OVERFLOW_Y as u16);
/// Row that marks an overflow of time.
const OVERFLOW_Y: u8 = 240;
/// What an overflow adds, in µs.
const OVERFLOW_US: i64 = 1 << 13;

fn probe(probe: &Probe<'_>) -> bool {
    probe.has_extension(&FORMAT) && probe.bytes.is_multiple_of(EVENT_BYTES as u64)
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let intake = Intake::new(options.sensor_size.unwrap_or(GEOMETRY_MAX), options);
    let decoder = Decoder { intake, overflow_us: 0 };
    Ok(Box::new(NmnistRecording { input, geometry: options.sensor_size, decoder }))
}

#[derive(Debug)]
struct NmnistRecording {
    input: Arc<Input>,
    geometry: Option<Geometry>,
    /// At the first event.
    decoder: Decoder,
}

impl Container for NmnistRecording {
    fn geometry(&self) -> Option<Geometry> {
        self.geometry
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.decoder.intake.geometry()
    }

    fn start(&self) -> Box<dyn Cursor> {
        Box::new(ByteCursor::new(self.input.clone(), 0..self.input.len(), self.decoder.clone()))
    }
}

#[derive(Clone, Debug)]
struct Decoder {
    intake: Intake,
    /// Added to the times of events so far.
    overflow_us: i64,
}

impl ByteDecoder for Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        for (i, event) in bytes.as_chunks::<EVENT_BYTES>().0.iter().enumerate() {
            let [x, y, p_t2, t1, t0] = *event;
            if y == OVERFLOW_Y {
                self.overflow_us += OVERFLOW_US;
                self.intake.other(EVENT_BYTES as u64);
                continue;
            }
            let t = self.overflow_us + i64::from(u32::from_be_bytes([0, p_t2 & 0x7F, t1, t0]));
            let taken = self.intake.push(sink, t, (x.into(), y.into()), p_t2 >> 7 == 1, EVENT_BYTES as u64);
            let offset = i * EVENT_BYTES;
            if taken.map_err(|bad| Bad { offset, ..bad })? == Taken::Full {
                return Ok(Step { taken: offset, full: true });
            }
        }
        Ok(Step { taken: bytes.len() / EVENT_BYTES * EVENT_BYTES, full: false })
    }

    fn finish(&mut self, unread: &[u8]) {
        self.intake.cut_short(unread);
    }

    fn counters(&self) -> Counters {
        self.intake.counters
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open_with;
    use lobula_core::{Event, Polarity};

    /// Bits spelt out as in the specification.
    fn word(x: u64, y: u64, p: u64, t: u64) -> [u8; 5] {
        let word = (x << 32) | (y << 24) | (p << 23) | t;
        *word.to_be_bytes().last_chunk().unwrap()
    }

    #[test]
    fn events_and_overflows() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("00001.bin");
        let words = [word(33, 32, 1, 5), word(0, 0, 0, 0x7F_FFFF), word(9, 240, 1, 0), word(1, 2, 1, 7)];
        std::fs::write(&path, words.as_flattened()).unwrap();
        let recording = open_with(&path, &OpenOptions::default()).unwrap();
        assert_eq!((recording.format().name, recording.geometry()), ("N-MNIST", None));
        let mut blocks = recording.blocks();
        let found = blocks.next_block().unwrap().unwrap().block.span().events.to_vec();
        let expected = [
            Event::new(5, 33, 32, Polarity::On),
            Event::new(0x7F_FFFF, 0, 0, Polarity::Off),
            Event::new(8192 + 7, 1, 2, Polarity::On),
        ];
        assert_eq!(found, expected);
        assert_eq!((blocks.counters().events, blocks.counters().bytes_decoded), (3, 20));
    }
}
