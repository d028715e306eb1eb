//! NumPy: `.npy` arrays and `.npz` archives of them.
//!
//! Spec: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>; archives are zip files
//!
//! ```text
//! structured array  fields t, x, y, p (or ts, timestamp, pol, polarity, ...) in any order and of any width
//! N x 4 array       of integers or floats: --columns tells which is what
//! archive           columns t, x, y, p; or one structured or N x 4 array, whatever its name; of several, --topic
//! unit of t         from a name such as t_us, a type such as timedelta64[us], --time-unit; our own files tell it
//! ours              .npy: a comment at the end of the header's dictionary; .npz: members time_unit, sensor_size
//! ```
//!
//! The checksums of an archive's columns are compared at the end of a pass over all of it; events are given all the same.
//!
//! p is 0 or 1, -1 or 1, or a bool. A row that is no event (NaN, half a pixel) is counted as damaged and skipped.

use crate::container::{Container, Cursor, Piece};
use crate::input::Input;
use crate::intake::Intake;
use crate::open::Probe;
use crate::{Error, ErrorKind, Format, OpenOptions, Stream, StreamKind};
use checksum::Checksums;
use cursor::NumpyCursor;
use lobula_core::Geometry;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use table::Table;

mod archive;
mod checksum;
mod cursor;
mod dtype;
mod header;
mod table;
mod tensors;
mod write;

pub use tensors::TensorWriter;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format =
    Format { name: "NumPy", extensions: &["npy", "npz"], create: Some(write::create), probe, open };

/// Largest sensor that an event can tell.
const GEOMETRY_MAX: Geometry = Geometry::new(u16::MAX, 0x7FFF);

fn probe(probe: &Probe<'_>) -> bool {
    let first_member = || {
        let len = probe.head.get(26..28).map_or(0, |len| usize::from(u16::from_le_bytes([len[0], len[1]])));
        probe.head.get(30..30 + len).is_some_and(|name| name.ends_with(b".npy"))
    };
    probe.head.starts_with(header::MAGIC)
        || probe.head.starts_with(archive::MAGIC) && (first_member() || probe.has_extension(&FORMAT))
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let mut magic = [0; 4];
    input.read_at(0, &mut magic)?;
    let table = if magic == archive::MAGIC {
        table::of_archive(&input, options)?
    } else {
        table::of_file(&input, options)?
    };
    let geometry = options.sensor_size.or(table.size);
    let intake = Intake::new(geometry.unwrap_or(GEOMETRY_MAX), options);
    Ok(Box::new(NumpyRecording { input, geometry, table: Arc::new(table), intake }))
}

/// Something that is not read, and what to do about it.
fn refuse(path: &Path, what: impl Into<String>, remedy: &str) -> Error {
    Error::new(ErrorKind::Unsupported, path, what, remedy)
}

#[derive(Debug)]
struct NumpyRecording {
    input: Arc<Input>,
    geometry: Option<Geometry>,
    table: Arc<Table>,
    intake: Intake,
}

impl NumpyRecording {
    fn cursor(&self, rows: Range<u64>, checksums: Option<Checksums>) -> Box<dyn Cursor> {
        let (table, intake, file_bytes) = (self.table.clone(), self.intake.clone(), self.input.len());
        Box::new(NumpyCursor::new(table, rows, file_bytes, intake, checksums))
    }
}

impl Container for NumpyRecording {
    fn geometry(&self) -> Option<Geometry> {
        self.geometry
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.intake.geometry()
    }

    fn streams(&self) -> Vec<Stream> {
        let others = self.table.others.iter().map(|name| Stream::new(StreamKind::Other, name));
        [Stream::new(StreamKind::Events, &self.table.name)].into_iter().chain(others).collect()
    }

    fn warnings(&self) -> Vec<String> {
        self.table.damaged.warnings()
    }

    fn start(&self) -> Box<dyn Cursor> {
        self.cursor(0..self.table.rows, Checksums::of_pieces(1, &self.table).next().flatten())
    }

    /// As many rows each; the last counts those that are missing.
    fn pieces(&self, n: usize) -> Result<Vec<Piece>, Error> {
        let there = self.table.rows_there().unwrap_or(0);
        let each = there.div_ceil(n.max(1) as u64).max(1);
        let starts = (1..n as u64).map(|i| i * each).take_while(|start| *start < there);
        let ends = starts.clone().chain([self.table.rows]);
        let rows: Vec<_> = [0].into_iter().chain(starts).zip(ends).map(|(start, end)| start..end).collect();
        let checksums = Checksums::of_pieces(rows.len(), &self.table);
        let pieces = rows.into_iter().zip(checksums);
        Ok(pieces.map(|(rows, sums)| Piece { cursor: self.cursor(rows, sums), wrap_us: 0 }).collect())
    }
}

#[cfg(test)]
mod tests;
