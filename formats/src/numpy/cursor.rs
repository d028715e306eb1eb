//! Rows of four columns become events.

use super::checksum::{CRC_BYTES, Checksums};
use super::dtype::{Dtype, Kind};
use super::table::{Lane, Place, Table};
use crate::Error;
use crate::TimeUnit;
use crate::byte_cursor::Bytes as _;
use crate::container::{Cursor, Stop};
use crate::intake::{Intake, Plain, Taken};
use crate::packed::Source;
use lobula_core::{Counters, Fault, Sink};
use std::ops::Range;
use std::sync::Arc;

/// Rows read at once.
const ROWS: usize = 8192;
/// Rows taken at once where all are alike.
const BATCH: usize = 512;

/// Layouts that are read fastest: those that NumPy's users write most, and we do. All times are µs of 64 bits, all
/// coordinates of 16 bits and polarities of 8, little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fast {
    /// Records of t, x, y, p.
    Record,
    /// Four arrays.
    Columns,
}

impl Fast {
    /// Bytes of a record.
    const RECORD_BYTES: usize = 13;
    /// Bits of x, y and p after those of t.
    const PIXEL: u64 = 0xFF_FFFF_FFFF;

    fn of(table: &Table) -> Option<Self> {
        let [t, x, y, p] = table.columns;
        let is = |place: Place, kinds: &[Kind], bytes| {
            let Dtype { kind, bytes: found, big_endian, .. } = place.dtype;
            kinds.contains(&kind) && found == bytes && (!big_endian || bytes == 1)
        };
        let numbers = is(t, &[Kind::Signed], 8)
            && is(x, &[Kind::Unsigned], 2)
            && is(y, &[Kind::Unsigned], 2)
            && is(p, &[Kind::Unsigned, Kind::Signed, Kind::Bool], 1);
        if !numbers || table.unit != TimeUnit::Microseconds {
            return None;
        }
        match table.lanes.as_slice() {
            [lane] if lane.stride == Self::RECORD_BYTES => {
                ([t, x, y, p].map(|place| place.offset) == [0, 8, 10, 12]).then_some(Self::Record)
            }
            [_, _, _, _] => ([t, x, y, p].map(|place| place.lane) == [0, 1, 2, 3]).then_some(Self::Columns),
            _ => None,
        }
    }
}

/// An event of the fast layouts, by its time and, in one word, x, y and p. A p of -1 is OFF where it is `SIGNED`.
#[inline(always)]
fn plain<const SIGNED: bool>(t_us: u64, pixel: u64) -> Plain {
    // To the byte of p its sign is added: -1 becomes 0, and no other number becomes 0 or 1.
    let p_from = 1 << 32;
    let pixel = if SIGNED { (pixel + (pixel >> 7 & p_from)) & ((p_from << 8) - 1) } else { pixel };
    Plain::of(t_us, pixel)
}

/// A record, and what comes after it.
type Wide = [u8; 16];

/// Records of a batch, each at a place that numbers of 64 bits are read from fast: as they stand in the file, compilers
/// read them one by one.
#[derive(Debug, Default)]
struct WideRecords(Vec<Wide>);

impl WideRecords {
    /// The first `n` records of `bytes`, after which as many bytes follow as a record is made wider by.
    fn fill(&mut self, bytes: &[u8], n: usize) -> &[Wide] {
        self.0.resize(BATCH, Wide::default());
        let records = bytes.windows(size_of::<Wide>()).step_by(Fast::RECORD_BYTES);
        let wide = self.0.get_mut(..n).unwrap_or_default();
        let filled = wide.iter_mut().zip(records).map(|(wide, record)| wide.copy_from_slice(record)).count();
        self.0.get(..filled).unwrap_or_default()
    }
}

/// A place in a table.
#[derive(Debug)]
pub(super) struct NumpyCursor {
    table: Arc<Table>,
    file_bytes: u64,
    intake: Intake,
    fast: Option<Fast>,
    /// Rows before this one are not alike: they are taken one by one.
    each_until: u64,
    /// The next row, and the one at which another cursor goes on, or all end.
    row: u64,
    rows_end: u64,
    /// Empty until the first read, so that a checkpoint is small.
    lanes: Vec<Buffered>,
    /// The rows in the buffers, of which those before `row` are done.
    buffered: u64,
    buffered_end: u64,
    wide: WideRecords,
    /// None where not all of the rows are read, or not in order.
    checksums: Option<Checksums>,
}

/// A lane and the rows of it that come next.
#[derive(Debug)]
struct Buffered {
    source: Source,
    /// The rows, and at least a [`Wide`] more.
    bytes: Vec<u8>,
}

impl NumpyCursor {
    /// Over these rows.
    pub fn new(
        table: Arc<Table>,
        rows: Range<u64>,
        file_bytes: u64,
        intake: Intake,
        checksums: Option<Checksums>,
    ) -> Self {
        let fast = Fast::of(&table);
        Self {
            table,
            file_bytes,
            intake,
            fast,
            each_until: 0,
            row: rows.start,
            rows_end: rows.end,
            lanes: Vec::new(),
            buffered: 0,
            buffered_end: 0,
            wide: WideRecords::default(),
            checksums,
        }
    }

    /// Bytes of a row in all lanes.
    fn row_bytes(&self) -> u64 {
        self.table.lanes.iter().map(|lane| lane.stride as u64).sum()
    }

    /// Reads the next rows; false where there are no more.
    fn refill(&mut self) -> Result<bool, Error> {
        self.open_lanes();
        let table = self.table.clone();
        let want = (self.rows_end - self.row).min(ROWS as u64) as usize;
        let mut rows = want;
        for (i, (lane, buffer)) in table.lanes.iter().zip(&mut self.lanes).enumerate() {
            rows = rows.min(buffer.read(lane, self.row, rows)?);
            if let Some(checksums) = self.checksums.as_mut().filter(|_| rows == want) {
                checksums.add(i, buffer.bytes.get(..rows * lane.stride).unwrap_or_default());
            }
        }
        if rows < want {
            self.checksums = None;
        }
        (self.buffered, self.buffered_end) = (self.row, self.row + rows as u64);
        Ok(rows > 0)
    }

    /// Begins to read, if that is not done yet.
    fn open_lanes(&mut self) {
        if !self.lanes.is_empty() {
            return;
        }
        let buffered = |lane: &Lane| Buffered { source: lane.source.fork(), bytes: Vec::new() };
        self.lanes = self.table.lanes.iter().map(buffered).collect();
        if let Some(checksums) = self.checksums.as_mut().filter(|_| self.row == 0) {
            for (i, (lane, buffer)) in self.table.lanes.iter().zip(&mut self.lanes).enumerate() {
                checksums.add_head(i, lane, &mut buffer.source);
            }
        }
    }

    /// All rows are taken: compares checksums. The bytes of one that does not fit are what is known to be wrong.
    fn end_checksums(&mut self) {
        self.open_lanes();
        let Some(mut checksums) = self.checksums.take() else { return };
        if self.rows_end == self.table.rows {
            for (i, (lane, buffer)) in self.table.lanes.iter().zip(&mut self.lanes).enumerate() {
                checksums.add_tail(i, lane, self.table.rows, &mut buffer.source);
            }
        }
        for _ in 0..checksums.end(&self.table) {
            self.intake.fault(Fault::Damaged, CRC_BYTES);
        }
    }

    /// The rest that the header promised is not there.
    fn cut_short(&mut self) {
        let missing = self.rows_end - self.row;
        if missing > 0 {
            self.intake.fault(Fault::CutShort, missing.saturating_mul(self.row_bytes()));
            self.row = self.rows_end;
        }
    }

    /// Takes the next `n` rows where their layout is a fast one and all are alike; else none.
    fn take_alike<const SIGNED: bool>(&mut self, n: usize, sink: &mut Sink<'_>) -> bool {
        let (at, row_bytes) = ((self.row - self.buffered) as usize, self.row_bytes());
        let time = |t: &[u8; 8]| i64::from_le_bytes(*t);
        match (self.fast, self.lanes.as_slice()) {
            (Some(Fast::Record), [rows]) => {
                let rows = rows.bytes.get(at * Fast::RECORD_BYTES..).unwrap_or_default();
                let rows = self.wide.fill(rows, n);
                let t = |row: &Wide| row.first_chunk().map_or(0, time);
                let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return false };
                let event = |row: &Wide| {
                    let row = u128::from_le_bytes(*row);
                    plain::<SIGNED>(row as u64, (row >> 64) as u64 & Fast::PIXEL)
                };
                rows.len() == n
                    && self.intake.push_alike(sink, row_bytes, (t(first), t(last)), rows.iter(), event)
            }
            (Some(Fast::Columns), [t, x, y, p]) => {
                let t = t.bytes.as_chunks::<8>().0.get(at..at + n).unwrap_or_default();
                let x = x.bytes.as_chunks::<2>().0.get(at..at + n).unwrap_or_default();
                let y = y.bytes.as_chunks::<2>().0.get(at..at + n).unwrap_or_default();
                let p = p.bytes.get(at..at + n).unwrap_or_default();
                let (Some(first), Some(last)) = (t.first(), t.last()) else { return false };
                let (ends, rows) = ((time(first), time(last)), t.iter().zip(x).zip(y).zip(p));
                rows.len() == n
                    && self.intake.push_alike(sink, row_bytes, ends, rows, |(((t, x), y), p)| {
                        let [x, y] = [x, y].map(|at| u64::from(u16::from_le_bytes(*at)));
                        plain::<SIGNED>(u64::from_le_bytes(*t), x | y << 16 | u64::from(*p) << 32)
                    })
            }
            _ => false,
        }
    }

    /// The numbers of a column, from a row on.
    fn column(&self, place: Place, row: u64) -> Option<&[u8]> {
        let stride = self.table.lanes.get(place.lane)?.stride;
        let at = (row - self.buffered) as usize * stride + place.offset;
        self.lanes.get(place.lane)?.bytes.get(at..)
    }

    /// The event of a row; `None` where it is none.
    fn event(&self, row: u64) -> Option<(i64, (i64, i64), bool)> {
        let number = |place: Place| place.dtype.number(self.column(place, row)?);
        let [t, x, y, p] = self.table.columns.map(number);
        let on = match p?.integer()? {
            1 => true,
            0 | -1 => false,
            _ => return None,
        };
        Some((t?.micros(self.table.unit)?, (x?.integer()?, y?.integer()?), on))
    }
}

impl Buffered {
    /// Reads rows; how many there are.
    fn read(&mut self, lane: &Lane, row: u64, rows: usize) -> Result<usize, Error> {
        let start = lane.start.saturating_add(row.saturating_mul(lane.stride as u64));
        let left = lane.end.map_or(u64::MAX, |end| end.saturating_sub(start));
        let want = (rows * lane.stride).min(usize::try_from(left).unwrap_or(usize::MAX));
        self.bytes.resize(want + size_of::<Wide>(), 0);
        let len = self.source.read_at(start, self.bytes.get_mut(..want).unwrap_or_default())?;
        Ok(len / lane.stride)
    }
}

impl Cursor for NumpyCursor {
    fn fill(&mut self, sink: &mut Sink<'_>) -> Result<Stop, Error> {
        let row_bytes = self.row_bytes();
        let [.., p] = self.table.columns;
        let take_alike = match p.dtype.kind {
            Kind::Signed => Self::take_alike::<true>,
            _ => Self::take_alike::<false>,
        };
        loop {
            while self.row < self.buffered_end {
                let left = (self.buffered_end - self.row).min(BATCH as u64) as usize;
                let n = left.min(sink.room());
                if self.row >= self.each_until && n > 0 {
                    if take_alike(self, n, sink) {
                        self.row += n as u64;
                        continue;
                    }
                    self.each_until = self.row + n as u64;
                }
                match self.event(self.row) {
                    None => self.intake.fault(Fault::Damaged, row_bytes),
                    Some((t, xy, on)) => {
                        let taken = self.intake.push(sink, t, xy, on, row_bytes);
                        let at = |bad: crate::byte_cursor::Bad| bad.error(self.lanes_path(), self.offset());
                        if taken.map_err(at)? == Taken::Full {
                            return Ok(Stop::Full);
                        }
                    }
                }
                self.row += 1;
            }
            if self.row >= self.rows_end || !self.refill()? {
                self.cut_short();
                self.end_checksums();
                return Ok(Stop::End);
            }
        }
    }

    fn position(&self) -> u64 {
        self.row.saturating_mul(self.row_bytes())
    }

    fn progress(&self) -> u64 {
        let share = u128::from(self.row) * u128::from(self.file_bytes) / u128::from(self.table.rows.max(1));
        u64::try_from(share).unwrap_or(self.file_bytes)
    }

    fn counters(&self) -> Counters {
        self.intake.counters
    }

    fn fork(&self) -> Box<dyn Cursor> {
        let rows = self.row..self.rows_end;
        let mut fork = Self::new(self.table.clone(), rows, self.file_bytes, self.intake.clone(), None);
        (fork.buffered, fork.buffered_end) = (self.row, self.row);
        Box::new(fork)
    }
}

impl NumpyCursor {
    fn lanes_path(&self) -> &std::path::Path {
        self.table.lanes.first().map_or(std::path::Path::new(""), |lane| lane.source.path())
    }

    /// Offset of the next row's time, in the file or its member.
    fn offset(&self) -> u64 {
        let [t, ..] = self.table.columns;
        let lane = self.table.lanes.get(t.lane);
        lane.map_or(0, |lane| lane.start + self.row * lane.stride as u64 + t.offset as u64)
    }
}
