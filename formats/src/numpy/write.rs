//! Writes NumPy arrays (`.npy`, one structured array) and archives (`.npz`, a column each), uncompressed.
//!
//! The length of an array is in its header, so the first bytes are written again at the end. In an archive the columns
//! stand one after the other: those after the first wait in files of their own.

use super::archive;
use super::header::MAGIC;
use super::table::{SENSOR_SIZE, TIME_UNIT};
use crate::names::OWN;
use crate::output::Output;
use crate::write::{Encoder, WriteOptions, refused};
use crate::{Compression, Error, ErrorKind};
use lobula_core::{Geometry, Span};
use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::Path;

/// Events held back until they are written.
const BATCH: usize = 4096;
/// Type of an event in a file of its own.
const RECORD: &str = "[('t', '<i8'), ('x', '<u2'), ('y', '<u2'), ('p', '|u1')]";
/// Columns of an archive: name and type.
const COLUMNS: [(&str, &str); 4] = [("t", "'<i8'"), ("x", "'<u2'"), ("y", "'<u2'"), ("p", "'|u1'")];

/// Starts a file.
pub(crate) fn create(
    path: &Path,
    geometry: Option<Geometry>,
    options: &WriteOptions,
) -> Result<Box<dyn Encoder>, Error> {
    if let Some(compression) = options.compression.filter(|compression| *compression != Compression::None) {
        let what = format!("cannot be written: NumPy files are not compressed with {}", compression.name());
        let remedy = "leave --compression away, or pack the file with another program";
        return Err(Error::new(ErrorKind::Refused, path, what, remedy));
    }
    let name = path.to_string_lossy().to_ascii_lowercase();
    let asked = options.format.as_deref().map(str::to_ascii_lowercase);
    let asked = asked.as_deref().filter(|format| *format != "numpy").unwrap_or(&name);
    let mut output = Output::create(path, options.overwrite)?;
    if asked.ends_with("npz") {
        let archive = archive::Writer::default();
        let encoder = NpzEncoder { columns: Columns::new(path)?, output, archive, geometry, events: 0 };
        return encoder.begin();
    }
    output.write(&header(RECORD, 0, &comment(geometry)))?;
    let rows = Vec::with_capacity(BATCH * 13);
    Ok(Box::new(NpyEncoder { output, geometry, events: 0, rows }))
}

fn comment(geometry: Option<Geometry>) -> String {
    let size = geometry.map(|size| format!(" sensor-size={size}")).unwrap_or_default();
    format!("# {OWN} time-unit=us{size}")
}

/// The header of an array of one dimension; its length does not depend on the number of elements.
fn header(descr: &str, count: u64, comment: &str) -> Vec<u8> {
    growing_header(descr, count, "", comment)
}

/// The header of an array of `count` elements that are arrays themselves, whose extents `inner` tells; its length does
/// not depend on their number.
pub(super) fn growing_header(descr: &str, count: u64, inner: &str, comment: &str) -> Vec<u8> {
    let text = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': ({count},{inner}), }}");
    let digits = u64::MAX.ilog10() as usize + 1;
    let longest = text.len() - count.to_string().len() + digits + 1 + comment.len();
    padded(&format!("{text} {comment}"), longest)
}

/// A header with room for `longest` bytes of text. The first element is aligned, as NumPy has it.
fn padded(text: &str, longest: usize) -> Vec<u8> {
    let whole = (MAGIC.len() + 4 + longest + 1).next_multiple_of(64);
    let text_bytes = whole - MAGIC.len() - 4;
    let mut header = [MAGIC, &[1, 0], &(text_bytes as u16).to_le_bytes(), text.as_bytes()].concat();
    header.resize(whole - 1, b' ');
    header.push(b'\n');
    header
}

/// A time as the files hold it.
fn time(t: u64, path: &Path, events: u64) -> Result<i64, Error> {
    i64::try_from(t).map_err(|_| {
        let what = format!("the time {t} µs is beyond 2^63 µs");
        refused(path, events, &what, "write it with --rebase")
    })
}

/// One structured array.
#[derive(Debug)]
struct NpyEncoder {
    output: Output,
    geometry: Option<Geometry>,
    events: u64,
    rows: Vec<u8>,
}

impl Encoder for NpyEncoder {
    fn events(&mut self, span: Span<'_>) -> Result<(), Error> {
        for events in span.events.chunks(BATCH) {
            self.rows.clear();
            for event in events {
                let t = time(span.time(*event), self.output.path(), self.events)?;
                self.rows.extend(t.to_le_bytes());
                self.rows.extend(event.x().to_le_bytes());
                self.rows.extend(event.y().to_le_bytes());
                self.rows.push(u8::from(event.is_on()));
                self.events += 1;
            }
            self.output.write(&self.rows)?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<u64, Error> {
        self.output.write_at(0, &header(RECORD, self.events, &comment(self.geometry)))?;
        self.output.finish()
    }
}

/// A column each.
#[derive(Debug)]
struct NpzEncoder {
    output: Output,
    archive: archive::Writer,
    columns: Columns,
    geometry: Option<Geometry>,
    events: u64,
}

/// The columns after the first, each in a file that has no name any more.
#[derive(Debug)]
struct Columns {
    files: [File; 3],
    bytes: [Vec<u8>; 4],
}

impl Columns {
    fn new(path: &Path) -> Result<Self, Error> {
        let file = || Output::scratch(path);
        Ok(Self { files: [file()?, file()?, file()?], bytes: Default::default() })
    }
}

impl NpzEncoder {
    /// What tells the unit and the size, then the first column's header.
    fn begin(mut self) -> Result<Box<dyn Encoder>, Error> {
        let letters = "us".chars().flat_map(|letter| u32::from(letter).to_le_bytes());
        let unit: Vec<u8> = scalar("'<U2'").into_iter().chain(letters).collect();
        self.archive.add(TIME_UNIT, &unit, &mut self.output)?;
        if let Some(Geometry { width, height }) = self.geometry {
            let sides = [width, height].map(|side| i64::from(side).to_le_bytes());
            let size: Vec<u8> = header("'<i8'", 2, "").into_iter().chain(sides.concat()).collect();
            self.archive.add(SENSOR_SIZE, &size, &mut self.output)?;
        }
        let [(name, descr), ..] = COLUMNS;
        self.archive.begin(name, &mut self.output)?;
        self.archive.write(&header(descr, 0, ""), &mut self.output)?;
        Ok(Box::new(self))
    }

    fn put(&mut self) -> Result<(), Error> {
        let [t, rest @ ..] = &mut self.columns.bytes;
        self.archive.write(t, &mut self.output)?;
        t.clear();
        for (bytes, file) in rest.iter_mut().zip(&mut self.columns.files) {
            file.write_all(bytes).map_err(|source| Error::io(self.output.path(), "writing it", source))?;
            bytes.clear();
        }
        Ok(())
    }

    /// Copies a column that waited.
    fn copy(&mut self, index: usize, (name, descr): (&str, &str)) -> Result<(), Error> {
        let Self { output, archive, columns, .. } = self;
        let io = |path: &Path, source| Error::io(path, "reading what was written of it", source);
        let Some(file) = columns.files.get_mut(index) else { return Ok(()) };
        file.rewind().map_err(|source| io(output.path(), source))?;
        archive.begin(name, output)?;
        archive.write(&header(descr, self.events, ""), output)?;
        let mut buffer = vec![0; 1 << 16];
        loop {
            let len = file.read(&mut buffer).map_err(|source| io(output.path(), source))?;
            if len == 0 {
                return archive.end(output);
            }
            archive.write(buffer.get(..len).unwrap_or_default(), output)?;
        }
    }
}

/// The header of an array of no dimension.
fn scalar(descr: &str) -> Vec<u8> {
    let text = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': (), }}");
    padded(&text, text.len())
}

impl Encoder for NpzEncoder {
    fn events(&mut self, span: Span<'_>) -> Result<(), Error> {
        for events in span.events.chunks(BATCH) {
            for event in events {
                let value = time(span.time(*event), self.output.path(), self.events)?;
                let [t, x, y, p] = &mut self.columns.bytes;
                t.extend(value.to_le_bytes());
                x.extend(event.x().to_le_bytes());
                y.extend(event.y().to_le_bytes());
                p.push(u8::from(event.is_on()));
                self.events += 1;
            }
            self.put()?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<u64, Error> {
        let [(_, descr), rest @ ..] = COLUMNS;
        self.archive.rewrite_start(
            &header(descr, 0, ""),
            &header(descr, self.events, ""),
            &mut self.output,
        )?;
        self.archive.end(&mut self.output)?;
        for (index, column) in rest.into_iter().enumerate() {
            self.copy(index, column)?;
        }
        let Self { mut output, archive, .. } = *self;
        archive.finish(&mut output)?;
        output.finish()
    }
}
