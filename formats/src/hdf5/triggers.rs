//! Triggers: edges on the camera's inputs, in datasets of their own.
//!
//! ```text
//! EXT_TRIGGER/events            one dataset of p, t, id                    Prophesee
//! triggers/{t,id,p,event}       event: how many events come before it      ours
//! ```
//!
//! A trigger whose place among the events no file tells comes before the first event that is not earlier than it, and
//! never before the trigger that precedes it.

use super::columns::{Place, micros};
use super::filter::Scratch;
use super::number::{self, Value};
use super::source::{Loaded, Source, Window};
use crate::input::Input;
use crate::intake::Intake;
use crate::open::TimeUnit;
use crate::{Error, Limits};
use lobula_core::{Polarity, Trigger};

/// Where the columns of triggers are.
#[derive(Debug)]
pub(super) struct Table {
    pub sources: Vec<Source>,
    pub t: Place,
    pub channel: Place,
    pub edge: Place,
    /// How many events come before each, where that is told.
    pub event: Option<Place>,
    pub unit: TimeUnit,
    /// What the file says to add to every time, in µs.
    pub t_offset_us: i64,
}

/// The triggers of a stream of events, in order.
#[derive(Debug, Default)]
pub(super) struct Triggers {
    list: Vec<Placed>,
    /// Whether their places are told by time.
    by_time: bool,
    /// What could not be read, in a sentence.
    pub warning: Option<String>,
}

#[derive(Clone, Copy, Debug)]
struct Placed {
    t: u64,
    /// The row, or the time, of the first event after it; never less than that of the trigger before.
    before: u64,
    channel: u8,
    edge: Polarity,
}

impl Triggers {
    /// Reads all of them, as far as the limits allow.
    pub fn load(table: &Table, input: &Input, intake: &Intake, limits: &Limits) -> Result<Self, Error> {
        let rows = table.sources.iter().map(|source| source.rows).min().unwrap_or(0);
        let most = (2 * limits.index_bytes_max / size_of::<Placed>()) as u64;
        let mut triggers = Self { by_time: table.event.is_none(), ..Self::default() };
        let (mut windows, mut scratch) = (Vec::new(), Scratch::default());
        windows.resize_with(table.sources.len(), Window::default);
        let mut row = 0;
        'rows: while row < rows.min(most) {
            for (source, window) in table.sources.iter().zip(&mut windows) {
                if window.rows.contains(&row) {
                    continue;
                }
                match source.load(input, row, window, &mut scratch)? {
                    Loaded::Yes => {}
                    Loaded::Damaged { until } => {
                        row = until.max(row + 1);
                        continue 'rows;
                    }
                    Loaded::CutShort { .. } => break 'rows,
                }
            }
            triggers.list.extend(table.row(&windows, row, intake));
            row += 1;
        }
        triggers.order();
        let unread = rows - triggers.list.len() as u64;
        let what = || format!("{unread} of its {rows} triggers cannot be read and are left out");
        triggers.warning = (unread > 0).then(what);
        Ok(triggers)
    }

    /// Makes their places ascend.
    fn order(&mut self) {
        let mut least = 0;
        for placed in &mut self.list {
            placed.before = placed.before.max(least);
            least = placed.before;
        }
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Whether it takes the times of all events before to know where they are.
    pub fn by_time(&self) -> bool {
        self.by_time
    }

    /// Time of each.
    pub fn times(&self) -> impl Iterator<Item = u64> {
        self.list.iter().map(|placed| placed.t)
    }

    /// The trigger of this number, if there are so many, to come after `ordinal` events; and the row or time before
    /// which it comes.
    pub fn get(&self, number: usize, ordinal: u64) -> Option<(Trigger, u64)> {
        let Placed { t, before, channel, edge } = *self.list.get(number)?;
        Some((Trigger { t, ordinal, channel, edge }, before))
    }

    /// The first that does not come before the row or time of `place`.
    pub fn first_from(&self, place: u64) -> usize {
        self.list.partition_point(|placed| placed.before < place)
    }
}

impl Table {
    /// The trigger in this row, which is loaded; `None` where the numbers are no trigger's.
    fn row(&self, windows: &[Window], row: u64, intake: &Intake) -> Option<Placed> {
        let value = |place: Place| {
            let row_bytes = self.sources.get(place.source)?.row_bytes;
            let row = windows.get(place.source)?.from(row, row_bytes);
            Some(number::value(place.number, row.get(place.offset..)?))
        };
        let told: Value = value(self.t)?;
        let t = intake.time(micros(self.unit, told)?.checked_add(self.t_offset_us)?).ok()?;
        let before = match self.event {
            Some(event) => u64::try_from(value(event)?.whole()?).ok()?,
            None => t,
        };
        let channel = u8::try_from(value(self.channel)?.whole()?).ok()?;
        let edge = match value(self.edge)?.whole()? {
            1 => Polarity::On,
            0 | -1 => Polarity::Off,
            _ => return None,
        };
        Some(Placed { t, before, channel, edge })
    }
}
