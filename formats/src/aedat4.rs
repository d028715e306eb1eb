//! AEDAT 4.0, as DV writes it: a header with the tree of streams, packets of one stream each, a table of the packets.
//!
//! Spec: <https://docs.inivation.com/software/software-advanced-usage/file-formats/aedat-4.0.html>
//!
//! ```text
//! #!AER-DAT4.0\r\n
//! IOHE: compression i32, place of the table i64 (-1: none), tree of streams
//! i32 stream | i32 bytes | frame of the compression, around a buffer that starts with its size:
//!     EVTS  [t i64, x i16, y i16, on u8, 3 unused bytes]
//!     FRME  t, start, end, exposure start and end i64, format i8, size and place i16, [u8], exposure i64, source i8
//!     IMUS  [t i64, temperature °C, acceleration g, rotation °/s, magnetic field µT: f32]
//!     TRIG  [t i64, type i8]
//! FTAB: [place i64, stream and bytes, elements i64, first and last t i64]
//! ```
//!
//! Absent fields are 0. The table is written and not relied on: packets tell the same.

mod compression;
mod flatbuffer;
mod info;
mod streams;
mod write;

use crate::byte_cursor::Bad;
use crate::container::{Container, Cursor, Items, Piece};
use crate::input::Input;
use crate::intake::{Intake, Plain, Taken};
use crate::open::Probe;
use crate::packets::{
    Elements, Head, Kind, PacketCursor, Packets, SideDamage, SideItem, SideStream, Unpacked, Unpacking,
    take_trigger,
};
use crate::{Error, ErrorKind, Format, Frame, ImuSample, OpenOptions, PixelFormat, Stream};
use compression::Unpacker;
use flatbuffer::{Table, Vector};
use lobula_core::{Geometry, Polarity, Sink};
use std::ops::Range;
use std::sync::Arc;
use streams::Streams;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format =
    Format { name: "AEDAT 4.0", extensions: &["aedat4"], create: Some(write::create), probe, open };

/// First bytes of a file.
const MAGIC: &[u8] = b"#!AER-DAT4.0\r\n";
/// Bytes of a packet's head, and of its start with the letters that tell what it holds.
const HEAD_BYTES: usize = 8;
const START_BYTES: usize = HEAD_BYTES + 12;
/// Bytes of an event.
const EVENT_BYTES: usize = 16;
/// Events checked at once on the fast path.
const BATCH: usize = 1024;
/// Largest sensor that coordinates of 15 bits can tell.
const GEOMETRY_MAX: Geometry = Geometry::new(1 << 15, 1 << 15);
/// Standard gravity in m/s².
const GRAVITY: f64 = 9.80665;

/// Fields of the header.
const HEADER_COMPRESSION: usize = 0;
const HEADER_TABLE: usize = 1;
const HEADER_INFO: usize = 2;

fn probe(Probe { head, .. }: &Probe<'_>) -> bool {
    head.starts_with(b"#!AER-DAT4.")
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let (header, start) = header(&input, options)?;
    let table = Table::root(&header).filter(|_| flatbuffer::identifier(&header) == Some(*b"IOHE"));
    let Some(table) = table else {
        return Err(malformed(&input, "has a header that contradicts its own offsets").at(MAGIC.len() as u64));
    };
    let compression = table.i32(HEADER_COMPRESSION).unwrap_or_default();
    if !(0..compression::ALL.len() as i32).contains(&compression) {
        let what = format!("is compressed in a way of number {compression}, which is not known");
        let remedy = "write it again with one of none, LZ4, ZSTD";
        return Err(Error::new(ErrorKind::Unsupported, input.path(), what, remedy).at(MAGIC.len() as u64));
    }
    let info = String::from_utf8_lossy(table.bytes(HEADER_INFO).unwrap_or_default());
    let Some(declared) = info::streams(&info) else {
        return Err(malformed(&input, "has a header whose tree of streams is broken").at(MAGIC.len() as u64));
    };
    let streams = Streams::choose(declared, options, input.path())?;
    let place = table.i64(HEADER_TABLE).and_then(|place| u64::try_from(place).ok());
    let (range, bytes_max) = (start..input.len(), options.limits.chunk_bytes_max);
    let mut file = Aedat4File { input, streams, range, bytes_max, damage: SideDamage::default() };
    if let Some(place) = place
        && file.has_table_at(place)?
    {
        file.range.end = place;
    }
    let geometry = match (options.sensor_size, file.streams.geometry()) {
        (None, Some(told)) => Some(bounded(told, &file.input, options)?),
        (option, _) => option,
    };
    let intake = Intake::new(geometry.unwrap_or(GEOMETRY_MAX), options);
    Ok(Box::new(Aedat4Recording { file: Arc::new(file), geometry, intake }))
}

/// The header's buffer, and the offset after it.
fn header(input: &Input, options: &OpenOptions) -> Result<(Vec<u8>, u64), Error> {
    let mut start = [0; MAGIC.len() + 4];
    let len = input.read_at(0, &mut start)?;
    let (magic, size) = start.split_at(MAGIC.len());
    if !MAGIC.starts_with(&magic[..len.min(MAGIC.len())]) {
        let what = "is of a version of AEDAT 4 that is not known";
        return Err(Error::new(ErrorKind::Unsupported, input.path(), what, "convert it to AEDAT 4.0"));
    }
    let size = u32::from_le_bytes(*size.first_chunk().unwrap_or(&[0; 4]));
    let bytes = usize::try_from(size).unwrap_or(usize::MAX).saturating_add(4);
    let max = options.limits.header_bytes_max;
    if len == start.len() && bytes > max {
        let what = format!("has a header of {bytes} bytes, beyond {max}");
        let remedy = "it is damaged, or raise Limits::header_bytes_max";
        return Err(Error::new(ErrorKind::TooLarge, input.path(), what, remedy).at(MAGIC.len() as u64));
    }
    let mut header = vec![0; bytes];
    let there = input.read_at(MAGIC.len() as u64, &mut header)?;
    if there < bytes || len < start.len() {
        return Err(malformed(input, "ends inside its header").at(input.len()));
    }
    Ok((header, (MAGIC.len() + bytes) as u64))
}

fn bounded(told: Geometry, input: &Input, options: &OpenOptions) -> Result<Geometry, Error> {
    let max = options.limits.sensor_side_px_max;
    if told.width <= max && told.height <= max {
        return Ok(told);
    }
    let what = format!("has the sensor size {told}, beyond {max} pixels a side,");
    let remedy = "give the true size with --sensor-size WxH";
    Err(Error::new(ErrorKind::TooLarge, input.path(), what, remedy).at(MAGIC.len() as u64))
}

fn malformed(input: &Input, what: &str) -> Error {
    Error::new(ErrorKind::Malformed, input.path(), what, "copy it again from where it was recorded")
}

/// An open file.
#[derive(Debug)]
struct Aedat4File {
    input: Arc<Input>,
    streams: Streams,
    /// Where its packets are.
    range: Range<u64>,
    bytes_max: usize,
    damage: SideDamage,
}

impl Aedat4File {
    /// Whether the table of packets begins at this place: if so, no packet follows.
    fn has_table_at(&self, place: u64) -> Result<bool, Error> {
        if !(self.range.start..self.input.len()).contains(&place) {
            return Ok(false);
        }
        // The start tells, and a table that is cut is one too.
        let len = usize::try_from(self.input.len() - place).unwrap_or(usize::MAX).min(TABLE_START_BYTES);
        let mut bytes = vec![0; len];
        self.input.read_at(place, &mut bytes)?;
        let mut unpacker = Unpacker::default();
        let plain = match compression::is_compressed(&bytes) {
            true => unpacker.unpack(&bytes, true, self.bytes_max).map(|len| unpacker.bytes(len)),
            false => Ok(bytes.as_slice()),
        };
        Ok(plain.is_ok_and(|plain| flatbuffer::identifier(plain) == Some(*b"FTAB")))
    }
}

/// Bytes of the table that are looked at: a block of any compression.
const TABLE_START_BYTES: usize = 256 << 10;

impl Unpacked for Unpacker {
    fn bytes(&self, len: usize) -> &[u8] {
        Unpacker::bytes(self, len)
    }
}

impl Packets for Aedat4File {
    const START_BYTES: usize = START_BYTES;

    type Unpacker = Unpacker;

    fn input(&self) -> &Arc<Input> {
        &self.input
    }

    fn range(&self) -> Range<u64> {
        self.range.clone()
    }

    fn bytes_max(&self) -> usize {
        self.bytes_max
    }

    fn side_damage(&self) -> &SideDamage {
        &self.damage
    }

    /// Of a stream that the header tells, and a frame of a compression or a buffer of what the stream holds.
    fn head(&self, start: &[u8]) -> Option<Head> {
        let (stream, rest) = start.split_first_chunk()?;
        let (size, body) = rest.split_first_chunk()?;
        let stream = self.streams.get(i32::from_le_bytes(*stream))?;
        let size = u32::try_from(i32::from_le_bytes(*size)).ok()?;
        let is_plain = || {
            let says = body.first_chunk().map(|says| u32::from_le_bytes(*says));
            let letters = flatbuffer::identifier(body);
            says == size.checked_sub(4) && letters.is_some_and(|letters| stream.is_of(letters))
        };
        let is_packet = compression::is_compressed(body) || is_plain();
        is_packet.then_some(Head {
            kind: stream.kind,
            bytes: HEAD_BYTES as u64,
            body_bytes: size.into(),
            base_us: 0,
            element_bytes: EVENT_BYTES,
        })
    }

    fn unpack(&self, body: &[u8], cut: bool, unpacker: &mut Unpacker) -> Result<Option<usize>, Unpacking> {
        if compression::is_compressed(body) {
            return unpacker.unpack(body, cut, self.bytes_max).map(Some);
        }
        Ok(None)
    }

    fn elements(&self, head: &Head, cut: bool, bytes: &[u8]) -> Option<Elements> {
        let (letters, bytes_each) = match head.kind {
            Kind::Events => (*b"EVTS", EVENT_BYTES),
            Kind::Triggers { .. } => (*b"TRIG", 4),
            Kind::Imu => (*b"IMUS", 4),
            Kind::Frames => (*b"FRME", 1),
            Kind::Other => return None,
        };
        if flatbuffer::identifier(bytes)? != letters {
            return None;
        }
        let table = Table::root(bytes)?;
        if head.kind == Kind::Frames {
            return Some(Elements { count: 1, ..Elements::default() });
        }
        let vector = table.vector(0).unwrap_or_default();
        let there = vector.there(bytes, bytes_each);
        let whole = cut || there == vector.count;
        whole.then_some(Elements { first: vector.first, count: there, ..Elements::default() })
    }

    fn take(
        &self,
        head: &Head,
        bytes: &[u8],
        elements: &mut Elements,
        intake: &mut Intake,
        sink: &mut Sink<'_>,
    ) -> Result<(), Bad> {
        match head.kind {
            Kind::Triggers { channel } => take_triggers(bytes, elements, channel, intake, sink),
            _ => take_events(bytes, elements, intake, sink),
        }
    }

    fn imu(&self, bytes: &[u8], elements: &Elements, intake: &Intake) -> Result<SideItem<ImuSample>, Bad> {
        let vector = Vector { first: elements.first, count: elements.count };
        let Some(table) = vector.table(bytes, elements.next) else { return Ok(SideItem::Damaged) };
        let t = intake.time(table.i64(0).unwrap_or_default())?;
        let field = |field: usize| table.f32(field).map(f64::from);
        let three = |first: usize| [0, 1, 2].map(|axis| field(first + axis).unwrap_or_default());
        let magnetic_field = (8..11).any(|axis| field(axis).is_some()).then(|| three(8));
        Ok(SideItem::Item(ImuSample {
            t,
            acceleration: three(2).map(|g| g * GRAVITY),
            rotation: three(5).map(f64::to_radians),
            magnetic_field,
            temperature: field(1),
        }))
    }

    fn frame(&self, bytes: &[u8], _: &Elements, intake: &Intake) -> Result<SideItem<Frame>, Bad> {
        let Some(table) = Table::root(bytes) else { return Ok(SideItem::Damaged) };
        let t = table.i64(0).unwrap_or_default();
        let exposure = match (table.i64(3), table.i64(4), table.i64(11)) {
            (Some(start), Some(end), _) if start <= end => Some(intake.time(start)?..intake.time(end)?),
            (None, None, Some(long @ 0..)) => Some(intake.time(t)?..intake.time(t.saturating_add(long))?),
            _ => None,
        };
        let side = |field: usize| u16::try_from(table.i16(field).unwrap_or_default()).unwrap_or_default();
        let (width, height) = (side(6), side(7));
        let format = pixel_format(table.i8(5).unwrap_or_default())?;
        let pixels = table.bytes(10).unwrap_or_default();
        if pixels.len() != usize::from(width) * usize::from(height) * format.bytes() {
            return Ok(SideItem::Damaged);
        }
        let t = intake.time(t)?;
        Ok(SideItem::Item(Frame {
            t,
            exposure,
            x: side(8),
            y: side(9),
            width,
            height,
            format,
            pixels: pixels.to_vec(),
        }))
    }
}

/// A frame's layout by the number that OpenCV gives it.
fn pixel_format(number: i8) -> Result<PixelFormat, Bad> {
    match number {
        0 => Ok(PixelFormat::Gray8),
        2 => Ok(PixelFormat::Gray16),
        16 => Ok(PixelFormat::Bgr8),
        24 => Ok(PixelFormat::Bgra8),
        _ => Err(Bad {
            offset: 0,
            kind: ErrorKind::Unsupported,
            what: format!("has a frame whose pixels are of OpenCV's type {number}, which is not read"),
            remedy: "write it again with pixels of 8 bits".into(),
        }),
    }
}

/// Types of triggers: edges of the input, and of the camera's own generator, which is told as input 1. A pulse is
/// told by its start. Others are marks of frames and resets, which are no triggers.
fn edge(kind: i8) -> Option<(u8, Polarity)> {
    match kind {
        1 | 3 => Some((0, Polarity::On)),
        2 => Some((0, Polarity::Off)),
        4 => Some((1, Polarity::On)),
        5 => Some((1, Polarity::Off)),
        _ => None,
    }
}

fn take_triggers(
    bytes: &[u8],
    elements: &mut Elements,
    channel: u8,
    intake: &mut Intake,
    sink: &mut Sink<'_>,
) -> Result<(), Bad> {
    let vector = Vector { first: elements.first, count: elements.count };
    while elements.next < elements.count {
        if let Some(table) = vector.table(bytes, elements.next)
            && let Some((input, edge)) = edge(table.i8(1).unwrap_or_default())
        {
            let t = table.i64(0).unwrap_or_default();
            if take_trigger(intake, sink, t, channel.saturating_add(input), edge)? == Taken::Full {
                return Ok(());
            }
        }
        elements.next += 1;
    }
    Ok(())
}

fn take_events(
    bytes: &[u8],
    elements: &mut Elements,
    intake: &mut Intake,
    sink: &mut Sink<'_>,
) -> Result<(), Bad> {
    let all = bytes.get(elements.first..).unwrap_or_default().as_chunks::<EVENT_BYTES>().0;
    let all = all.get(..elements.count).unwrap_or(all);
    while let Some(rest) = all.get(elements.next..).filter(|rest| !rest.is_empty()) {
        let batch = rest.get(..rest.len().min(BATCH).min(sink.room())).unwrap_or_default();
        if !batch.is_empty() && take_batch(batch, intake, sink) {
            elements.next += batch.len();
            continue;
        }
        // At least one, so that a full sink is noticed.
        for event in rest.iter().take(batch.len().max(1)) {
            let (t, x, y, on) = split(event);
            if intake.push(sink, t, (x.into(), y.into()), on != 0, 0)? == Taken::Full {
                return Ok(());
            }
            elements.next += 1;
        }
    }
    Ok(())
}

/// Time, x, y, polarity.
#[inline(always)]
fn split(event: &[u8; EVENT_BYTES]) -> (i64, i16, i16, u8) {
    let word = u128::from_le_bytes(*event);
    (word as i64, (word >> 64) as i16, (word >> 80) as i16, (word >> 96) as u8)
}

/// Takes events that are all on the sensor and near the first in time; tells whether it did.
fn take_batch(batch: &[[u8; EVENT_BYTES]], intake: &mut Intake, sink: &mut Sink<'_>) -> bool {
    let (Some(first), Some(last)) = (batch.first().map(split), batch.last().map(split)) else { return false };
    let event = |event: &[u8; EVENT_BYTES]| {
        let word = u128::from_le_bytes(*event);
        // Of the polarity one byte, after it there are unused ones.
        Plain::of(word as u64, (word >> 64) as u64 & 0xFF_FFFF_FFFF)
    };
    intake.push_alike(sink, 0, (first.0, last.0), batch.iter(), event)
}

#[derive(Debug)]
struct Aedat4Recording {
    file: Arc<Aedat4File>,
    geometry: Option<Geometry>,
    intake: Intake,
}

impl Container for Aedat4Recording {
    fn geometry(&self) -> Option<Geometry> {
        self.geometry
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.intake.geometry()
    }

    fn fields(&self) -> Vec<(&str, &str)> {
        self.file.streams.fields()
    }

    fn streams(&self) -> Vec<Stream> {
        self.file.streams.list()
    }

    fn warnings(&self) -> Vec<String> {
        self.file.damage.sentences()
    }

    fn start(&self) -> Box<dyn Cursor> {
        Box::new(PacketCursor::new(self.file.clone(), self.intake.clone()))
    }

    fn pieces(&self, n: usize) -> Result<Vec<Piece>, Error> {
        PacketCursor::pieces(&self.file, &self.intake, n)
    }

    fn imu(&self) -> Items<ImuSample> {
        Box::new(SideStream::imu(self.file.clone(), self.intake.clone()))
    }

    fn frames(&self) -> Items<Frame> {
        Box::new(SideStream::frames(self.file.clone(), self.intake.clone()))
    }
}

#[cfg(test)]
mod tests;
