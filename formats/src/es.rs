//! Event Stream: a header of 16 or 20 bytes, then events of five bytes, each with the µs since the one before.
//!
//! Spec: <https://github.com/neuromorphicsystems/event_stream>, version 2
//!
//! ```text
//! "Event Stream"  u8[3] version: 2.x.y  u8 type: 0 generic, 1 DVS, 2 ATIS, 4 colour  u16 width  u16 height
//! DVS   ddddddd p  u16 x  u16 y     d: µs since the event before; p: 1 = ON; y counts from the bottom
//!       11111111                    127 µs pass
//!       11111110                    nothing
//! ```
//!
//! Of ATIS files the brightness changes are read; exposure measurements are counted beside them and not read. Colour
//! and generic files hold no events and are refused.

use crate::byte_cursor::{Bad, ByteCursor, ByteDecoder, Step};
use crate::container::{Container, Cursor};
use crate::input::Input;
use crate::intake::{Intake, Taken};
use crate::open::Probe;
use crate::{Error, ErrorKind, Format, OpenOptions, Stream, StreamKind};
use lobula_core::{Counters, Geometry, Sink};
use std::sync::Arc;

mod write;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format =
    Format { name: "Event Stream", extensions: &["es"], create: Some(write::create), probe, open };

/// First bytes of a file.
const MAGIC: &[u8; 12] = b"Event Stream";
/// Version that is read and written; the last number is of corrections.
const VERSION: [u8; 3] = [2, 0, 0];
const DVS: u8 = 1;
const ATIS: u8 = 2;
/// Bytes of the header.
const HEADER_BYTES: u64 = 20;
/// Bytes of an event.
const EVENT_BYTES: usize = 5;
/// A byte in place of an event: so many µs pass.
const OVERFLOW: u8 = 0xFF;
const OVERFLOW_US: u64 = 127;
/// A byte in place of an event: nothing.
const RESET: u8 = 0xFE;

fn probe(probe: &Probe<'_>) -> bool {
    probe.head.starts_with(MAGIC)
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let path = input.path();
    let mut head = [0; HEADER_BYTES as usize];
    let cut = input.read_at(0, &mut head)? < head.len();
    let unsupported =
        |what: String, remedy| Err(Error::new(ErrorKind::Unsupported, path, what, remedy).at(12));
    let [.., major, minor, patch, kind, w0, w1, h0, h1] = head;
    if !cut && major != VERSION[0] {
        let what = format!("is of version {major}.{minor}.{patch}, and 2 is read,");
        return unsupported(what, "convert it with the event_stream tools");
    }
    let is_atis = match kind {
        _ if cut => {
            let what = "ends inside its header";
            let remedy = "copy it again from where it was recorded";
            return Err(Error::new(ErrorKind::Malformed, path, what, remedy).at(input.len()));
        }
        DVS => false,
        ATIS => true,
        0 => return unsupported("holds generic data and no events,".into(), "open a file of DVS events"),
        4 => {
            return unsupported(
                "holds colour events, which are not read,".into(),
                "open a file of DVS events",
            );
        }
        _ => {
            return unsupported(
                format!("holds data of the unknown type {kind}"),
                "open a file of DVS events",
            );
        }
    };
    let told = Geometry::new(u16::from_le_bytes([w0, w1]), u16::from_le_bytes([h0, h1]));
    let limit = options.limits.sensor_side_px_max;
    if told.width == 0 || told.height == 0 || told.width > limit || told.height > limit {
        let what = format!("has the sensor size {told}, not 1 to {limit} pixels a side,");
        let remedy = "copy it again from where it was recorded";
        return Err(Error::new(ErrorKind::TooLarge, path, what, remedy).at(16));
    }
    let intake = Intake::new(options.sensor_size.unwrap_or(told), options);
    let decoder = Decoder { intake, is_atis, height: told.height, t: 0 };
    Ok(Box::new(EsRecording { input, decoder }))
}

#[derive(Debug)]
struct EsRecording {
    input: Arc<Input>,
    /// At the first event.
    decoder: Decoder,
}

impl Container for EsRecording {
    fn geometry(&self) -> Option<Geometry> {
        Some(self.decoder.intake.geometry())
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.decoder.intake.geometry()
    }

    fn streams(&self) -> Vec<Stream> {
        let exposures = self.decoder.is_atis.then(|| Stream::new(StreamKind::Other, "exposures"));
        [Stream::new(StreamKind::Events, "")].into_iter().chain(exposures).collect()
    }

    fn warnings(&self) -> Vec<String> {
        let warning = || "it is an ATIS file, of which the exposure measurements are not read".to_owned();
        self.decoder.is_atis.then(warning).into_iter().collect()
    }

    fn start(&self) -> Box<dyn Cursor> {
        let range = HEADER_BYTES..self.input.len();
        Box::new(ByteCursor::new(self.input.clone(), range, self.decoder.clone()))
    }
}

#[derive(Clone, Debug)]
struct Decoder {
    intake: Intake,
    is_atis: bool,
    /// Rows of the sensor that the file tells, by which y is turned over.
    height: u16,
    /// Time of the last event or overflow.
    t: u64,
}

/// What the first byte of an event or the byte in place of one means.
enum First {
    /// So many µs pass, and there is no event.
    Pass(u64),
    /// An event after so many µs: ON, OFF, or no brightness change.
    Event(u64, Option<bool>),
}

impl Decoder {
    fn first(&self, byte: u8) -> First {
        match byte {
            _ if self.is_atis && byte >= 0b1111_1100 => First::Pass(u64::from(byte & 0b11) * 63),
            _ if self.is_atis => {
                let change = (byte & 1 == 0).then_some(byte & 0b10 != 0);
                First::Event((byte >> 2).into(), change)
            }
            OVERFLOW => First::Pass(OVERFLOW_US),
            RESET => First::Pass(0),
            _ => First::Event((byte >> 1).into(), Some(byte & 1 == 1)),
        }
    }
}

impl ByteDecoder for Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        let mut done = 0;
        while let Some(byte) = bytes.get(done) {
            match self.first(*byte) {
                First::Pass(us) => {
                    self.t = self.t.saturating_add(us);
                    self.intake.other(1);
                    done += 1;
                }
                First::Event(us, change) => {
                    let Some([_, x0, x1, y0, y1]) = bytes.get(done..).and_then(<[u8]>::first_chunk) else {
                        break;
                    };
                    let t = self.t.saturating_add(us);
                    if let Some(on) = change {
                        let y = i64::from(self.height) - 1 - i64::from(u16::from_le_bytes([*y0, *y1]));
                        let xy = (u16::from_le_bytes([*x0, *x1]).into(), y);
                        let t = i64::try_from(t).unwrap_or(i64::MAX);
                        let taken = self.intake.push(sink, t, xy, on, EVENT_BYTES as u64);
                        if taken.map_err(|bad| Bad { offset: done, ..bad })? == Taken::Full {
                            return Ok(Step { taken: done, full: true });
                        }
                    } else {
                        self.intake.other(EVENT_BYTES as u64);
                    }
                    self.t = t;
                    done += EVENT_BYTES;
                }
            }
        }
        Ok(Step { taken: done, full: false })
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
    use lobula_core::Fault;

    /// A 4x3 file of this type with these bytes: every event as `t x y p`, or the error.
    #[track_caller]
    fn check(kind: u8, bytes: &[u8], expected: &str) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.es");
        let header = [&MAGIC[..], &VERSION, &[kind, 4, 0, 3, 0]].concat();
        std::fs::write(&path, [&header, bytes].concat()).unwrap();
        let recording = match open_with(&path, &OpenOptions::default()) {
            Ok(recording) => recording,
            Err(error) => return assert!(error.what().contains(expected), "{error}"),
        };
        assert_eq!(recording.geometry(), Some(Geometry::new(4, 3)));
        let (mut blocks, mut said) = (recording.blocks(), Vec::new());
        while let Some(chunk) = blocks.next_block().unwrap() {
            let span = chunk.span();
            said.extend(span.events.iter().map(|event| format!("{} {event:?}", span.time(*event))));
        }
        let counters = blocks.counters();
        assert_eq!(counters.bytes_decoded + counters.bytes_faulty, bytes.len() as u64);
        said.push(format!("{} off, {} cut", counters.off_sensor, counters.faults.get(Fault::CutShort)));
        assert_eq!(said.join(", "), expected);
    }

    #[test]
    fn events_overflows_and_resets() {
        let bytes = [5 << 1 | 1, 3, 0, 0, 0, 0xFF, 0xFE, 0xFF, 1 << 1, 0, 0, 2, 0, 126 << 1 | 1, 1, 0, 1, 0];
        check(DVS, &bytes, "5 t=5 x=3 y=2 p=1, 260 t=260 x=0 y=0 p=0, 386 t=386 x=1 y=1 p=1, 0 off, 0 cut");
    }

    #[test]
    fn pixels_off_the_sensor_and_an_event_cut_short() {
        let bytes = [0, 4, 0, 0, 0, 0, 0, 0, 3, 0, 2, 1, 0, 1, 0, 2, 1];
        check(DVS, &bytes, "1 t=1 x=1 y=1 p=0, 2 off, 1 cut");
    }

    #[test]
    fn of_atis_the_changes() {
        let bytes = [0xFE, 5 << 2 | 2, 1, 0, 0, 0, 1 << 2 | 1, 1, 0, 0, 0, 1 << 2, 2, 0, 0, 0, 0xFC];
        check(ATIS, &bytes, "131 t=131 x=1 y=2 p=1, 133 t=133 x=2 y=2 p=0, 0 off, 0 cut");
    }

    #[test]
    fn what_is_not_read_says_its_name() {
        check(0, &[], "generic");
        check(4, &[], "colour");
        check(9, &[], "type 9");
    }
}
