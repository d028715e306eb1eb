//! Writes Prophesee RAW files, in constant memory, under a temporary name until all is there.

use super::GEOMETRY_MAX;
use crate::output::Output;
use crate::{Chunk, Error, ErrorKind, Part};
use lobula_core::wire::{AnyEncoder, Encoding, WordOrder};
use lobula_core::{Encode, Event, Geometry, Refused, Span, Trigger};
use std::path::Path;

/// What to do where the file should differ from the events given.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct WriteOptions {
    /// Whether to replace a file that is there. Default: no.
    pub overwrite: bool,
    /// What to subtract from every time. Default: nothing.
    pub rebase: Rebase,
}

/// What to subtract from every time before it is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rebase {
    /// Nothing: times stay.
    #[default]
    Off,
    /// The time of the first event or trigger, which is written as 0.
    First,
    /// This many µs.
    By(u64),
}

/// What was written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Events.
    pub events: u64,
    /// Triggers.
    pub triggers: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// What was subtracted from every time, in µs.
    pub rebased_us: u64,
}

/// Events encoded at once, where they must be copied.
const BATCH: usize = 1024;
/// Bytes encoded at once.
const CODE_BYTES: usize = 32 << 10;

/// A RAW file being written. It gets its name in [`finish`](Self::finish); dropped before, it leaves nothing.
///
/// ```
/// use lobula_core::{Event, Geometry, Polarity, Span, wire::Encoding};
/// use lobula_formats::{RawWriter, WriteOptions};
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("one.raw");
/// let geometry = Geometry::new(1280, 720);
/// let mut writer = RawWriter::create(&path, Encoding::Evt2, geometry, &WriteOptions::default())?;
/// let events = [Event::new(5000, 640, 360, Polarity::On)];
/// writer.write(Span { t_first: 5000, t_last: 5000, geometry, events: &events })?;
/// assert_eq!(writer.finish()?.events, 1);
/// assert_eq!(lobula_formats::open(&path)?.geometry(), Some(geometry));
/// # Ok::<(), lobula_formats::Error>(())
/// ```
#[derive(Debug)]
pub struct RawWriter {
    output: Output,
    encoder: AnyEncoder,
    geometry: Geometry,
    rebase: Rebase,
    written: Written,
    code: Box<[u8]>,
}

impl RawWriter {
    /// Starts a file of this encoding for a sensor of this size.
    ///
    /// # Errors
    /// Where the file is there already, cannot be made, or the sensor is larger than the encoding can tell.
    pub fn create(
        path: impl AsRef<Path>,
        encoding: Encoding,
        geometry: Geometry,
        options: &WriteOptions,
    ) -> Result<Self, Error> {
        let path = path.as_ref();
        if geometry.width > GEOMETRY_MAX.width || geometry.height > GEOMETRY_MAX.height {
            let what =
                format!("cannot be written: {encoding} holds sensors up to {GEOMETRY_MAX}, not {geometry}");
            return Err(Error::new(
                ErrorKind::Refused,
                path,
                what,
                "crop the events or choose another format",
            ));
        }
        let mut output = Output::create(path, options.overwrite)?;
        let header = header(encoding, geometry);
        output.write(header.as_bytes())?;
        let written = Written { bytes: header.len() as u64, ..Written::default() };
        let code = vec![0; CODE_BYTES].into_boxed_slice();
        let encoder = AnyEncoder::new(encoding);
        Ok(Self { output, encoder, geometry, rebase: options.rebase, written, code })
    }

    /// Adds events, in order.
    ///
    /// # Errors
    /// Where the encoding cannot hold an event (nothing is ever wrapped or dropped), or the disk fails. The file is
    /// then not to be finished.
    pub fn write(&mut self, span: Span<'_>) -> Result<(), Error> {
        self.check_on_sensor(span)?;
        let Some(first) = span.events.first() else { return Ok(()) };
        let by = self.rebased_us(span.time(*first));
        if by == 0 {
            return self.encode(span);
        }
        let mut copy = [Event::default(); BATCH];
        for events in span.events.chunks(BATCH) {
            for (event, slot) in events.iter().zip(&mut copy) {
                let t = span.time(*event);
                let t = t.checked_sub(by).ok_or_else(|| self.before_base(t, by))?;
                *slot = Event::new(t as u32, event.x(), event.y(), event.polarity());
            }
            let (Some(first), Some(last)) = (events.first(), events.last()) else { break };
            let (t_first, t_last) = (span.time(*first) - by, span.time(*last) - by);
            self.encode(Span { t_first, t_last, events: &copy[..events.len()], ..span })?;
        }
        Ok(())
    }

    /// Adds an edge of a trigger input, after the events added so far.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_trigger(&mut self, trigger: Trigger) -> Result<(), Error> {
        let by = self.rebased_us(trigger.t);
        let t = trigger.t.checked_sub(by).ok_or_else(|| self.before_base(trigger.t, by))?;
        loop {
            let done = self.encoder.trigger(Trigger { t, ..trigger }, &mut self.code);
            self.put(done.bytes)?;
            self.written.triggers += done.events as u64;
            match done.refused {
                Some(refused) => return Err(self.refused(refused)),
                None if done.events == 1 => return Ok(()),
                None => {}
            }
        }
    }

    /// Adds the events of a chunk with the triggers among them.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_chunk(&mut self, chunk: &Chunk<'_>) -> Result<(), Error> {
        chunk.parts().try_for_each(|part| match part {
            Part::Events(span) => self.write(span),
            Part::Trigger(trigger) => self.write_trigger(trigger),
        })
    }

    /// What is subtracted from every time: settled by `t`, where that is the first.
    fn rebased_us(&mut self, t: u64) -> u64 {
        if self.written.events + self.written.triggers == 0 {
            self.written.rebased_us = match self.rebase {
                Rebase::Off => 0,
                Rebase::First => t,
                Rebase::By(by) => by,
            };
        }
        self.written.rebased_us
    }

    fn encode(&mut self, mut span: Span<'_>) -> Result<(), Error> {
        loop {
            let done = self.encoder.encode(span, &mut self.code);
            self.put(done.bytes)?;
            self.written.events += done.events as u64;
            if let Some(refused) = done.refused {
                return Err(self.refused(refused));
            }
            span = span.with_events(&span.events[done.events..]);
            if span.events.is_empty() {
                return Ok(());
            }
        }
    }

    fn put(&mut self, len: usize) -> Result<(), Error> {
        self.written.bytes += len as u64;
        self.output.write(&self.code[..len])
    }

    /// Writes what is held back and gives the file its name.
    ///
    /// # Errors
    /// Where the disk fails.
    pub fn finish(mut self) -> Result<Written, Error> {
        loop {
            let len = self.encoder.finish(&mut self.code);
            if len == 0 {
                break;
            }
            self.put(len)?;
        }
        self.output.finish()?;
        Ok(self.written)
    }

    /// Every reader drops events off the sensor that the header tells.
    fn check_on_sensor(&self, span: Span<'_>) -> Result<(), Error> {
        let (own, given) = (self.geometry, span.geometry);
        if given.width <= own.width && given.height <= own.height {
            return Ok(());
        }
        let Some(off) = span.events.iter().find(|event| !own.contains(event.x(), event.y())) else {
            return Ok(());
        };
        let what = format!("cannot be written: pixel ({}, {}) is off the {own} sensor", off.x(), off.y());
        let remedy = "give the true size with --sensor-size WxH, or crop the events";
        Err(Error::new(ErrorKind::Refused, self.path(), what, remedy))
    }

    fn before_base(&self, t: u64, by: u64) -> Error {
        let what = format!("cannot be written: an event at {t} µs is earlier than the {by} µs to subtract");
        let remedy = "rebase by less, with --rebase MICROSECONDS";
        Error::new(ErrorKind::Refused, self.path(), what, remedy)
    }

    fn refused(&self, refused: Refused) -> Error {
        let (what, remedy) = match refused {
            Refused::StartTooLate { t } => {
                (format!("the start at {t} µs is beyond the 2^40 µs of the format"), "write it with --rebase")
            }
            Refused::StepBack { from, to } => (
                format!("time steps back from {from} to {to} µs, which would read as a wrap"),
                "sort it first",
            ),
            Refused::OffFormat { x, y } => {
                (format!("pixel ({x}, {y}) is beyond the format's {GEOMETRY_MAX}"), "crop the events first")
            }
            Refused::NoChannel { channel } => {
                (format!("trigger input {channel} is beyond the format's"), "choose another encoding")
            }
        };
        let what = format!("cannot be written after event {}: {what}", self.written.events);
        Error::new(ErrorKind::Refused, self.path(), what, remedy)
    }

    fn path(&self) -> &Path {
        self.output.path()
    }
}

/// The header, in the words that OpenEB reads.
fn header(encoding: Encoding, geometry: Geometry) -> String {
    let Geometry { width, height } = geometry;
    let (evt, format, endianness) = match encoding {
        Encoding::Evt2 => ("2.0", "EVT2", None),
        Encoding::Evt21(WordOrder::Little) => ("2.1", "EVT21", Some("little")),
        Encoding::Evt21(WordOrder::Legacy) => ("2.1", "EVT21", Some("legacy")),
        Encoding::Evt3 => ("3.0", "EVT3", None),
    };
    let order = endianness.map(|order| format!(";endianness={order}")).unwrap_or_default();
    let line = endianness.map(|order| format!("% endianness {order}\n")).unwrap_or_default();
    format!(
        "{line}% evt {evt}\n% format {format}{order};height={height};width={width}\n% geometry {width}x{height}\n% end\n"
    )
}
