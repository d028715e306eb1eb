//! AEDAT 3.1, as cAER and libcaer write it: a text header, then packets of one kind each, little-endian.
//!
//! Spec: <https://docs.inivation.com/software/software-advanced-usage/file-formats/aedat-3.1.html>, libcaer's `events/`
//!
//! ```text
//! head      type i16 | source i16 | bytes of an event i32 | place of its time i32 | overflow i32
//!           capacity i32 | events i32 | valid events i32
//! 1 polarity  31..17 x   16..2 y   1 ON   0 valid                 | t i32
//! 0 special   31..8 data   7..1 type   0 valid                    | t i32
//! 2 frame     7..4 filter   3..1 channels   0 valid               | start, end, exposure start, exposure end i32
//!             | width, height, x, y i32 | u16 of each pixel and channel
//! 3 IMU6      0 valid | t i32 | acceleration in g, rotation in °/s, temperature in °C, f32
//! 4 IMU9      the same, then the magnetic field in µT
//! ```
//!
//! Times are 31 bits of µs, after 31 bits of overflow in the head. An event that is not valid was taken out by the
//! program that wrote the file, and is counted as marked invalid. Pixels have 16 bits; of colours the upper 8 are kept.

use crate::aer_header::AerHeader;
use crate::byte_cursor::Bad;
use crate::container::{Container, Cursor, Items, Piece};
use crate::input::Input;
use crate::intake::{Intake, Taken};
use crate::open::Probe;
use crate::packets::{
    Elements, Head, Kind, PacketCursor, Packets, SideDamage, SideItem, SideStream, Unpacking, take_trigger,
};
use crate::{
    Error, ErrorKind, Format, Frame, ImuSample, OpenOptions, PixelFormat, Stream, StreamKind, aedat2,
};
use lobula_core::{Geometry, Polarity, Sink};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format =
    Format { name: "AEDAT 3.1", extensions: &["aedat"], create: None, probe, open };

/// Bytes of a packet's head.
const HEAD_BYTES: usize = 28;
/// Bytes of a polarity or special event.
const EVENT_BYTES: usize = 8;
const IMU6_BYTES: usize = 36;
const IMU9_BYTES: usize = 48;
/// Bytes of a frame before its pixels.
const FRAME_BYTES: usize = 36;
/// Largest sensor that coordinates of 15 bits can tell.
const GEOMETRY_MAX: Geometry = Geometry::new(1 << 15, 1 << 15);
/// Bits of a time in an event.
const TIME_BITS: u32 = 31;
/// Standard gravity in m/s².
const GRAVITY: f64 = 9.80665;

fn probe(Probe { head, .. }: &Probe<'_>) -> bool {
    head.starts_with(b"#!AER-DAT3.")
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let mut version = [0; 12];
    input.read_at(0, &mut version)?;
    let unsupported =
        |what: &str, remedy: &str| Error::new(ErrorKind::Unsupported, input.path(), what, remedy);
    if &version != b"#!AER-DAT3.1" {
        return Err(unsupported(
            "is of a version of AEDAT 3 other than 3.1",
            "convert it to AEDAT 4 with DV",
        ));
    }
    let header = AerHeader::read(&input, &options.limits)?;
    if !header.has_end {
        let (what, remedy) = ("has a header without an end", "copy it again from where it was recorded");
        return Err(Error::new(ErrorKind::Malformed, input.path(), what, remedy).at(header.bytes));
    }
    if let Some(format) = header.get("Format").filter(|format| *format != "RAW") {
        let what = format!("has packets in the form {format}, of which only RAW is read");
        return Err(unsupported(&what, "convert it to AEDAT 4 with DV"));
    }
    let sources = Source::all(&header);
    let source = Source::choose(&sources, options, input.path())?;
    let named = source.and_then(|source| sources.iter().find(|one| one.id == source));
    let geometry = options.sensor_size.or(named.and_then(|one| aedat2::sensor_size(&one.device)));
    let intake = Intake::new(geometry.unwrap_or(GEOMETRY_MAX), options);
    let (range, bytes_max) = (header.bytes..input.len(), options.limits.chunk_bytes_max);
    let ids = sources.iter().map(|one| one.id).collect();
    let file = Aedat31File { input, sources: ids, source, range, bytes_max, damage: SideDamage::default() };
    Ok(Box::new(Aedat31Recording { file: Arc::new(file), header, sources, geometry, intake }))
}

/// A camera of which the header tells.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Source {
    id: i16,
    device: String,
    /// Which no other has.
    name: String,
}

impl Source {
    fn all(header: &AerHeader) -> Vec<Self> {
        let source = |(key, device): (&str, &str)| {
            let id: i16 = key.strip_prefix("Source ")?.trim().parse().ok()?;
            Some((id, device.to_owned()))
        };
        let all: Vec<_> = header.fields().filter_map(source).collect();
        let is_alone = |device: &String| all.iter().filter(|(_, one)| one == device).count() == 1;
        let name = |id: i16, device: &String| match is_alone(device) {
            true => device.clone(),
            false => format!("{id}:{device}"),
        };
        all.iter()
            .map(|(id, device)| Self { id: *id, device: device.clone(), name: name(*id, device) })
            .collect()
    }

    /// The only one, or the one that the option names. `None` where the header tells of none: then all are read.
    fn choose(sources: &[Self], options: &OpenOptions, path: &Path) -> Result<Option<i16>, Error> {
        let names = || sources.iter().map(|one| one.name.as_str()).collect::<Vec<_>>().join(", ");
        match (&options.topic, sources) {
            (Some(topic), _) => {
                let found = sources.iter().find(|one| one.name == *topic || one.id.to_string() == *topic);
                found.map(|one| Some(one.id)).ok_or_else(|| {
                    let what = format!("has no source called {topic}, but {}", names());
                    Error::new(ErrorKind::NeedsOption, path, what, "name one of these with --topic NAME")
                })
            }
            (None, []) => Ok(None),
            (None, [only]) => Ok(Some(only.id)),
            (None, _) => {
                let what = format!("has {} sources: {}", sources.len(), names());
                Err(Error::new(ErrorKind::NeedsOption, path, what, "name the one to read with --topic NAME"))
            }
        }
    }
}

/// An open file.
#[derive(Debug)]
struct Aedat31File {
    input: Arc<Input>,
    /// Of which the header tells; if of none, packets may be of any.
    sources: Vec<i16>,
    /// Whose events are read.
    source: Option<i16>,
    /// Where its packets are.
    range: Range<u64>,
    bytes_max: usize,
    damage: SideDamage,
}

/// Types of packets by number.
const SPECIAL: i16 = 0;
const POLARITY: i16 = 1;
const FRAME: i16 = 2;
const IMU6: i16 = 3;
const IMU9: i16 = 4;
/// The highest of the types that libcaer defines.
const TYPE_MAX: i16 = 13;

/// The kind of a type, and whether its events can have this size with their time at this place.
fn kind(number: i16, bytes: usize, time: usize) -> Option<Kind> {
    let (kind, fits) = match number {
        POLARITY => (Kind::Events, bytes == EVENT_BYTES && time == 4),
        SPECIAL => (Kind::Triggers { channel: 0 }, bytes == EVENT_BYTES && time == 4),
        FRAME => (Kind::Frames, bytes >= FRAME_BYTES && time < FRAME_BYTES),
        IMU6 => (Kind::Imu, bytes == IMU6_BYTES && time == 4),
        IMU9 => (Kind::Imu, bytes == IMU9_BYTES && time == 4),
        5..=TYPE_MAX | 100.. => (Kind::Other, bytes >= EVENT_BYTES && time < bytes),
        _ => return None,
    };
    fits.then_some(kind)
}

impl Packets for Aedat31File {
    const START_BYTES: usize = HEAD_BYTES;

    type Unpacker = ();

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

    fn head(&self, start: &[u8]) -> Option<Head> {
        let [a, b, c, d, rest @ ..] = start else { return None };
        let (number, source) = (i16::from_le_bytes([*a, *b]), i16::from_le_bytes([*c, *d]));
        let mut words = rest.as_chunks().0.iter().map(|word| i32::from_le_bytes(*word));
        let mut count = || usize::try_from(words.next()?).ok();
        let (bytes, time, overflow) = (count()?, count()?, count()?);
        let (capacity, events, valid) = (count()?, count()?, count()?);
        let kind = kind(number, bytes, time)?;
        let is_known = self.sources.is_empty() || self.sources.contains(&source);
        let is_head = is_known && valid <= events && events <= capacity && events > 0;
        let is_other = self.source.is_some_and(|own| own != source);
        is_head.then_some(Head {
            kind: if is_other { Kind::Other } else { kind },
            bytes: HEAD_BYTES as u64,
            body_bytes: events as u64 * bytes as u64,
            base_us: (overflow as i64) << TIME_BITS,
            element_bytes: bytes,
        })
    }

    fn unpack(&self, _: &[u8], _: bool, (): &mut ()) -> Result<Option<usize>, Unpacking> {
        Ok(None)
    }

    fn elements(&self, head: &Head, _: bool, bytes: &[u8]) -> Option<Elements> {
        let Head { base_us, element_bytes, .. } = *head;
        Some(Elements {
            first: 0,
            count: bytes.len() / element_bytes.max(1),
            next: 0,
            base_us,
            element_bytes,
        })
    }

    fn take(
        &self,
        head: &Head,
        bytes: &[u8],
        elements: &mut Elements,
        intake: &mut Intake,
        sink: &mut Sink<'_>,
    ) -> Result<(), Bad> {
        let (events, _) = bytes.as_chunks::<EVENT_BYTES>();
        for event in events.get(elements.next..).unwrap_or_default() {
            let (data, t) = (event.first_chunk().copied(), event.last_chunk().copied());
            let data = u32::from_le_bytes(data.unwrap_or_default());
            let t = elements.base_us + i64::from(i32::from_le_bytes(t.unwrap_or_default()));
            let taken = match (data & 1, head.kind) {
                (0, _) => {
                    intake.counters.marked_invalid += 1;
                    Taken::Yes
                }
                (_, Kind::Events) => {
                    let (x, y) = (i64::from(data >> 17), i64::from(data >> 2 & 0x7FFF));
                    intake.push(sink, t, (x, y), data >> 1 & 1 == 1, 0)?
                }
                _ => match edge((data >> 1 & 0x7F) as u8) {
                    Some((channel, edge)) => take_trigger(intake, sink, t, channel, edge)?,
                    None => Taken::Yes,
                },
            };
            if taken == Taken::Full {
                return Ok(());
            }
            elements.next += 1;
        }
        Ok(())
    }

    fn imu(&self, bytes: &[u8], elements: &Elements, intake: &Intake) -> Result<SideItem<ImuSample>, Bad> {
        let Some(sample) = element(bytes, elements) else { return Ok(SideItem::Damaged) };
        let words: Vec<[u8; 4]> = sample.as_chunks().0.to_vec();
        let word = |i: usize| words.get(i).copied().unwrap_or_default();
        if u32::from_le_bytes(word(0)) & 1 == 0 {
            return Ok(SideItem::Invalid);
        }
        let t = intake.time(elements.base_us + i64::from(i32::from_le_bytes(word(1))))?;
        let number = |i: usize| f64::from(f32::from_le_bytes(word(i)));
        let three = |first: usize| [first, first + 1, first + 2].map(number);
        Ok(SideItem::Item(ImuSample {
            t,
            acceleration: three(2).map(|g| g * GRAVITY),
            rotation: three(5).map(f64::to_radians),
            magnetic_field: (elements.element_bytes == IMU9_BYTES).then(|| three(9)),
            temperature: Some(number(8)),
        }))
    }

    fn frame(&self, bytes: &[u8], elements: &Elements, intake: &Intake) -> Result<SideItem<Frame>, Bad> {
        let Some((head, pixels)) =
            element(bytes, elements).and_then(|frame| frame.split_first_chunk::<FRAME_BYTES>())
        else {
            return Ok(SideItem::Damaged);
        };
        let words: Vec<i32> = head.as_chunks().0.iter().map(|word| i32::from_le_bytes(*word)).collect();
        let [info, _, _, start, end, sides @ ..] = words.as_slice() else { return Ok(SideItem::Damaged) };
        if info & 1 == 0 {
            return Ok(SideItem::Invalid);
        }
        let (start, end) = (elements.base_us + i64::from(*start), elements.base_us + i64::from(*end));
        let (start, end) = (intake.time(start)?, intake.time(end)?);
        let sides: Option<Vec<_>> = sides.iter().map(|side| u16::try_from(*side).ok()).collect();
        let Some([width, height, x, y]) = sides.as_deref() else { return Ok(SideItem::Damaged) };
        let (width, height, x, y) = (*width, *height, *x, *y);
        let Some((format, pixels)) =
            pixels_of(pixels, info >> 1 & 7, usize::from(width) * usize::from(height))
        else {
            return Ok(SideItem::Damaged);
        };
        let exposure = (start <= end).then_some(start..end);
        Ok(SideItem::Item(Frame { t: start, exposure, x, y, width, height, format, pixels }))
    }
}

/// The bytes of the next element.
fn element<'a>(bytes: &'a [u8], elements: &Elements) -> Option<&'a [u8]> {
    let start = elements.next.checked_mul(elements.element_bytes)?;
    bytes.get(start..start.checked_add(elements.element_bytes)?)
}

/// Input and edge of a type of special events; a pulse is told by its start, and the camera's own generator as
/// input 3. Others are marks of wraps, resets and frames, which are no triggers.
fn edge(kind: u8) -> Option<(u8, Polarity)> {
    match kind {
        2 | 4 => Some((0, Polarity::On)),
        3 => Some((0, Polarity::Off)),
        6 | 8 => Some((1, Polarity::On)),
        7 => Some((1, Polarity::Off)),
        9 | 11 => Some((2, Polarity::On)),
        10 => Some((2, Polarity::Off)),
        12 => Some((3, Polarity::On)),
        13 => Some((3, Polarity::Off)),
        _ => None,
    }
}

/// The layout by the number of channels, and the pixels in it.
fn pixels_of(bytes: &[u8], channels: i32, pixels: usize) -> Option<(PixelFormat, Vec<u8>)> {
    let channels = usize::try_from(channels).ok()?;
    let bytes = bytes.get(..pixels.checked_mul(2)?.checked_mul(channels)?)?;
    let upper = |level: &[u8; 2]| level[1];
    let (levels, _) = bytes.as_chunks::<2>();
    match channels {
        1 => Some((PixelFormat::Gray16, bytes.to_vec())),
        3 => Some((PixelFormat::Rgb8, levels.iter().map(upper).collect())),
        4 => {
            let (pixels, _) = levels.as_chunks::<4>();
            let bgra = pixels.iter().flat_map(|[r, g, b, a]| [b, g, r, a].map(upper));
            Some((PixelFormat::Bgra8, bgra.collect()))
        }
        _ => None,
    }
}

#[derive(Debug)]
struct Aedat31Recording {
    file: Arc<Aedat31File>,
    header: AerHeader,
    sources: Vec<Source>,
    geometry: Option<Geometry>,
    intake: Intake,
}

impl Container for Aedat31Recording {
    fn geometry(&self) -> Option<Geometry> {
        self.geometry
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.intake.geometry()
    }

    fn fields(&self) -> Vec<(&str, &str)> {
        self.header.fields().collect()
    }

    /// Nothing in the header tells which of them a source has.
    fn streams(&self) -> Vec<Stream> {
        let kinds = [StreamKind::Events, StreamKind::Triggers, StreamKind::Frames, StreamKind::Imu];
        let all = self.sources.iter().flat_map(|one| kinds.map(|kind| Stream::new(kind, one.name.as_str())));
        all.collect()
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
