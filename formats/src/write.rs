//! Writes a recording: what all formats have in common. Constant memory, nothing wrapped, nothing lost silently.

use crate::{Chunk, Error, ErrorKind, FORMATS, Format, Frame, ImuSample, Part};
use lobula_core::wire::Encoding;
use lobula_core::{Event, Geometry, Span, Trigger};
use std::fmt::Debug;
use std::path::{Path, PathBuf};

/// How to write; what is absent is the format's default. Each option is the tool's of the same name.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct WriteOptions {
    /// Name of the format or one of its extensions, in place of what the end of the file's name says.
    pub format: Option<String>,
    /// How events are encoded, in formats with a camera's bytes. Default: EVT3.
    pub encoding: Option<Encoding>,
    /// How the file is compressed, in formats that can be.
    pub compression: Option<Compression>,
    /// Which layout, in formats that have several (HDF5: `lobula`, `dsec`).
    pub layout: Option<String>,
    /// Whether to replace a file that is there. Default: no.
    pub overwrite: bool,
    /// What to subtract from every time. Default: nothing.
    pub rebase: Rebase,
}

/// How a file is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // they are what they are
pub enum Compression {
    None,
    Lz4,
    Lz4High,
    Zstd,
    ZstdHigh,
    Gzip,
    Bz2,
}

impl Compression {
    /// Every one.
    pub const ALL: [Self; 7] =
        [Self::None, Self::Lz4, Self::Lz4High, Self::Zstd, Self::ZstdHigh, Self::Gzip, Self::Bz2];

    /// Its name in options.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Lz4 => "lz4",
            Self::Lz4High => "lz4-high",
            Self::Zstd => "zstd",
            Self::ZstdHigh => "zstd-high",
            Self::Gzip => "gzip",
            Self::Bz2 => "bz2",
        }
    }
}

impl std::str::FromStr for Compression {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|one| one.name() == text);
        found.ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|one| one.name()).collect();
            format!("give one of {}, not {text}", names.join(", "))
        })
    }
}

/// What to subtract from every time before it is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rebase {
    /// Nothing: times stay.
    #[default]
    Off,
    /// The time of the first item, which is written as 0.
    First,
    /// This many µs.
    By(u64),
}

/// What was written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Written {
    /// Events.
    pub events: u64,
    /// Triggers.
    pub triggers: u64,
    /// Samples of the inertial sensor.
    pub imu: u64,
    /// Frames.
    pub frames: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// What was subtracted from every time, in µs.
    pub rebased_us: u64,
    /// What was given and has no place in the format.
    pub left_out: LeftOut,
}

/// What a format has no place for: side items, and parts of those that it holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct LeftOut {
    /// Triggers.
    pub triggers: u64,
    /// Samples of the inertial sensor.
    pub imu: u64,
    /// Frames.
    pub frames: u64,
    /// Magnetic fields of samples that were written.
    pub magnetic_fields: u64,
    /// Temperatures of samples that were written.
    pub temperatures: u64,
    /// Samples without a temperature, where the format cannot tell that: they were written with 35 °C.
    pub temperatures_unknown: u64,
    /// Exposures of frames that were written.
    pub exposures: u64,
    /// Positions on the sensor of frames that were written and do not begin at its corner.
    pub positions: u64,
}

impl LeftOut {
    /// What is missing: each count with what it counts, for people.
    pub const fn counts(&self) -> [(u64, &'static str); 7] {
        [
            (self.triggers, "triggers"),
            (self.imu, "IMU samples"),
            (self.frames, "frames"),
            (self.magnetic_fields, "magnetic fields of IMU samples"),
            (self.temperatures, "temperatures of IMU samples"),
            (self.exposures, "exposures of frames"),
            (self.positions, "positions of frames"),
        ]
    }

    /// Counts the parts that an item was written without; whether it was written.
    fn parts_of(&mut self, kept: Kept) -> bool {
        let parts = match kept {
            Kept::Yes => return true,
            Kept::No => return false,
            Kept::Without(parts) => parts,
        };
        let count = |all: &mut u64, left_out: bool| *all += u64::from(left_out);
        count(&mut self.magnetic_fields, parts.magnetic_field);
        count(&mut self.temperatures, parts.temperature);
        count(&mut self.temperatures_unknown, parts.temperature_unknown);
        count(&mut self.exposures, parts.exposure);
        count(&mut self.positions, parts.position);
        true
    }
}

/// Parts of an item that its format has no place for: as in [`LeftOut`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Parts {
    pub magnetic_field: bool,
    pub temperature: bool,
    pub temperature_unknown: bool,
    pub exposure: bool,
    pub position: bool,
}

/// What a format that can be written owes. Rebasing, checks against the sensor's size and counts are done before.
pub(crate) trait Encoder: Debug + Send {
    /// Adds events, all on the sensor.
    fn events(&mut self, span: Span<'_>) -> Result<(), Error>;

    /// Adds an edge of a trigger input, after the events added so far.
    fn trigger(&mut self, trigger: Trigger) -> Result<Kept, Error> {
        let _ = trigger;
        Ok(Kept::No)
    }

    /// Adds a sample of the inertial sensor.
    fn imu(&mut self, sample: &ImuSample) -> Result<Kept, Error> {
        let _ = sample;
        Ok(Kept::No)
    }

    /// Adds a frame.
    fn frame(&mut self, frame: &Frame) -> Result<Kept, Error> {
        let _ = frame;
        Ok(Kept::No)
    }

    /// Writes what is held back and gives the file its name; tells its length in bytes.
    fn finish(self: Box<Self>) -> Result<u64, Error>;
}

/// Whether a format has a place for a side item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kept {
    /// It was written.
    Yes,
    /// It was written without these parts, if any.
    Without(Parts),
    /// It has none: the item is counted as left out.
    No,
}

/// Starts a file for a sensor of this size, if it is known.
pub(crate) type Create = fn(&Path, Option<Geometry>, &WriteOptions) -> Result<Box<dyn Encoder>, Error>;

/// Events copied at once, where their times change.
const BATCH: usize = 1024;

/// A recording being written. It gets its name in [`finish`](Self::finish); dropped before, it leaves nothing.
///
/// ```
/// use lobula_core::{Event, Geometry, Polarity, Span};
/// use lobula_formats::{WriteOptions, Writer};
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("one.raw");
/// let geometry = Geometry::new(1280, 720);
/// let mut writer = Writer::create(&path, Some(geometry), &WriteOptions::default())?;
/// let events = [Event::new(5000, 640, 360, Polarity::On)];
/// writer.write(Span { t_first: 5000, t_last: 5000, geometry, events: &events })?;
/// assert_eq!(writer.finish()?.events, 1);
/// assert_eq!(lobula_formats::open(&path)?.geometry(), Some(geometry));
/// # Ok::<(), lobula_formats::Error>(())
/// ```
#[derive(Debug)]
pub struct Writer {
    path: PathBuf,
    encoder: Box<dyn Encoder>,
    geometry: Option<Geometry>,
    rebase: Rebase,
    written: Written,
}

impl Writer {
    /// Starts a file in the format that its name ends in, for a sensor of this size; `None` where it is unknown.
    ///
    /// # Errors
    /// Where the file is there already or cannot be made, no format has this name, or the format needs the sensor's
    /// size or cannot hold it.
    pub fn create(
        path: impl AsRef<Path>,
        geometry: Option<Geometry>,
        options: &WriteOptions,
    ) -> Result<Self, Error> {
        let path = path.as_ref();
        let create = create_of(path, options)?;
        let encoder = create(path, geometry, options)?;
        let written = Written::default();
        Ok(Self { path: path.to_owned(), encoder, geometry, rebase: options.rebase, written })
    }

    /// Adds events, in order.
    ///
    /// # Errors
    /// Where the format cannot hold an event (nothing is ever wrapped or dropped), or the disk fails. The file is
    /// then not to be finished.
    pub fn write(&mut self, span: Span<'_>) -> Result<(), Error> {
        self.check_on_sensor(span)?;
        let Some(first) = span.events.first() else { return Ok(()) };
        match self.rebased_us(span.time(*first)) {
            0 => self.encoder.events(span)?,
            by => self.write_earlier(span, by)?,
        }
        self.written.events += span.events.len() as u64;
        Ok(())
    }

    /// Adds events with `by` µs less.
    fn write_earlier(&mut self, span: Span<'_>, by: u64) -> Result<(), Error> {
        let mut copy = [Event::default(); BATCH];
        for events in span.events.chunks(BATCH) {
            for (event, slot) in events.iter().zip(&mut copy) {
                let t = self.earlier(span.time(*event), by)?;
                *slot = Event::new(t as u32, event.x(), event.y(), event.polarity());
            }
            let (Some(first), Some(last)) = (events.first(), events.last()) else { break };
            let (t_first, t_last) = (span.time(*first) - by, span.time(*last) - by);
            self.encoder.events(Span { t_first, t_last, events: &copy[..events.len()], ..span })?;
        }
        Ok(())
    }

    /// Adds an edge of a trigger input, after the events added so far.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_trigger(&mut self, trigger: Trigger) -> Result<(), Error> {
        let by = self.rebased_us(trigger.t);
        let t = self.earlier(trigger.t, by)?;
        let kept = self.encoder.trigger(Trigger { t, ..trigger })?;
        let left_out = &mut self.written.left_out;
        let count = if left_out.parts_of(kept) { &mut self.written.triggers } else { &mut left_out.triggers };
        *count += 1;
        Ok(())
    }

    /// Adds a sample of the inertial sensor.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_imu(&mut self, sample: &ImuSample) -> Result<(), Error> {
        let by = self.rebased_us(sample.t);
        let t = self.earlier(sample.t, by)?;
        let kept = self.encoder.imu(&ImuSample { t, ..*sample })?;
        let left_out = &mut self.written.left_out;
        let count = if left_out.parts_of(kept) { &mut self.written.imu } else { &mut left_out.imu };
        *count += 1;
        Ok(())
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_frame(&mut self, frame: Frame) -> Result<(), Error> {
        let by = self.rebased_us(frame.t);
        let t = self.earlier(frame.t, by)?;
        let exposure = match &frame.exposure {
            Some(exposure) => Some(self.earlier(exposure.start, by)?..self.earlier(exposure.end, by)?),
            None => None,
        };
        let kept = self.encoder.frame(&Frame { t, exposure, ..frame })?;
        let left_out = &mut self.written.left_out;
        let count = if left_out.parts_of(kept) { &mut self.written.frames } else { &mut left_out.frames };
        *count += 1;
        Ok(())
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

    /// Writes what is held back and gives the file its name.
    ///
    /// # Errors
    /// Where the disk fails.
    pub fn finish(self) -> Result<Written, Error> {
        let bytes = self.encoder.finish()?;
        Ok(Written { bytes, ..self.written })
    }

    /// What is subtracted from every time: settled by `t`, where that is the first.
    fn rebased_us(&mut self, t: u64) -> u64 {
        let Written { events, triggers, imu, frames, left_out, .. } = self.written;
        if events + triggers + imu + frames + left_out.triggers + left_out.imu + left_out.frames == 0 {
            self.written.rebased_us = match self.rebase {
                Rebase::Off => 0,
                Rebase::First => t,
                Rebase::By(by) => by,
            };
        }
        self.written.rebased_us
    }

    fn earlier(&self, t: u64, by: u64) -> Result<u64, Error> {
        t.checked_sub(by).ok_or_else(|| {
            let what =
                format!("cannot be written: an event at {t} µs is earlier than the {by} µs to subtract");
            let remedy = "rebase by less, with --rebase=MICROSECONDS";
            Error::new(ErrorKind::Refused, &self.path, what, remedy)
        })
    }

    /// Every reader drops events off the sensor that the header tells.
    fn check_on_sensor(&self, span: Span<'_>) -> Result<(), Error> {
        let (Some(own), given) = (self.geometry, span.geometry) else { return Ok(()) };
        if given.width <= own.width && given.height <= own.height {
            return Ok(());
        }
        let Some(off) = span.events.iter().find(|event| !own.contains(event.x(), event.y())) else {
            return Ok(());
        };
        let what = format!("cannot be written: pixel ({}, {}) is off the {own} sensor", off.x(), off.y());
        let remedy = "give the true size with --sensor-size WxH, or crop the events";
        Err(Error::new(ErrorKind::Refused, &self.path, what, remedy))
    }
}

/// The size of the sensor, in formats that must tell it.
pub(crate) fn required(geometry: Option<Geometry>, path: &Path) -> Result<Geometry, Error> {
    geometry.ok_or_else(|| {
        let what = "cannot be written: the format tells the size of the sensor, which is unknown";
        Error::new(ErrorKind::NeedsOption, path, what, "give it with --sensor-size WxH")
    })
}

/// Why an encoder does not go on, after so many events.
pub(crate) fn refused(path: &Path, events: u64, what: &str, remedy: &str) -> Error {
    Error::new(ErrorKind::Refused, path, format!("cannot be written after event {events}: {what}"), remedy)
}

/// How a file of this name, or of the format that was asked for, is begun.
fn create_of(path: &Path, options: &WriteOptions) -> Result<Create, Error> {
    let written = || FORMATS.iter().filter(|format| format.writes());
    let format = match &options.format {
        Some(name) => written().find(|format| format.is_called(name)),
        None => written().find(|format| format.has_name(path)),
    };
    format.and_then(|format| format.create).ok_or_else(|| {
        let what = match &options.format {
            Some(name) => format!("cannot be written: no format that we write is called {name}"),
            None => "cannot be written: its name ends in that of no format that we write".to_owned(),
        };
        let known: Vec<_> = written().map(Format::name_with_extensions).collect();
        let remedy = format!("end the name in one of {}, or name the format with --format", known.join(", "));
        Error::new(ErrorKind::UnknownFormat, path, what, remedy)
    })
}

impl Format {
    /// Whether a file's name ends as those of this format do.
    pub(crate) fn has_name(&self, path: &Path) -> bool {
        let name =
            path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        self.extensions.iter().any(|extension| {
            name.strip_suffix(extension).is_some_and(|stem| stem.len() > 1 && stem.ends_with('.'))
        })
    }

    /// Whether this is its name or one of its extensions.
    fn is_called(&self, name: &str) -> bool {
        let mut names = self.extensions.iter().copied().chain([self.name]);
        names.any(|one| one.eq_ignore_ascii_case(name))
    }

    fn name_with_extensions(&self) -> String {
        let extensions: Vec<_> = self.extensions.iter().map(|extension| format!(".{extension}")).collect();
        format!("{} ({})", extensions.join(" "), self.name)
    }
}
