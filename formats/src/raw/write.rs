//! Writes Prophesee RAW files.

use super::GEOMETRY_MAX;
use crate::output::Output;
use crate::write::{self, Encoder, Kept, WriteOptions, required};
use crate::{Error, ErrorKind};
use lobula_core::wire::{AnyEncoder, Encoding, WordOrder};
use lobula_core::{Encode, Geometry, Refused, Span, Trigger};
use std::path::Path;

/// Bytes encoded at once.
const CODE_BYTES: usize = 32 << 10;

/// Starts a file of the encoding asked for.
pub(crate) fn create(
    path: &Path,
    geometry: Option<Geometry>,
    options: &WriteOptions,
) -> Result<Box<dyn Encoder>, Error> {
    let encoding = options.encoding.unwrap_or(Encoding::Evt3);
    let geometry = required(geometry, path)?;
    if geometry.width > GEOMETRY_MAX.width || geometry.height > GEOMETRY_MAX.height {
        let what =
            format!("cannot be written: {encoding} holds sensors up to {GEOMETRY_MAX}, not {geometry}");
        let remedy = "crop the events or choose another format";
        return Err(Error::new(ErrorKind::Refused, path, what, remedy));
    }
    let mut output = Output::create(path, options.overwrite)?;
    output.write(header(encoding, geometry).as_bytes())?;
    let code = vec![0; CODE_BYTES].into_boxed_slice();
    Ok(Box::new(RawEncoder { output, encoder: AnyEncoder::new(encoding), events: 0, code }))
}

#[derive(Debug)]
struct RawEncoder {
    output: Output,
    encoder: AnyEncoder,
    /// Events written.
    events: u64,
    code: Box<[u8]>,
}

impl RawEncoder {
    fn put(&mut self, len: usize) -> Result<(), Error> {
        self.output.write(&self.code[..len])
    }

    fn refused(&self, refused: Refused) -> Error {
        self::refused(refused, self.events, self.output.path())
    }
}

/// Why an event or trigger after these many events cannot be written.
pub(crate) fn refused(refused: Refused, events: u64, path: &Path) -> Error {
    let (what, remedy) = match refused {
        Refused::StartTooLate { t } => {
            (format!("the start at {t} µs is beyond the 2^40 µs of the format"), "write it with --rebase")
        }
        Refused::StepBack { from, to } => {
            (format!("time steps back from {from} to {to} µs, which would read as a wrap"), "sort it first")
        }
        Refused::OffFormat { x, y } => {
            (format!("pixel ({x}, {y}) is beyond the format's {GEOMETRY_MAX}"), "crop the events first")
        }
        Refused::NoChannel { channel } => {
            (format!("trigger input {channel} is beyond the format's"), "choose another encoding")
        }
    };
    write::refused(path, events, &what, remedy)
}

impl Encoder for RawEncoder {
    fn events(&mut self, mut span: Span<'_>) -> Result<(), Error> {
        loop {
            let done = self.encoder.encode(span, &mut self.code);
            self.put(done.bytes)?;
            self.events += done.events as u64;
            if let Some(refused) = done.refused {
                return Err(self.refused(refused));
            }
            span = span.with_events(&span.events[done.events..]);
            if span.events.is_empty() {
                return Ok(());
            }
        }
    }

    fn trigger(&mut self, trigger: Trigger) -> Result<Kept, Error> {
        loop {
            let done = self.encoder.trigger(trigger, &mut self.code);
            self.put(done.bytes)?;
            match done.refused {
                Some(refused) => return Err(self.refused(refused)),
                None if done.events == 1 => return Ok(Kept::Yes),
                None => {}
            }
        }
    }

    fn finish(mut self: Box<Self>) -> Result<u64, Error> {
        loop {
            let len = self.encoder.finish(&mut self.code);
            if len == 0 {
                return self.output.finish();
            }
            self.put(len)?;
        }
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
        Encoding::Evt4 => ("4.0", "EVT4", None),
    };
    let order = endianness.map(|order| format!(";endianness={order}")).unwrap_or_default();
    let line = endianness.map(|order| format!("% endianness {order}\n")).unwrap_or_default();
    format!(
        "{line}% evt {evt}\n% format {format}{order};height={height};width={width}\n% geometry {width}x{height}\n% end\n"
    )
}
