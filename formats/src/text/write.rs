//! Writes text: `.txt` with seconds and spaces, as event data sets have it, `.csv` with µs, commas and a header line.
//! A comment in the first line tells unit, columns and size, so that a file reads back without options.

use crate::names::OWN;
use crate::output::Output;
use crate::packed::Pack;
use crate::write::{Encoder, WriteOptions};
use crate::{Compression, Error, ErrorKind};
use lobula_core::{Event, Geometry, Span};
use std::path::Path;

/// Which of the two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Seconds with six decimals, spaces.
    Txt,
    /// µs, commas, a header line.
    Csv,
}

/// Starts a file.
pub(crate) fn create(
    path: &Path,
    geometry: Option<Geometry>,
    options: &WriteOptions,
) -> Result<Box<dyn Encoder>, Error> {
    let name = path.to_string_lossy().to_ascii_lowercase();
    let asked = options.format.as_deref().map(str::to_ascii_lowercase);
    let asked = asked.as_deref().filter(|format| *format != "text").unwrap_or(&name);
    let (stem, by_name) = match (asked.strip_suffix(".gz"), asked.strip_suffix(".zst")) {
        (Some(stem), _) => (stem, Compression::Gzip),
        (_, Some(stem)) => (stem, Compression::Zstd),
        _ => (asked, Compression::None),
    };
    let kind = if stem.ends_with("csv") { Kind::Csv } else { Kind::Txt };
    let pack = Pack::new(options.compression.unwrap_or(by_name), path)?;
    let output = Output::create(path, options.overwrite)?;
    let mut encoder = TextEncoder { output, pack, kind, text: Vec::with_capacity(2 * TEXT_BYTES) };
    encoder.text.extend(header(kind, geometry).into_bytes());
    Ok(Box::new(encoder))
}

/// Bytes of text held back until they are written.
const TEXT_BYTES: usize = 64 << 10;

fn header(kind: Kind, geometry: Option<Geometry>) -> String {
    let (unit, names) = match kind {
        Kind::Txt => ("s", ""),
        Kind::Csv => ("us", "t,x,y,p\n"),
    };
    let size = geometry.map(|size| format!(" sensor-size={size}")).unwrap_or_default();
    format!("# {OWN} time-unit={unit} columns=t,x,y,p{size}\n{names}")
}

#[derive(Debug)]
struct TextEncoder {
    output: Output,
    pack: Pack,
    kind: Kind,
    text: Vec<u8>,
}

impl TextEncoder {
    fn line(&mut self, t: u64, event: Event) {
        let separator = match self.kind {
            Kind::Txt => {
                number(&mut self.text, t / 1_000_000);
                self.text.push(b'.');
                let fraction = 1_000_000 + t % 1_000_000;
                let at = self.text.len();
                number(&mut self.text, fraction);
                self.text.remove(at);
                b' '
            }
            Kind::Csv => {
                number(&mut self.text, t);
                b','
            }
        };
        for value in [event.x(), event.y(), u16::from(event.is_on())] {
            self.text.push(separator);
            number(&mut self.text, value.into());
        }
        self.text.push(b'\n');
    }

    fn put(&mut self) -> Result<(), Error> {
        self.pack.write(&self.text, &mut self.output)?;
        self.text.clear();
        Ok(())
    }
}

/// Adds a number in decimal digits.
fn number(text: &mut Vec<u8>, mut number: u64) {
    let mut digits = [0; 20];
    let mut at = digits.len();
    for digit in digits.iter_mut().rev() {
        *digit = b'0' + (number % 10) as u8;
        (number, at) = (number / 10, at - 1);
        if number == 0 {
            break;
        }
    }
    text.extend_from_slice(&digits[at..]);
}

impl Encoder for TextEncoder {
    fn events(&mut self, span: Span<'_>) -> Result<(), Error> {
        for event in span.events {
            self.line(span.time(*event), *event);
            if self.text.len() >= TEXT_BYTES {
                self.put()?;
            }
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<u64, Error> {
        self.put()?;
        let Self { mut output, pack, .. } = *self;
        pack.finish(&mut output)?;
        output.finish()
    }
}

impl Pack {
    /// What packs as asked for.
    fn new(compression: Compression, path: &Path) -> Result<Self, Error> {
        Self::of(compression).ok_or_else(|| {
            let what = format!("cannot be written: text is not compressed with {}", compression.name());
            Error::new(ErrorKind::Refused, path, what, "give --compression none, gzip, zstd or zstd-high")
        })
    }
}
