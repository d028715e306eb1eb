//! Writes AEDAT 2.0: events, triggers and samples of the inertial sensor, in the layout of the sensor's size.

use super::clock::Clock;
use super::imu::{self, WORDS};
use super::{CHIPS, Chip, Layout, SIZE_KEY};
use crate::output::Output;
use crate::write::{self, Encoder, Kept, WriteOptions, required};
use crate::{Error, ErrorKind, ImuSample};
use lobula_core::{Event, Geometry, Polarity, Span, Trigger};
use std::path::Path;

/// Bytes gathered before they are written.
const BUFFER_BYTES: usize = 64 << 10;
/// Largest sensor that an address can tell.
const GEOMETRY_MAX: Geometry = Geometry::new(1024, 512);

/// Starts a file.
pub(super) fn create(
    path: &Path,
    geometry: Option<Geometry>,
    options: &WriteOptions,
) -> Result<Box<dyn Encoder>, Error> {
    let geometry = required(geometry, path)?;
    if geometry.width > GEOMETRY_MAX.width || geometry.height > GEOMETRY_MAX.height {
        let what = format!("cannot be written: AEDAT 2.0 holds sensors up to {GEOMETRY_MAX}, not {geometry}");
        let remedy = "crop the events or choose another format";
        return Err(Error::new(ErrorKind::Refused, path, what, remedy));
    }
    let chip = chip(geometry);
    let mut output = Output::create(path, options.overwrite)?;
    output.write(header(geometry).as_bytes())?;
    Ok(Box::new(Aedat2Encoder { output, chip, clock: Clock::default(), items: 0, buffer: Vec::new() }))
}

/// The layout of a sensor of this size.
fn chip(geometry: Geometry) -> Chip {
    let layout = CHIPS.iter().find(|(.., size)| *size == geometry).map_or(Layout::Davis, |chip| chip.1);
    Chip { layout, geometry }
}

/// The header, in the words of jAER; it knows no name for sensors of other sizes.
fn header(geometry: Geometry) -> String {
    let name = match (geometry.width, geometry.height) {
        (128, 128) => "ch.unizh.ini.jaer.chip.retina.DVS128",
        (240, 180) => "eu.seebetter.ini.chips.davis.DAVIS240C",
        (346, 260) => "eu.seebetter.ini.chips.davis.Davis346B",
        (640, 480) => "eu.seebetter.ini.chips.davis.Davis640",
        (208, 192) => "eu.seebetter.ini.chips.davis.Davis208PixelParade",
        _ => "",
    };
    let chip = if name.is_empty() { String::new() } else { format!("# AEChip: {name}\r\n") };
    format!(
        "#!AER-DAT2.0\r\n# This is a raw AE data file - do not edit\r\n\
         # Data format is int32 address, int32 timestamp (8 bytes total), repeated for each event\r\n\
         # Timestamps tick is 1 us\r\n# created by lobula\r\n# {SIZE_KEY}: {geometry}\r\n{chip}# End of ASCII Header\r\n"
    )
}

#[derive(Debug)]
struct Aedat2Encoder {
    output: Output,
    chip: Chip,
    /// The clock of a reader of what is written.
    clock: Clock,
    /// Events and others written.
    items: u64,
    buffer: Vec<u8>,
}

impl Aedat2Encoder {
    fn put(&mut self, address: u32, t: u64) -> Result<(), Error> {
        let reading = self.reading(t)?;
        self.buffer.extend_from_slice(&address.to_be_bytes());
        self.buffer.extend_from_slice(&reading.to_be_bytes());
        if self.buffer.len() < BUFFER_BYTES {
            return Ok(());
        }
        self.flush()
    }

    fn flush(&mut self) -> Result<(), Error> {
        self.output.write(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }

    /// What the counter reads at `t`, from which a reader comes to `t` again.
    fn reading(&mut self, t: u64) -> Result<u32, Error> {
        let reader = self.clock.peek(t as u32);
        if u64::try_from(reader) == Ok(t) && (self.clock.is_started() || t >> 31 == 0) {
            self.clock.set(reader);
            return Ok(t as u32);
        }
        Err(match self.clock.is_started() {
            true => self.refused(
                format!("the step to {t} µs would read as one to {reader} µs"),
                "sort it first, or choose another format",
            ),
            false => self.refused(
                format!("the start at {t} µs is beyond the 2^31 µs of the format"),
                "write it with --rebase",
            ),
        })
    }

    fn refused(&self, what: String, remedy: &str) -> Error {
        write::refused(self.output.path(), self.items, &what, remedy)
    }

    fn address(&self, event: Event) -> u32 {
        let Geometry { width, height } = self.chip.geometry;
        let x = u32::from(width - 1 - event.x());
        let y = u32::from(height - 1 - event.y());
        let on = u32::from(event.is_on());
        match self.chip.layout {
            Layout::Davis => y << 22 | x << 12 | on << 11,
            Layout::Dvs128 => y << 8 | x << 1 | (1 - on),
        }
    }
}

impl Encoder for Aedat2Encoder {
    fn events(&mut self, span: Span<'_>) -> Result<(), Error> {
        for event in span.events {
            self.put(self.address(*event), span.time(*event))?;
            self.items += 1;
        }
        Ok(())
    }

    /// The format has one input, and tells the edge in the DAVIS layout only.
    fn trigger(&mut self, trigger: Trigger) -> Result<Kept, Error> {
        let address = match (trigger.channel, self.chip.layout, trigger.edge) {
            (0, Layout::Davis, Polarity::On) => 0x403,
            (0, Layout::Davis, Polarity::Off) => 0x402,
            (0, Layout::Dvs128, Polarity::On) => 0x8000,
            _ => return Ok(Kept::No),
        };
        self.put(address, trigger.t)?;
        Ok(Kept::Yes)
    }

    /// To the nearest step: 1/8192 g, 1/65.5 °/s, 1/340 °C.
    fn imu(&mut self, sample: &ImuSample) -> Result<Kept, Error> {
        let words = imu::words(sample).filter(|_| self.chip.layout == Layout::Davis);
        let Some(words): Option<[i16; WORDS]> = words else { return Ok(Kept::No) };
        for (which, value) in (0u32..).zip(words) {
            let address = 0x8000_0C00 | which << 28 | u32::from(value as u16) << 12;
            self.put(address, sample.t)?;
        }
        Ok(Kept::Without(imu::left_out(sample)))
    }

    fn finish(mut self: Box<Self>) -> Result<u64, Error> {
        self.flush()?;
        self.output.finish()
    }
}
