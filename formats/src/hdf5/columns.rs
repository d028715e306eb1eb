//! The cursor: rows of four columns, wherever they are, into events.

use super::batch::{self, Between};
use super::datatype::Number;
use super::filter::Scratch;
use super::number::{self, Value};
use super::source::{Loaded, Source, Window};
use super::time_index;
use super::triggers::Triggers;
use crate::byte_cursor::Bad;
use crate::container::{Cursor, Stop};
use crate::input::Input;
use crate::intake::{Intake, Taken};
use crate::open::TimeUnit;
use crate::{Error, ErrorKind};
use lobula_core::{Counters, Fault, Sink, Trigger};
use std::ops::Range;
use std::sync::Arc;

/// Where one column is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Which of the sources.
    pub source: usize,
    /// In a row of it, in bytes.
    pub offset: usize,
    pub number: Number,
}

/// The columns of a stream of events: what all its cursors share.
#[derive(Debug)]
pub(super) struct Columns {
    pub input: Arc<Input>,
    pub sources: Vec<Source>,
    pub t: Place,
    pub x: Place,
    pub y: Place,
    pub p: Place,
    /// The least that any of the sources has.
    pub rows: u64,
    pub unit: TimeUnit,
    /// What the file says to add to every time, in µs.
    pub t_offset_us: i64,
    pub triggers: Triggers,
}

impl Columns {
    /// Bytes that tell an event, before compression.
    fn row_bytes(&self) -> u64 {
        [self.t, self.x, self.y, self.p].iter().map(|place| place.number.kind.bytes() as u64).sum()
    }

    /// A time in µs.
    pub fn micros(&self, told: Value) -> Option<i64> {
        micros(self.unit, told)?.checked_add(self.t_offset_us)
    }

    /// Rows of each of about `n` pieces: whole chunks, so that none is decompressed twice.
    pub fn piece_rows(&self, n: u64) -> u64 {
        let chunk = self.sources.iter().map(|source| source.chunk_rows()).max().unwrap_or(1).max(1);
        self.rows.div_ceil(n.max(1)).div_ceil(chunk).saturating_mul(chunk).max(1)
    }

    /// How far a row is into the file.
    fn position(&self, row: u64) -> u64 {
        let part = u128::from(self.input.len()) * u128::from(row) / u128::from(self.rows.max(1));
        part as u64
    }
}

/// A time of this unit in µs, rounded to the nearest.
pub(super) fn micros(unit: TimeUnit, told: Value) -> Option<i64> {
    match told {
        Value::Int(t) => match unit {
            TimeUnit::Seconds => t.checked_mul(1_000_000),
            TimeUnit::Milliseconds => t.checked_mul(1000),
            TimeUnit::Microseconds => Some(t),
            TimeUnit::Nanoseconds => Some(t.div_euclid(1000) + i64::from(t.rem_euclid(1000) >= 500)),
        },
        Value::Float(t) => Value::Float((t * scale(unit)).round_ties_even()).whole(),
        Value::None => None,
    }
}

/// µs of one unit.
fn scale(unit: TimeUnit) -> f64 {
    match unit {
        TimeUnit::Seconds => 1e6,
        TimeUnit::Milliseconds => 1e3,
        TimeUnit::Microseconds => 1.0,
        TimeUnit::Nanoseconds => 1e-3,
    }
}

/// A row, and what is loaded around it.
#[derive(Debug)]
pub(super) struct ColumnCursor {
    columns: Arc<Columns>,
    rows: Range<u64>,
    intake: Intake,
    /// Events before what the intake has counted, as triggers count them.
    events_before: u64,
    /// Number of the next trigger.
    trigger_next: usize,
    /// Made at the first event, so that a checkpoint is small.
    loaded: Option<Box<Buffers>>,
}

#[derive(Debug, Default)]
struct Buffers {
    windows: Vec<Window>,
    scratch: Scratch,
    between: Between,
}

/// Rows that can be taken next.
enum Ready {
    Rows(usize),
    /// None up to this one.
    Damaged(u64),
}

impl ColumnCursor {
    /// A cursor over these rows, and the triggers among them from this number on.
    pub fn new(columns: Arc<Columns>, rows: Range<u64>, trigger_next: usize, intake: Intake) -> Self {
        Self { columns, rows, intake, events_before: 0, trigger_next, loaded: None }
    }

    /// The same, for triggers that count the events before it too.
    pub fn after(self, events_before: u64) -> Self {
        Self { events_before, ..self }
    }

    /// Loads what is needed for the next row; how many rows are there in every column.
    fn ready(&mut self) -> Result<Ready, Error> {
        let columns = &*self.columns;
        let row = self.rows.start;
        let buffers = self.loaded.get_or_insert_default();
        buffers.windows.resize_with(columns.sources.len(), Window::default);
        let mut end = self.rows.end.min(columns.rows);
        for (source, window) in columns.sources.iter().zip(&mut buffers.windows) {
            if !window.rows.contains(&row) {
                match source.load(&columns.input, row, window, &mut buffers.scratch)? {
                    Loaded::Yes => {}
                    Loaded::Damaged { until } => return Ok(Ready::Damaged(until.min(end))),
                    Loaded::CutShort { at } => return Err(cut_short(columns, source, row, at)),
                }
            }
            end = end.min(window.rows.end);
        }
        Ok(Ready::Rows(usize::try_from(end - row).unwrap_or(usize::MAX)))
    }

    /// Puts as many of these rows into the sink as it takes; how many.
    fn take(&mut self, rows: usize, sink: &mut Sink<'_>) -> Result<usize, Error> {
        let mut taken = 0;
        while taken < rows {
            let count = batch::ROWS.min(rows - taken).min(sink.room());
            let count = self.take_triggers(count, sink).unwrap_or(0);
            if count == 0 {
                break;
            }
            if self.batch(count, sink).is_some() {
                taken += count;
                continue;
            }
            let one_by_one = self.slow(count, sink)?;
            taken += one_by_one;
            if one_by_one < count {
                break;
            }
        }
        Ok(taken)
    }

    /// Puts the triggers that come before the next row into the sink; how many of `count` rows come before the next
    /// trigger. `None` where the sink takes no more triggers.
    fn take_triggers(&mut self, count: usize, sink: &mut Sink<'_>) -> Option<usize> {
        while let Some((trigger, before)) = self.trigger() {
            let rows = self.rows_before(before, count);
            if rows > 0 || count == 0 {
                return Some(rows);
            }
            self.put_trigger(trigger, sink)?;
        }
        Some(count)
    }

    /// Puts the triggers after the last event into the sink. `None` where it takes no more.
    fn take_last_triggers(&mut self, sink: &mut Sink<'_>) -> Option<()> {
        while let Some((trigger, _)) = self.trigger().filter(|_| self.rows.end >= self.columns.rows) {
            self.put_trigger(trigger, sink)?;
        }
        Some(())
    }

    /// The next trigger, and before what it comes.
    fn trigger(&self) -> Option<(Trigger, u64)> {
        let Counters { events, off_sensor, .. } = self.intake.counters;
        self.columns.triggers.get(self.trigger_next, self.events_before + events - off_sensor)
    }

    fn put_trigger(&mut self, trigger: Trigger, sink: &mut Sink<'_>) -> Option<()> {
        sink.push_trigger(trigger).then_some(())?;
        self.intake.counters.triggers += 1;
        self.trigger_next += 1;
        Some(())
    }

    /// How many of the next `count` rows, which are loaded, come before this row or time.
    fn rows_before(&self, before: u64, count: usize) -> usize {
        let columns = &*self.columns;
        if !columns.triggers.by_time() {
            return usize::try_from(before.saturating_sub(self.rows.start))
                .map_or(count, |rows| rows.min(count));
        }
        let t = columns.t;
        let told = columns
            .sources
            .get(t.source)
            .zip(self.loaded.as_ref().and_then(|loaded| loaded.windows.get(t.source)));
        let Some((source, window)) = told else { return count };
        let bytes = window.from(self.rows.start, source.row_bytes);
        let times = time_index::of_rows(columns, &self.intake, bytes, source.row_bytes, count).flatten();
        if times.is_some_and(|times| times.t_max < before) {
            return count;
        }
        let is_later = |row: &[u8]| {
            let told = columns.micros(number::value(t.number, row.get(t.offset..)?))?;
            Some(self.intake.time(told).ok()? >= before)
        };
        let rows = bytes.chunks_exact(source.row_bytes.max(1)).take(count);
        rows.take_while(|row| is_later(row) != Some(true)).count()
    }

    /// The fast way, for rows that are all as they should be.
    fn batch(&mut self, count: usize, sink: &mut Sink<'_>) -> Option<()> {
        let columns = &*self.columns;
        let row = self.rows.start;
        let Buffers { windows, between, .. } = &mut **self.loaded.as_mut()?;
        let column = |place: Place| {
            let source = columns.sources.get(place.source)?;
            let bytes = windows.get(place.source)?.from(row, source.row_bytes);
            let Number { kind, big_endian } = place.number;
            let is_plain = !big_endian || kind.bytes() == 1;
            is_plain.then_some(batch::Column { kind, bytes, stride: source.row_bytes, offset: place.offset })
        };
        let (t, x, y, p) = (column(columns.t)?, column(columns.x)?, column(columns.y)?, column(columns.p)?);
        if !t.kind.is_float() && columns.unit != TimeUnit::Microseconds {
            return None;
        }
        let shift = columns.t_offset_us.checked_add(self.intake.shift_us())?;
        let first = columns.micros(number::value(columns.t.number, t.bytes.get(t.offset..)?))?;
        let first = self.intake.time(first).ok()?;
        let rows = batch::Rows { count, t, x, y, p, scale: scale(columns.unit), shift };
        batch::push(&rows, first, self.intake.geometry(), between, sink)?;
        self.intake.counters.events += count as u64;
        self.intake.counters.bytes_decoded += columns.row_bytes() * count as u64;
        self.rows.start += count as u64;
        Some(())
    }

    /// Row by row; fewer than `count` where the sink takes no more.
    fn slow(&mut self, count: usize, sink: &mut Sink<'_>) -> Result<usize, Error> {
        let bytes = self.columns.row_bytes();
        for done in 0..count {
            match self.row() {
                Some((t, at, on)) => {
                    let taken = self.intake.push(sink, t, at, on, bytes);
                    if taken.map_err(|bad| self.refused(bad))? == Taken::Full {
                        return Ok(done);
                    }
                }
                None => self.intake.fault(Fault::Damaged, bytes),
            }
            self.rows.start += 1;
        }
        Ok(count)
    }

    /// The numbers of the next row; `None` where they are no event's: not whole, or no polarity.
    fn row(&self) -> Option<(i64, (i64, i64), bool)> {
        let columns = &*self.columns;
        let windows = &self.loaded.as_ref()?.windows;
        let value = |place: Place| {
            let row_bytes = columns.sources.get(place.source)?.row_bytes;
            let row = windows.get(place.source)?.from(self.rows.start, row_bytes);
            Some(number::value(place.number, row.get(place.offset..)?))
        };
        let t = columns.micros(value(columns.t)?)?;
        let (x, y) = (value(columns.x)?.whole()?, value(columns.y)?.whole()?);
        let on = match value(columns.p)?.whole()? {
            1 => true,
            0 | -1 => false,
            _ => return None,
        };
        Some((t, (x, y), on))
    }

    fn refused(&self, bad: Bad) -> Error {
        let Bad { kind, what, remedy, .. } = bad;
        Error::new(kind, self.columns.input.path(), what, remedy).at(self.position())
    }
}

fn cut_short(columns: &Columns, source: &Source, row: u64, at: u64) -> Error {
    let Source { name, rows, .. } = source;
    let what = format!("ends within {name}, after {row} of its {rows} rows");
    let remedy = "copy it again from where it was recorded; the events before are good";
    Error::new(ErrorKind::Malformed, columns.input.path(), what, remedy).at(at)
}

impl Cursor for ColumnCursor {
    fn fill(&mut self, sink: &mut Sink<'_>) -> Result<Stop, Error> {
        while self.rows.start < self.rows.end {
            if sink.room() == 0 {
                return Ok(Stop::Full);
            }
            match self.ready()? {
                Ready::Rows(rows) => {
                    let taken = self.take(rows, sink)?;
                    if taken < rows {
                        return Ok(Stop::Full);
                    }
                }
                Ready::Damaged(until) => {
                    let rows = until.saturating_sub(self.rows.start).max(1);
                    self.intake.fault(Fault::Damaged, rows.saturating_mul(self.columns.row_bytes()));
                    self.rows.start = self.rows.start.saturating_add(rows).min(self.rows.end);
                }
            }
        }
        if self.take_last_triggers(sink).is_none() {
            return Ok(Stop::Full);
        }
        self.loaded = None;
        Ok(Stop::End)
    }

    fn position(&self) -> u64 {
        self.columns.position(self.rows.start)
    }

    fn counters(&self) -> Counters {
        self.intake.counters
    }

    fn fork(&self) -> Box<dyn Cursor> {
        let (columns, intake) = (self.columns.clone(), self.intake.clone());
        let fork = Self::new(columns, self.rows.clone(), self.trigger_next, intake);
        Box::new(fork.after(self.events_before))
    }
}
