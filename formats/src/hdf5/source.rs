//! Rows of a dataset, loaded as they are asked for: a part of one piece, or a chunk at a time.

use super::chunks::{self, Chunk};
use super::dataset::{Dataset, Storage};
use super::file::File;
use super::filter::{Filter, Scratch, room};
use crate::input::Input;
use crate::{Error, ErrorKind};
use std::ops::Range;

/// Rows loaded at once, where a dataset is not compressed: the copy out of the page cache takes over half of the time,
/// and all is a tenth slower with a quarter of this. All four columns stay in a cache of 1 MiB.
const WINDOW_ROWS: u64 = 32768;
/// Most bytes of them, where rows are long.
const WINDOW_BYTES: u64 = 1 << 20;

/// A dataset by rows; of a table that is cut into chunks of columns too, one of these.
#[derive(Debug)]
pub(super) struct Source {
    pub name: String,
    pub rows: u64,
    /// Bytes of a row as loaded.
    pub row_bytes: usize,
    pieces: Pieces,
    filters: Vec<Filter>,
}

#[derive(Debug)]
enum Pieces {
    /// At this offset in the file.
    Whole { offset: u64 },
    /// By number, each of this many rows; numbered along the rows.
    Chunks { rows: u64, list: Vec<Chunk> },
}

/// Rows that are loaded.
#[derive(Debug, Default)]
pub(super) struct Window {
    pub rows: Range<u64>,
    /// Of these rows, and then anything.
    bytes: Vec<u8>,
}

impl Window {
    /// The bytes from this row on, and then anything.
    pub fn from(&self, row: u64, row_bytes: usize) -> &[u8] {
        let before = usize::try_from(row.saturating_sub(self.rows.start)).unwrap_or(usize::MAX);
        self.bytes.get(before.saturating_mul(row_bytes)..).unwrap_or_default()
    }
}

/// What came of loading rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Loaded {
    Yes,
    /// The rows up to this one cannot be read.
    Damaged {
        until: u64,
    },
    /// The file ends at this offset, before the row.
    CutShort {
        at: u64,
    },
}

impl Source {
    /// The rows of a dataset; of a table's, the chunks that hold the column of this number.
    pub fn open(file: &File, dataset: &Dataset, column: u64) -> Result<Self, Error> {
        let name = dataset.name.clone();
        let malformed = || file.malformed(&format!("dataset {name}"), 0);
        let rows = dataset.dimensions.first().copied().unwrap_or(1);
        let columns = dataset.dimensions.get(1).copied().unwrap_or(1);
        let element = dataset.datatype.bytes();
        let (pieces, columns) = match &dataset.storage {
            Storage::Whole { address, .. } => {
                let nothing = rows == 0;
                let offset = file.offset(*address).or(nothing.then_some(0));
                (Pieces::Whole { offset: offset.ok_or_else(malformed)? }, columns)
            }
            Storage::Chunks(chunking) => {
                let grid = dataset.grid().ok_or_else(malformed)?;
                let (side, wide) = match chunking.sides.as_slice() {
                    [rows] => (*rows, 1),
                    [rows, columns] => (*rows, *columns),
                    _ => return Err(malformed()),
                };
                if side.checked_mul(wide).and_then(|n| n.checked_mul(element as u64)) != Some(chunking.bytes)
                {
                    return Err(malformed());
                }
                let mut list = chunks::chunks(file, chunking, &grid, !dataset.filters.is_empty())?;
                let across = columns.div_ceil(wide.max(1)).max(1);
                list.retain(|chunk| chunk.number % across == column / wide.max(1));
                for chunk in &mut list {
                    chunk.number /= across;
                    chunk.address = file.offset(chunk.address).unwrap_or(u64::MAX);
                }
                (Pieces::Chunks { rows: side, list }, wide)
            }
        };
        let row_bytes = usize::try_from(columns).ok().and_then(|columns| columns.checked_mul(element));
        let row_bytes = row_bytes.filter(|bytes| *bytes > 0).ok_or_else(malformed)?;
        Ok(Self { name, rows, row_bytes, pieces, filters: dataset.filters.clone() })
    }

    /// Rows that are loaded together.
    pub fn chunk_rows(&self) -> u64 {
        match &self.pieces {
            Pieces::Chunks { rows, .. } if self.is_filtered() => *rows,
            _ => self.window_rows(),
        }
    }

    fn window_rows(&self) -> u64 {
        (WINDOW_BYTES / self.row_bytes as u64).clamp(1, WINDOW_ROWS)
    }

    /// Bytes that a window of it takes.
    pub fn window_bytes(&self) -> u64 {
        self.chunk_rows().saturating_mul(self.row_bytes as u64)
    }

    /// Whether chunks are decompressed.
    pub fn is_filtered(&self) -> bool {
        !self.filters.is_empty()
    }

    /// Loads the rows from this one on, as many as are at hand; at least one.
    pub fn load(
        &self,
        input: &Input,
        row: u64,
        window: &mut Window,
        scratch: &mut Scratch,
    ) -> Result<Loaded, Error> {
        window.rows = row..row;
        match &self.pieces {
            Pieces::Whole { offset } => {
                let there = input.len().saturating_sub(*offset) / self.row_bytes as u64;
                if row >= there {
                    return Ok(Loaded::CutShort { at: input.len() });
                }
                self.read(input, *offset, 0, row..self.rows.min(there), window)?;
                Ok(Loaded::Yes)
            }
            Pieces::Chunks { rows, list } => self.load_chunk(input, row, (*rows, list), window, scratch),
        }
    }

    fn load_chunk(
        &self,
        input: &Input,
        row: u64,
        (rows, list): (u64, &[Chunk]),
        window: &mut Window,
        scratch: &mut Scratch,
    ) -> Result<Loaded, Error> {
        let number = row / rows.max(1);
        let chunk = match find(list, number) {
            Ok(chunk) => chunk,
            Err(next) => {
                let until = next.map_or(self.rows, |next| next.number.saturating_mul(rows)).min(self.rows);
                return Ok(Loaded::Damaged { until });
            }
        };
        let first = number.saturating_mul(rows);
        let end = first.saturating_add(rows).min(self.rows);
        let damaged = Loaded::Damaged { until: end };
        let there = input.len().saturating_sub(chunk.address) >= chunk.bytes.into();
        let used = (0..self.filters.len()).any(|i| chunk.mask >> i.min(31) & 1 == 0);
        if !there {
            return Ok(damaged);
        }
        if !used {
            let rows_there = u64::from(chunk.bytes) / self.row_bytes as u64;
            if first.saturating_add(rows_there) < end {
                return Ok(damaged);
            }
            self.read(input, chunk.address, first, row..end, window)?;
            return Ok(Loaded::Yes);
        }
        let stored = chunk.bytes as usize;
        input.read_at(chunk.address, scratch.stored(stored))?;
        let len = usize::try_from(rows.saturating_mul(self.row_bytes as u64)).unwrap_or(usize::MAX);
        if scratch.undo(&self.filters, chunk.mask, stored, &mut window.bytes, len).is_none() {
            return Ok(damaged);
        }
        window.rows = first..end;
        Ok(Loaded::Yes)
    }

    /// Reads as many of these rows as a window has; the row `first` is at the offset.
    fn read(
        &self,
        input: &Input,
        offset: u64,
        first: u64,
        rows: Range<u64>,
        window: &mut Window,
    ) -> Result<(), Error> {
        let count = (rows.end - rows.start).min(self.window_rows());
        let at = offset.saturating_add((rows.start - first).saturating_mul(self.row_bytes as u64));
        input.read_at(at, room(&mut window.bytes, count as usize * self.row_bytes))?;
        window.rows = rows.start..rows.start + count;
        Ok(())
    }
}

/// The chunk of this number, else the next after it.
fn find(list: &[Chunk], number: u64) -> Result<Chunk, Option<Chunk>> {
    // Nearly always none is missing.
    let dense = usize::try_from(number).ok().and_then(|number| list.get(number));
    if let Some(chunk) = dense.filter(|chunk| chunk.number == number) {
        return Ok(*chunk);
    }
    let at = list.partition_point(|chunk| chunk.number < number);
    let next = list.get(at).copied();
    next.filter(|chunk| chunk.number == number).ok_or(next)
}

/// Refuses chunks that take more memory than can be meant.
pub(super) fn check_memory(file: &File, sources: &[Source]) -> Result<(), Error> {
    /// Above the length of the file, of which no honest chunk is many times as long.
    const BYTES_MAX: u64 = 56 << 20;
    let windows = sources.iter().fold(0u64, |sum, source| sum.saturating_add(source.window_bytes()));
    let filtered = sources.iter().filter(|source| source.is_filtered());
    let scratch = filtered.map(Source::window_bytes).max().unwrap_or(0);
    let bytes = windows.saturating_add(scratch);
    if bytes <= BYTES_MAX.saturating_add(file.input.len()) {
        return Ok(());
    }
    let what = format!("has chunks of {bytes} bytes, beyond {BYTES_MAX} and the length of the file");
    let remedy = "write it again with smaller chunks: h5repack -l CHUNK=16384";
    Err(Error::new(ErrorKind::TooLarge, file.input.path(), what, remedy))
}
