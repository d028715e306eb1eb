//! Writes AEDAT 4.0: events, triggers, samples of the inertial sensor and frames, in any of its compressions.

use super::compression::{self, Packer};
use super::flatbuffer::Builder;
use super::info::{self, Declared};
use super::{GEOMETRY_MAX, GRAVITY, MAGIC};
use crate::output::Output;
use crate::write::{self, Encoder, Kept, WriteOptions, required};
use crate::{Compression, Error, ErrorKind, Frame, ImuSample, PixelFormat};
use lobula_core::{Geometry, Polarity, Span, Trigger};
use std::borrow::Cow;
use std::path::Path;

/// Most events, triggers or samples of a packet; DV writes as many events.
const EVENTS_MAX: usize = 10_000;
const TRIGGERS_MAX: usize = 1_000;
const SAMPLES_MAX: usize = 128;
/// Bytes of the tree of streams: it is written at the start, padded, and again when all streams are known.
const INFO_BYTES: usize = 8 << 10;
/// Most packets of which the table at the end tells; a file of more has none, and is read without.
const TABLE_PACKETS_MAX: usize = 100_000;

/// Starts a file.
pub(super) fn create(
    path: &Path,
    geometry: Option<Geometry>,
    options: &WriteOptions,
) -> Result<Box<dyn Encoder>, Error> {
    let geometry = required(geometry, path)?;
    let refused = |what: String, remedy: &str| {
        Error::new(ErrorKind::Refused, path, format!("cannot be written: {what}"), remedy)
    };
    if geometry.width > GEOMETRY_MAX.width || geometry.height > GEOMETRY_MAX.height {
        let what = format!("AEDAT 4.0 holds sensors up to {GEOMETRY_MAX}, not {geometry}");
        return Err(refused(what, "crop the events or choose another format"));
    }
    let compression = options.compression.unwrap_or(Compression::Lz4);
    let Some(number) = (0i32..).zip(compression::ALL).find(|(_, one)| *one == compression) else {
        let what = format!("AEDAT 4.0 is not compressed by {}", compression.name());
        return Err(refused(what, "give --compression none, lz4, lz4-high, zstd or zstd-high"));
    };
    let mut encoder = Aedat4Encoder {
        output: Output::create(path, options.overwrite)?,
        compression,
        number: number.0,
        packer: Packer::new(compression),
        streams: vec![Declared::new(0, "EVTS", "events", Some(geometry), None)],
        geometry,
        buffer: Builder::default(),
        pending: Pending::None,
        samples: Vec::new(),
        table: Vec::new(),
        packets: 0,
        items: 0,
    };
    let header = encoder.header(None)?;
    encoder.output.write(MAGIC)?;
    encoder.output.write(&header)?;
    Ok(Box::new(encoder))
}

#[derive(Debug)]
struct Aedat4Encoder {
    output: Output,
    compression: Compression,
    /// The compression in the header.
    number: i32,
    packer: Packer,
    streams: Vec<Declared>,
    geometry: Geometry,
    /// The packet of events that is being written, or any other for a moment.
    buffer: Builder,
    pending: Pending,
    samples: Vec<ImuSample>,
    table: Vec<Entry>,
    packets: usize,
    /// Events written, for messages.
    items: u64,
}

/// What is held back: events or triggers, so that they keep their order.
#[derive(Debug)]
enum Pending {
    None,
    /// In the buffer; `count_at` is where their number belongs.
    Events {
        count_at: usize,
        count: usize,
        t_first: i64,
        t_last: i64,
    },
    Triggers(Vec<Trigger>),
}

/// A packet, for the table.
#[derive(Clone, Copy, Debug)]
struct Entry {
    place: u64,
    stream: i32,
    bytes: i32,
    count: usize,
    t_first: i64,
    t_last: i64,
}

impl Aedat4Encoder {
    /// The header; `table` is where the table of packets is.
    fn header(&self, table: Option<u64>) -> Result<Vec<u8>, Error> {
        let mut text = info::text(&self.streams, compression::name(self.compression));
        if text.len() > INFO_BYTES {
            let what =
                format!("triggers of more inputs than the header has room for, {}", self.streams.len());
            return Err(self.refused(what, "write them into a format with a camera's bytes, such as .raw"));
        }
        text.extend(std::iter::repeat_n(' ', INFO_BYTES - text.len()));
        let mut header = Builder::default();
        let at = header.start(*b"IOHE", &[12, 4, 16], 20);
        header.put(at + 4, table.and_then(|at| i64::try_from(at).ok()).unwrap_or(-1).to_le_bytes());
        header.put(at + 12, self.number.to_le_bytes());
        header.vector(at + 16, text.len(), 4);
        header.extend(text.as_bytes());
        header.extend(&[0]);
        Ok(header.finish().to_vec())
    }

    fn refused(&self, what: String, remedy: &str) -> Error {
        write::refused(self.output.path(), self.items, &what, remedy)
    }

    fn time(&self, t: u64) -> Result<i64, Error> {
        let late =
            || self.refused(format!("{t} µs is beyond the 2^63 µs of the format"), "write it with --rebase");
        i64::try_from(t).map_err(|_| late())
    }

    /// The number of the stream of this kind, which is declared where it is new.
    fn stream(
        &mut self,
        kind: &str,
        name: &str,
        geometry: Option<Geometry>,
        channel: Option<u8>,
    ) -> Result<i32, Error> {
        let found = self.streams.iter().find(|one| one.kind == kind && one.channel == channel);
        if let Some(found) = found {
            return Ok(found.id);
        }
        let id = self.streams.len() as i32;
        self.streams.push(Declared::new(id, kind, name, geometry, channel));
        // Refused at once where the header has no room for it.
        self.header(None).map(|_| id)
    }

    /// Writes the buffer as a packet.
    fn packet(&mut self, stream: i32, count: usize, t_first: i64, t_last: i64) -> Result<(), Error> {
        let body = self.packer.pack(self.buffer.finish());
        let bytes = i32::try_from(body.len()).unwrap_or(i32::MAX);
        self.output.write(&[stream.to_le_bytes(), bytes.to_le_bytes()].concat())?;
        let place = self.output.len();
        self.output.write(body)?;
        self.packets += 1;
        if self.table.len() < TABLE_PACKETS_MAX {
            self.table.push(Entry { place, stream, bytes, count, t_first, t_last });
        }
        Ok(())
    }

    /// Writes the events or triggers held back.
    fn flush(&mut self) -> Result<(), Error> {
        match std::mem::replace(&mut self.pending, Pending::None) {
            Pending::None => Ok(()),
            Pending::Events { count_at, count, t_first, t_last } => {
                self.buffer.put(count_at, (count as u32).to_le_bytes());
                self.packet(0, count, t_first, t_last)
            }
            Pending::Triggers(triggers) => self.write_triggers(&triggers),
        }
    }

    /// Triggers of one input.
    fn write_triggers(&mut self, triggers: &[Trigger]) -> Result<(), Error> {
        let (Some(first), Some(last)) = (triggers.first(), triggers.last()) else { return Ok(()) };
        let stream = match first.channel {
            0 => self.stream("TRIG", "triggers", None, None)?,
            channel => self.stream("TRIG", &format!("triggers{channel}"), None, Some(channel))?,
        };
        let elements = self.start_tables(*b"TRIG", triggers.len());
        let vtable = self.buffer.vtable(&[4, 12], 16);
        for (i, trigger) in triggers.iter().enumerate() {
            let table = self.buffer.table(vtable);
            self.buffer.refer(elements + 4 * i, table);
            self.buffer.put(table + 4, (trigger.t as i64).to_le_bytes());
            self.buffer.put(table + 12, [if trigger.edge == Polarity::On { 1 } else { 2 }]);
        }
        self.packet(stream, triggers.len(), first.t as i64, last.t as i64)
    }

    fn write_samples(&mut self) -> Result<(), Error> {
        let samples = std::mem::take(&mut self.samples);
        let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return Ok(()) };
        let stream = self.stream("IMUS", "imu", None, None)?;
        // The buffer may hold events.
        self.flush()?;
        let elements = self.start_tables(*b"IMUS", samples.len());
        for (i, sample) in samples.iter().enumerate() {
            let vtable = self.sample_vtable(sample);
            let table = self.buffer.table(vtable);
            self.buffer.refer(elements + 4 * i, table);
            self.buffer.put(table + 4, (sample.t as i64).to_le_bytes());
            let acceleration = sample.acceleration.map(|a| a / GRAVITY);
            let rotation = sample.rotation.map(f64::to_degrees);
            let numbers =
                [sample.temperature.unwrap_or_default()].into_iter().chain(acceleration).chain(rotation);
            let numbers = numbers.chain(sample.magnetic_field.into_iter().flatten());
            for (place, number) in (table + 12..).step_by(4).zip(numbers) {
                self.buffer.put(place, (number as f32).to_le_bytes());
            }
        }
        self.packet(stream, samples.len(), first.t as i64, last.t as i64)?;
        self.samples = samples;
        self.samples.clear();
        Ok(())
    }

    /// What is not measured is absent.
    fn sample_vtable(&mut self, sample: &ImuSample) -> usize {
        let temperature = if sample.temperature.is_some() { 12 } else { 0 };
        let magnetic = sample.magnetic_field.map_or([0; 3], |_| [40, 44, 48]);
        let bytes = if sample.magnetic_field.is_some() { 52 } else { 40 };
        let [mx, my, mz] = magnetic;
        self.buffer.vtable(&[4, temperature, 16, 20, 24, 28, 32, 36, mx, my, mz], bytes)
    }

    /// Starts a buffer with a vector of tables; tells where the offsets to them belong.
    fn start_tables(&mut self, letters: [u8; 4], count: usize) -> usize {
        let root = self.buffer.start(letters, &[4], 8);
        let elements = self.buffer.vector(root + 4, count, 4);
        self.buffer.extend(&vec![0; 4 * count]);
        elements
    }

    /// The table of packets, at the end.
    fn write_table(&mut self) -> Result<Option<u64>, Error> {
        if self.packets > TABLE_PACKETS_MAX {
            return Ok(None);
        }
        let entries = std::mem::take(&mut self.table);
        let elements = self.start_tables(*b"FTAB", entries.len());
        let vtable = self.buffer.vtable(&[4, 12, 20, 28, 36], 44);
        for (i, entry) in entries.iter().enumerate() {
            let table = self.buffer.table(vtable);
            self.buffer.refer(elements + 4 * i, table);
            self.buffer.put(table + 4, entry.place.to_le_bytes());
            self.buffer.put(table + 12, entry.stream.to_le_bytes());
            self.buffer.put(table + 16, entry.bytes.to_le_bytes());
            self.buffer.put(table + 20, (entry.count as u64).to_le_bytes());
            self.buffer.put(table + 28, entry.t_first.to_le_bytes());
            self.buffer.put(table + 36, entry.t_last.to_le_bytes());
        }
        let place = self.output.len();
        self.output.write(self.packer.pack(self.buffer.finish()))?;
        Ok(Some(place))
    }

    /// Starts a packet of events, unless there is one already; tells how many it holds.
    fn start_events(&mut self, t: i64) -> Result<usize, Error> {
        if let Pending::Events { count, .. } = self.pending
            && count < EVENTS_MAX
        {
            return Ok(count);
        }
        self.flush()?;
        let root = self.buffer.start(*b"EVTS", &[4], 8);
        let first = self.buffer.vector(root + 4, 0, 8);
        self.pending = Pending::Events { count_at: first - 4, count: 0, t_first: t, t_last: t };
        Ok(0)
    }
}

impl Encoder for Aedat4Encoder {
    fn events(&mut self, span: Span<'_>) -> Result<(), Error> {
        let mut rest = span.events;
        while let Some(first) = rest.first() {
            let held = self.start_events(self.time(span.time(*first))?)?;
            let (now, later) = rest.split_at(rest.len().min(EVENTS_MAX - held));
            for event in now {
                let t = self.time(span.time(*event))?;
                let word = t as u64 as u128
                    | u128::from(event.x()) << 64
                    | u128::from(event.y()) << 80
                    | u128::from(event.is_on()) << 96;
                self.buffer.extend(&word.to_le_bytes());
                self.items += 1;
                if let Pending::Events { count, t_last, .. } = &mut self.pending {
                    (*count, *t_last) = (*count + 1, t);
                }
            }
            rest = later;
        }
        Ok(())
    }

    /// An input other than 0 gets a stream of its own.
    fn trigger(&mut self, trigger: Trigger) -> Result<Kept, Error> {
        self.time(trigger.t)?;
        match &mut self.pending {
            Pending::Triggers(held)
                if held.len() < TRIGGERS_MAX
                    && held.first().is_some_and(|one| one.channel == trigger.channel) =>
            {
                held.push(trigger);
            }
            _ => {
                self.flush()?;
                self.pending = Pending::Triggers(vec![trigger]);
            }
        }
        Ok(Kept::Yes)
    }

    /// In 32-bit floats of g, °/s, µT and °C.
    fn imu(&mut self, sample: &ImuSample) -> Result<Kept, Error> {
        self.time(sample.t)?;
        self.samples.push(*sample);
        if self.samples.len() == SAMPLES_MAX {
            self.write_samples()?;
        }
        Ok(Kept::Yes)
    }

    fn frame(&mut self, frame: &Frame) -> Result<Kept, Error> {
        let t = self.time(frame.t)?;
        let exposure = match &frame.exposure {
            Some(exposure) => Some((self.time(exposure.start)?, self.time(exposure.end)?)),
            None => None,
        };
        let expected = usize::from(frame.width) * usize::from(frame.height) * frame.format.bytes();
        if frame.pixels.len() != expected {
            let what = format!("a frame has {} bytes of pixels, not {expected}", frame.pixels.len());
            return Err(self.refused(what, "give width * height * format.bytes() of them"));
        }
        let sides = [frame.width, frame.height, frame.x, frame.y].map(|side| i16::try_from(side).ok());
        let [Some(width), Some(height), Some(x), Some(y)] = sides else {
            let what =
                format!("a frame of {}x{} pixels is beyond the format's 32767", frame.width, frame.height);
            return Err(self.refused(what, "leave frames out, or crop them"));
        };
        let stream = self.stream("FRME", "frames", Some(self.geometry), None)?;
        self.flush()?;
        let (start, end, long) = if exposure.is_some() { (12, 20, 28) } else { (0, 0, 0) };
        let fields = [4, 0, 0, start, end, 48, 40, 42, 44, 46, 36, long, 49];
        let table = self.buffer.start(*b"FRME", &fields, 52);
        self.buffer.put(table + 4, t.to_le_bytes());
        if let Some((start, end)) = exposure {
            self.buffer.put(table + 12, start.to_le_bytes());
            self.buffer.put(table + 20, end.to_le_bytes());
            self.buffer.put(table + 28, end.saturating_sub(start).to_le_bytes());
        }
        for (place, side) in (table + 40..).step_by(2).zip([width, height, x, y]) {
            self.buffer.put(place, side.to_le_bytes());
        }
        let (format, pixels) = pixels(frame);
        self.buffer.put(table + 48, [format, FROM_SENSOR]);
        self.buffer.vector(table + 36, pixels.len(), 4);
        self.buffer.extend(&pixels);
        self.packet(stream, 1, t, t)?;
        Ok(Kept::Yes)
    }

    fn finish(mut self: Box<Self>) -> Result<u64, Error> {
        self.write_samples()?;
        self.flush()?;
        let table = self.write_table()?;
        let header = self.header(table)?;
        self.output.write_at(MAGIC.len() as u64, &header)?;
        self.output.finish()
    }
}

/// Where a frame comes from.
const FROM_SENSOR: u8 = 1;

/// OpenCV's number of a layout, and the pixels in it: blue comes first.
fn pixels(frame: &Frame) -> (u8, Cow<'_, [u8]>) {
    let number = match frame.format {
        PixelFormat::Gray8 => 0,
        PixelFormat::Gray16 => 2,
        PixelFormat::Bgr8 | PixelFormat::Rgb8 => 16,
        PixelFormat::Bgra8 => 24,
    };
    if frame.format != PixelFormat::Rgb8 {
        return (number, Cow::Borrowed(&frame.pixels));
    }
    let (pixels, _) = frame.pixels.as_chunks::<3>();
    (number, Cow::Owned(pixels.iter().flat_map(|[r, g, b]| [*b, *g, *r]).collect()))
}
