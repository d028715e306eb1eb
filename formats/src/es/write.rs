//! Writes Event Stream files of DVS events.

use super::{DVS, MAGIC, OVERFLOW, OVERFLOW_US, VERSION};
use crate::Error;
use crate::output::Output;
use crate::write::{Encoder, WriteOptions, refused, required};
use lobula_core::{Event, Geometry, Span};
use std::path::Path;

/// Bytes held back until they are written.
const CODE_BYTES: usize = 32 << 10;
/// Longest time without events, of which every 127 µs take a byte: an hour takes 28 MB.
const SILENCE_US_MAX: u64 = 3_600_000_000;

/// Starts a file.
pub(crate) fn create(
    path: &Path,
    geometry: Option<Geometry>,
    options: &WriteOptions,
) -> Result<Box<dyn Encoder>, Error> {
    let geometry = required(geometry, path)?;
    let mut output = Output::create(path, options.overwrite)?;
    let sides = [geometry.width, geometry.height].map(u16::to_le_bytes);
    output.write(&[&MAGIC[..], &VERSION, &[DVS], sides.as_flattened()].concat())?;
    Ok(Box::new(EsEncoder { output, geometry, t: 0, events: 0, code: Vec::with_capacity(CODE_BYTES) }))
}

#[derive(Debug)]
struct EsEncoder {
    output: Output,
    geometry: Geometry,
    /// Time of the last event.
    t: u64,
    /// Events written.
    events: u64,
    code: Vec<u8>,
}

impl EsEncoder {
    fn event(&mut self, t: u64, event: Event) -> Result<(), Error> {
        let (path, (x, y)) = (self.output.path(), (event.x(), event.y()));
        let Some(mut since) = t.checked_sub(self.t) else {
            let what = format!("time steps back from {} to {t} µs, which the format cannot tell", self.t);
            return Err(refused(path, self.events, &what, "sort it first"));
        };
        if since > SILENCE_US_MAX {
            let what = format!("{since} µs without an event would take {} bytes", since / OVERFLOW_US);
            return Err(refused(path, self.events, &what, "write it with --rebase, or cut it"));
        }
        if !self.geometry.contains(x, y) {
            let what = format!("pixel ({x}, {y}) is off the {} sensor", self.geometry);
            return Err(refused(path, self.events, &what, "crop the events first"));
        }
        while since >= OVERFLOW_US {
            self.code.push(OVERFLOW);
            since -= OVERFLOW_US;
            self.put(CODE_BYTES)?;
        }
        let [x0, x1] = x.to_le_bytes();
        let [y0, y1] = (self.geometry.height - 1 - y).to_le_bytes();
        self.code.extend([((since as u8) << 1) | u8::from(event.is_on()), x0, x1, y0, y1]);
        (self.t, self.events) = (t, self.events + 1);
        self.put(CODE_BYTES)
    }

    /// Writes what is held back, if it is at least this much.
    fn put(&mut self, bytes_min: usize) -> Result<(), Error> {
        if self.code.len() >= bytes_min {
            self.output.write(&self.code)?;
            self.code.clear();
        }
        Ok(())
    }
}

impl Encoder for EsEncoder {
    fn events(&mut self, span: Span<'_>) -> Result<(), Error> {
        span.events.iter().try_for_each(|event| self.event(span.time(*event), *event))
    }

    fn finish(mut self: Box<Self>) -> Result<u64, Error> {
        self.put(0)?;
        self.output.finish()
    }
}
