//! Writes Prophesee DAT files, version 2.

use super::{CD, EVENT_BYTES, GEOMETRY_MAX};
use crate::output::Output;
use crate::write::{Encoder, WriteOptions, refused};
use crate::{Error, ErrorKind};
use lobula_core::{Event, Geometry, Span};
use std::path::Path;

/// Events written at once.
const BATCH: usize = 4096;

/// Starts a file; the header has the sensor's size, if it is known.
pub(crate) fn create(
    path: &Path,
    geometry: Option<Geometry>,
    options: &WriteOptions,
) -> Result<Box<dyn Encoder>, Error> {
    if let Some(geometry) = geometry
        && (geometry.width > GEOMETRY_MAX.width || geometry.height > GEOMETRY_MAX.height)
    {
        let what = format!("cannot be written: DAT holds sensors up to {GEOMETRY_MAX}, not {geometry}");
        let remedy = "crop the events or choose another format";
        return Err(Error::new(ErrorKind::Refused, path, what, remedy));
    }
    let mut output = Output::create(path, options.overwrite)?;
    output.write(&header(geometry))?;
    Ok(Box::new(DatEncoder { output, events: 0, code: Vec::with_capacity(BATCH * EVENT_BYTES) }))
}

fn header(geometry: Option<Geometry>) -> Vec<u8> {
    let size = |Geometry { width, height }: Geometry| format!("% Height {height}\n% Width {width}\n");
    let lines = geometry.map(size).unwrap_or_default();
    let mut header = format!("% Data file containing CD events.\n% Version 2\n{lines}").into_bytes();
    header.extend([CD, EVENT_BYTES as u8]);
    header
}

#[derive(Debug)]
struct DatEncoder {
    output: Output,
    /// Events written.
    events: u64,
    code: Vec<u8>,
}

impl DatEncoder {
    fn word(&self, event: Event, t: u64) -> Result<u64, Error> {
        let Ok(low) = u32::try_from(t) else {
            let what = format!("the time {t} µs is beyond the 2^32 µs (71 minutes) of the format");
            return Err(refused(self.output.path(), self.events, &what, "write it with --rebase, or cut it"));
        };
        let (x, y) = (event.x(), event.y());
        if x >= GEOMETRY_MAX.width || y >= GEOMETRY_MAX.height {
            let what = format!("pixel ({x}, {y}) is beyond the format's {GEOMETRY_MAX}");
            return Err(refused(self.output.path(), self.events, &what, "crop the events first"));
        }
        let place = u64::from(x) | (u64::from(y) << 14) | (u64::from(event.is_on()) << 28);
        Ok(u64::from(low) | (place << 32))
    }
}

impl Encoder for DatEncoder {
    fn events(&mut self, span: Span<'_>) -> Result<(), Error> {
        for events in span.events.chunks(BATCH) {
            self.code.clear();
            for event in events {
                let word = self.word(*event, span.time(*event))?;
                self.code.extend(word.to_le_bytes());
                self.events += 1;
            }
            self.output.write(&self.code)?;
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<u64, Error> {
        self.output.finish()
    }
}
