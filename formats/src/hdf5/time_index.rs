//! Where in the rows a time is: the earliest and latest of each stretch, from a pass over the times alone.
//!
//! It takes 16 bytes to 16384 rows, and holds for times in any order.

use super::batch;
use super::columns::Columns;
use super::datatype::NumberKind;
use super::filter::Scratch;
use super::number;
use super::source::{Loaded, Window};
use super::triggers::Triggers;
use crate::index::Times;
use crate::intake::Intake;
use crate::open::TimeUnit;
use crate::{Error, Limits};
use std::ops::Range;

/// Rows of a stretch, at first.
const STRETCH_ROWS: u64 = 16384;

#[derive(Debug)]
pub(super) struct TimeIndex {
    rows: u64,
    stretch: u64,
    /// Of each stretch; nothing where no row of it has a time.
    times: Vec<Option<Times>>,
    /// Number of the first trigger of each stretch.
    triggers: Vec<usize>,
}

impl TimeIndex {
    /// Goes over all times. Nothing comes of it where one of them is an error: a full pass is to tell that.
    pub fn build(columns: &Columns, intake: &Intake, limits: &Limits) -> Result<Option<Self>, Error> {
        let stretches_max = (limits.index_bytes_max / size_of::<Option<Times>>()).max(1) as u64;
        let fewest = columns.rows.div_ceil(stretches_max);
        let stretch = STRETCH_ROWS.max(fewest.checked_next_power_of_two().unwrap_or(u64::MAX));
        // At least one, for triggers without any events.
        let stretches = usize::try_from(columns.rows.div_ceil(stretch).max(1)).unwrap_or(usize::MAX);
        let mut index =
            Self { rows: columns.rows, stretch, times: vec![None; stretches], triggers: Vec::new() };
        let (mut window, mut scratch) = (Window::default(), Scratch::default());
        let Some(source) = columns.sources.get(columns.t.source) else { return Ok(None) };
        let mut row = 0;
        while row < columns.rows {
            let end = (row / stretch + 1).saturating_mul(stretch).min(columns.rows);
            if !window.rows.contains(&row) {
                match source.load(&columns.input, row, &mut window, &mut scratch)? {
                    Loaded::Yes => {}
                    Loaded::Damaged { until } => {
                        row = until.max(row + 1);
                        continue;
                    }
                    Loaded::CutShort { .. } => return Ok(None),
                }
            }
            let end = end.min(window.rows.end);
            let bytes = window.from(row, source.row_bytes);
            let count = usize::try_from(end - row).unwrap_or(usize::MAX);
            let Some(times) = of_rows(columns, intake, bytes, source.row_bytes, count) else {
                return Ok(None);
            };
            index.add(row, times);
            row = end;
        }
        index.add_triggers(&columns.triggers);
        Ok(Some(index))
    }

    fn add(&mut self, row: u64, times: Option<Times>) {
        let number = usize::try_from(row / self.stretch).unwrap_or(usize::MAX);
        if let Some(slot) = self.times.get_mut(number) {
            *slot = Times::join(*slot, times);
        }
    }

    /// Finds the stretches that the triggers are in, and joins their times.
    fn add_triggers(&mut self, triggers: &Triggers) {
        let mut latest = None;
        for (number, times) in self.times.iter().enumerate() {
            let first = match latest {
                _ if !triggers.by_time() => triggers.first_from(number as u64 * self.stretch),
                // Those up to here come before an event of an earlier stretch.
                Some(latest) => triggers.first_from(latest + 1),
                None => 0,
            };
            self.triggers.push(first);
            latest = latest.max(times.map(|times| times.t_max));
        }
        for (trigger, t) in triggers.times().enumerate() {
            let stretch = self.triggers.partition_point(|first| *first <= trigger).saturating_sub(1);
            if let Some(times) = self.times.get_mut(stretch) {
                *times = Times::join(*times, Some(Times { t_min: t, t_max: t }));
            }
        }
    }

    /// Number of the first trigger of the stretch that begins at this row.
    pub fn first_trigger(&self, row: u64) -> usize {
        let number = usize::try_from(row / self.stretch).unwrap_or(usize::MAX);
        self.triggers.get(number).copied().unwrap_or_default()
    }

    /// Rows outside of which no time is in the range, nor a trigger's.
    pub fn rows(&self, t: &Range<u64>) -> Option<Range<u64>> {
        let inside = |times: &Option<Times>| times.is_some_and(|times| times.overlaps(t));
        let first = self.times.iter().position(inside)? as u64;
        let last = self.times.iter().rposition(inside)? as u64;
        Some(first * self.stretch..(last + 1).saturating_mul(self.stretch).min(self.rows))
    }
}

/// Earliest and latest time of these rows, of those that have one; `None` where one is an error.
pub(super) fn of_rows(
    columns: &Columns,
    intake: &Intake,
    bytes: &[u8],
    stride: usize,
    count: usize,
) -> Option<Option<Times>> {
    let (kind, offset) = (columns.t.number.kind, columns.t.offset);
    let bytes = bytes.get(..count.checked_mul(stride)?)?;
    let is_plain = !columns.t.number.big_endian && columns.unit == TimeUnit::Microseconds;
    if is_plain && !kind.is_float() && kind != NumberKind::U64 {
        let column = batch::Column { kind, bytes, stride, offset };
        if let Some((least, most)) = batch::extent(column) {
            let time = |told: i64| intake.time(told.checked_add(columns.t_offset_us)?).ok();
            return Some(Some(Times { t_min: time(least)?, t_max: time(most)? }));
        }
    }
    let mut times = None;
    for row in bytes.chunks_exact(stride) {
        if let Some(told) = columns.micros(number::value(columns.t.number, row.get(offset..)?)) {
            let t = intake.time(told).ok()?;
            times = Times::join(times, Some(Times { t_min: t, t_max: t }));
        }
    }
    Some(times)
}
