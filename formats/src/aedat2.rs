//! AEDAT 2.0, as jAER writes it: a text header, then pairs of address and time, 32 bits each, big-endian.
//!
//! Spec: <https://docs.inivation.com/software/software-advanced-usage/file-formats/aedat-2.0.html>, jAER's
//! `DavisChip`, `IMUSample` and `DVS128`
//!
//! ```text
//! DAVIS     31 0   30..22 y   21..12 x   11 ON   10 0                          an event
//!           31 0                                 10 1   2..0: 2 falling edge   a trigger, else rising
//!           31 1   30..22 y   21..12 x   11..10 00 reset, 01 signal   9..0 level of a pixel
//!           31 1   30..28 which of 7   27..12 value   11..10 11       a word of the inertial sensor
//! DVS128    31..16 0   15 0   14..8 y   7..1 x   0 OFF                an event
//!           15 1                                                      a trigger
//! ```
//!
//! x and y of events are mirrored against the image (x = width - 1 - raw x); of pixels only y is. Which layout, and the
//! sensor's size, is told by the header's `AEChip` or `HardwareInterface`. The counter of time is 32 bits of µs: it
//! wraps after 71 minutes.

mod clock;
mod frames;
mod imu;
mod write;

use crate::aer_header::AerHeader;
use crate::byte_cursor::{Bad, ByteCursor, ByteDecoder, Step};
use crate::container::{Container, Cursor, Items};
use crate::input::Input;
use crate::intake::{Intake, Taken};
use crate::open::Probe;
use crate::{Error, ErrorKind, Format, Frame, ImuSample, OpenOptions, Stream, StreamKind};
use clock::Clock;
use lobula_core::{Counters, Fault, Geometry, Polarity, Sink, Trigger};
use std::sync::Arc;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format =
    Format { name: "AEDAT 2.0", extensions: &["aedat", "aedat2"], create: Some(write::create), probe, open };

/// Bytes of an address and a time.
const RECORD_BYTES: usize = 8;
/// Records checked at once on the fast path.
const BATCH: usize = 512;

fn probe(Probe { head, .. }: &Probe<'_>) -> bool {
    head.starts_with(b"#!AER-DAT2.0")
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let header = AerHeader::read(&input, &options.limits)?;
    let chip = Chip::of(&header, options).ok_or_else(|| unknown_chip(&input, &header))?;
    let decoder = Decoder { chip, clock: Clock::default(), intake: Intake::new(chip.geometry, options) };
    Ok(Box::new(Aedat2Recording { input, header, decoder }))
}

fn unknown_chip(input: &Input, header: &AerHeader) -> Error {
    let what = match header.get("AEChip") {
        Some(chip) => format!("is of the chip {chip}, whose size is not known"),
        None => "does not tell the chip that it is of, nor its size".to_owned(),
    };
    let remedy = "give the size with --sensor-size WxH (128x128 is read as a DVS128, others as a DAVIS)";
    Error::new(ErrorKind::NeedsOption, input.path(), what, remedy)
}

/// What the bits of an address mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layout {
    Dvs128,
    Davis,
}

/// A sensor.
#[derive(Clone, Copy, Debug)]
struct Chip {
    layout: Layout,
    geometry: Geometry,
}

/// Parts of the names that jAER gives to chips and cameras.
const CHIPS: [(&str, Layout, Geometry); 7] = [
    ("dvs128", Layout::Dvs128, Geometry::new(128, 128)),
    ("davis240", Layout::Davis, Geometry::new(240, 180)),
    ("sbret10", Layout::Davis, Geometry::new(240, 180)),
    ("davis346", Layout::Davis, Geometry::new(346, 260)),
    ("davis640", Layout::Davis, Geometry::new(640, 480)),
    ("davis208", Layout::Davis, Geometry::new(208, 192)),
    ("davis128", Layout::Davis, Geometry::new(128, 128)),
];

/// Key of the sensor's size in files that we write: jAER knows no name for sensors of other sizes than its own.
const SIZE_KEY: &str = "SensorSize";

fn own_size(header: &AerHeader) -> Option<Geometry> {
    let (width, height) = header.get(SIZE_KEY)?.split_once('x')?;
    let side = |text: &str| text.parse().ok().filter(|side| *side > 0);
    Some(Geometry::new(side(width)?, side(height)?))
}

impl Chip {
    /// The header's; an option overrules its size, and tells the layout where the header does not.
    fn of(header: &AerHeader, options: &OpenOptions) -> Option<Self> {
        let lines = ["AEChip", "HardwareInterface"].into_iter().filter_map(|key| header.get(key));
        let named = lines.filter_map(Self::named).next();
        match (named, options.sensor_size.or(own_size(header))) {
            (Some(chip), size) => Some(Self { geometry: size.unwrap_or(chip.geometry), ..chip }),
            (None, Some(geometry)) if geometry == Geometry::new(128, 128) => {
                Some(Self { layout: Layout::Dvs128, geometry })
            }
            (None, Some(geometry)) => Some(Self { layout: Layout::Davis, geometry }),
            (None, None) => None,
        }
    }

    fn named(name: &str) -> Option<Self> {
        let name = name.to_ascii_lowercase();
        let found = CHIPS.iter().find(|(part, ..)| name.contains(part));
        found.map(|(_, layout, geometry)| Self { layout: *layout, geometry: *geometry })
    }

    /// What an address says; coordinates are turned to the image's and may be off the sensor.
    fn word(self, address: u32) -> Word {
        match self.layout {
            Layout::Davis => self.davis(address),
            Layout::Dvs128 => self.dvs128(address),
        }
    }

    fn davis(self, address: u32) -> Word {
        let (x, y) = (bits(address, 12, 10), bits(address, 22, 9));
        let y = i64::from(self.geometry.height) - 1 - y;
        match (address >> 31, address >> 10 & 3) {
            (0, 0 | 2) => {
                let x = i64::from(self.geometry.width) - 1 - x;
                Word::Event { x, y, on: address >> 11 & 1 == 1 }
            }
            (0, _) => Word::Trigger(if address & 7 == FALLING_EDGE { Polarity::Off } else { Polarity::On }),
            (_, 0) => Word::Pixel { x, y, read: Read::Reset, level: (address & 0x3FF) as u16 },
            (_, 1) => Word::Pixel { x, y, read: Read::Signal, level: (address & 0x3FF) as u16 },
            (_, 3) => Word::Imu { which: (address >> 28 & 7) as u8, value: (address >> 12) as i16 },
            _ => Word::Unknown,
        }
    }

    fn dvs128(self, address: u32) -> Word {
        let x = i64::from(self.geometry.width) - 1 - bits(address, 1, 7);
        let y = i64::from(self.geometry.height) - 1 - bits(address, 8, 7);
        match address >> 15 {
            0 => Word::Event { x, y, on: address & 1 == 0 },
            1 => Word::Trigger(Polarity::On),
            _ => Word::Unknown,
        }
    }
}

/// Kind of a trigger, in the lowest bits of its address; 3 is a rising edge, 4 a pulse.
const FALLING_EDGE: u32 = 2;

fn bits(address: u32, shift: u32, count: u32) -> i64 {
    i64::from(address >> shift & ((1 << count) - 1))
}

/// The size of a sensor by a name that contains its chip's.
#[cfg(feature = "aedat4")]
pub(crate) fn sensor_size(name: &str) -> Option<Geometry> {
    Chip::named(name).map(|chip| chip.geometry)
}

/// What an address says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Word {
    Event { x: i64, y: i64, on: bool },
    Trigger(Polarity),
    Pixel { x: i64, y: i64, read: Read, level: u16 },
    Imu { which: u8, value: i16 },
    Unknown,
}

/// A pixel is read after its reset and after its exposure: its brightness is the difference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Read {
    Reset,
    Signal,
}

/// An address and the reading of the counter.
#[inline(always)]
fn split(record: [u8; RECORD_BYTES]) -> (u32, u32) {
    let [a, b, c, d, e, f, g, h] = record;
    (u32::from_be_bytes([a, b, c, d]), u32::from_be_bytes([e, f, g, h]))
}

#[derive(Debug)]
struct Aedat2Recording {
    input: Arc<Input>,
    header: AerHeader,
    /// At the first record.
    decoder: Decoder,
}

impl Aedat2Recording {
    fn records(&self) -> Records {
        Records::new(self.input.clone(), self.header.bytes, self.decoder.clone())
    }
}

impl Container for Aedat2Recording {
    fn geometry(&self) -> Option<Geometry> {
        Some(self.decoder.chip.geometry)
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.decoder.chip.geometry
    }

    fn fields(&self) -> Vec<(&str, &str)> {
        self.header.fields().collect()
    }

    /// Nothing in the header tells which of them are there.
    fn streams(&self) -> Vec<Stream> {
        let kinds: &[StreamKind] = match self.decoder.chip.layout {
            Layout::Dvs128 => &[StreamKind::Events, StreamKind::Triggers],
            Layout::Davis => &[StreamKind::Events, StreamKind::Triggers, StreamKind::Frames, StreamKind::Imu],
        };
        kinds.iter().map(|kind| Stream::new(*kind, "")).collect()
    }

    fn start(&self) -> Box<dyn Cursor> {
        let records = self.header.bytes..self.input.len();
        Box::new(ByteCursor::new(self.input.clone(), records, self.decoder.clone()))
    }

    fn imu(&self) -> Items<ImuSample> {
        Box::new(imu::Samples::new(self.records()))
    }

    fn frames(&self) -> Items<Frame> {
        Box::new(frames::Frames::new(self.records(), self.decoder.chip.geometry))
    }
}

#[derive(Clone, Debug)]
struct Decoder {
    chip: Chip,
    clock: Clock,
    intake: Intake,
}

impl Decoder {
    /// Takes a batch of records that are all events on the sensor, near each other in time; tells whether it did.
    fn take_events(&mut self, records: &[[u8; RECORD_BYTES]], sink: &mut Sink<'_>) -> bool {
        let Some((low, high)) = self.clock.near() else { return false };
        let (Ok(low), Ok(high)) = (self.intake.time(low), self.intake.time(high)) else { return false };
        // Of an empty sink the first event decides what it admits, and all are near that.
        let admitted = sink.is_empty() || (sink.admits(low) && sink.admits(high));
        if !admitted {
            return false;
        }
        let events = sink.spare().get_mut(..records.len()).unwrap_or_default();
        let range = match self.chip.layout {
            Layout::Davis => self.clock.take_all(records, events, low, DavisEvents(self.chip.geometry)),
            Layout::Dvs128 => self.clock.take_all(records, events, low, Dvs128Events(self.chip.geometry)),
        };
        let Some((t_first, t_last)) = range else { return false };
        sink.commit(records.len(), t_first, t_last);
        self.intake.counters.events += records.len() as u64;
        self.intake.other((records.len() * RECORD_BYTES) as u64);
        true
    }

    /// Takes a record of any kind.
    fn take(&mut self, record: [u8; RECORD_BYTES], sink: &mut Sink<'_>) -> Result<Taken, Bad> {
        let (address, reading) = split(record);
        let t = self.clock.peek(reading);
        match self.chip.word(address) {
            Word::Event { x, y, on } => {
                if self.intake.push(sink, t, (x, y), on, RECORD_BYTES as u64)? == Taken::Full {
                    return Ok(Taken::Full);
                }
            }
            Word::Trigger(edge) => {
                let Counters { events, off_sensor, .. } = self.intake.counters;
                let t = self.intake.time(t)?;
                if !sink.push_trigger(Trigger { t, ordinal: events - off_sensor, channel: 0, edge }) {
                    return Ok(Taken::Full);
                }
                self.intake.counters.triggers += 1;
                self.intake.other(RECORD_BYTES as u64);
            }
            Word::Pixel { .. } | Word::Imu { .. } => self.intake.other(RECORD_BYTES as u64),
            Word::Unknown => self.intake.fault(Fault::UnknownWord, RECORD_BYTES as u64),
        }
        self.clock.set(t);
        Ok(Taken::Yes)
    }
}

impl ByteDecoder for Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        let (mut records, _) = bytes.as_chunks::<RECORD_BYTES>();
        let whole = records.len();
        let taken = |left: &[_]| (whole - left.len()) * RECORD_BYTES;
        while !records.is_empty() {
            let (batch, rest) = records.split_at(records.len().min(BATCH).min(sink.room()));
            if !batch.is_empty() && self.take_events(batch, sink) {
                records = rest;
                continue;
            }
            // At least one, so that a full sink is noticed.
            for _ in 0..batch.len().max(1) {
                let [record, rest @ ..] = records else { break };
                let offset = taken(records);
                match self.take(*record, sink).map_err(|bad| Bad { offset, ..bad })? {
                    Taken::Full => return Ok(Step { taken: offset, full: true }),
                    Taken::Yes => records = rest,
                }
            }
        }
        Ok(Step { taken: whole * RECORD_BYTES, full: false })
    }

    fn finish(&mut self, unread: &[u8]) {
        self.intake.cut_short(unread);
    }

    fn counters(&self) -> Counters {
        self.intake.counters
    }
}

/// Reads the event of an address without a branch.
trait Addresses: Copy {
    /// x in bits 0 to 15, y in 16 to 30, and 1 in 31 for ON; and bits that are 0 where it is an event, on the sensor.
    fn pixel(self, address: u32) -> (u32, u32);
}

#[derive(Clone, Copy)]
struct DavisEvents(Geometry);

impl Addresses for DavisEvents {
    #[inline(always)]
    fn pixel(self, address: u32) -> (u32, u32) {
        let x = u32::from(self.0.width).wrapping_sub(1 + (address >> 12 & 0x3FF));
        let y = u32::from(self.0.height).wrapping_sub(1 + (address >> 22 & 0x1FF));
        // Below 0 the upper bits are set.
        let wrong = (address & 0x8000_0400) | ((x | y) & 0xFFFF_0000) | (y & 0x8000);
        (x | y << 16 | (address << 20 & 1 << 31), wrong)
    }
}

#[derive(Clone, Copy)]
struct Dvs128Events(Geometry);

impl Addresses for Dvs128Events {
    #[inline(always)]
    fn pixel(self, address: u32) -> (u32, u32) {
        let x = u32::from(self.0.width).wrapping_sub(1 + (address >> 1 & 0x7F));
        let y = u32::from(self.0.height).wrapping_sub(1 + (address >> 8 & 0x7F));
        let wrong = (address & 0xFFFF_8000) | ((x | y) & 0xFFFF_0000) | (y & 0x8000);
        (x | y << 16 | (!address << 31), wrong)
    }
}

/// Every record in file order, for the side streams.
#[derive(Debug)]
struct Records {
    input: Arc<Input>,
    /// Offset of the byte after those in `buffer`.
    next: u64,
    buffer: Vec<u8>,
    /// Bytes of `buffer` that were given.
    given: usize,
    decoder: Decoder,
    failed: bool,
}

impl Records {
    /// Whole records, so that none is split.
    const READ_BYTES: usize = 64 << 10;

    fn new(input: Arc<Input>, start: u64, decoder: Decoder) -> Self {
        Self { input, next: start, buffer: Vec::new(), given: 0, decoder, failed: false }
    }

    fn refill(&mut self) -> Result<(), Error> {
        let left = usize::try_from(self.input.len().saturating_sub(self.next)).unwrap_or(usize::MAX);
        self.buffer.resize(Self::READ_BYTES.min(left), 0);
        let len = self.input.read_at(self.next, &mut self.buffer)?;
        self.buffer.truncate(len);
        self.next += len as u64;
        self.given = 0;
        Ok(())
    }

    /// The next record: what it says, and its time. `None` at the end and after an error.
    fn next(&mut self) -> Option<Result<(Word, u64), Error>> {
        if self.failed {
            return None;
        }
        if self.given + RECORD_BYTES > self.buffer.len()
            && let Err(error) = self.refill()
        {
            self.failed = true;
            return Some(Err(error));
        }
        let record = *self.buffer.get(self.given..)?.first_chunk()?;
        let offset = self.next - (self.buffer.len() - self.given) as u64;
        self.given += RECORD_BYTES;
        let (address, reading) = split(record);
        let t = self.decoder.clock.peek(reading);
        self.decoder.clock.set(t);
        let word = self.decoder.chip.word(address);
        match self.decoder.intake.time(t) {
            Ok(t) => Some(Ok((word, t))),
            Err(Bad { kind, what, remedy, .. }) => {
                self.failed = true;
                Some(Err(Error::new(kind, self.input.path(), what, remedy).at(offset)))
            }
        }
    }
}

#[cfg(test)]
mod tests;
