//! HDF5: events as columns, in the layouts that people publish them in.
//!
//! Spec: <https://support.hdfgroup.org/documentation/hdf5/latest/_f_m_t3.html>; the layouts are in `layout`
//!
//! ```text
//!  file ─▶ object, group, attribute ─▶ layout ─▶ source (chunks ─▶ filter) ─▶ columns ─▶ events
//! ```
//!
//! The reader is our own and knows the part of the format that recordings use: no address or length of the file is
//! believed before the bytes are there, and nothing is read before it is needed.

mod attribute;
mod batch;
mod chunks;
mod columns;
mod dataset;
mod datatype;
mod fields;
mod file;
mod filter;
mod group;
mod heap;
mod layout;
mod number;
mod object;
mod source;
mod time_index;
mod tree;
mod triggers;
mod write;

use crate::container::{Container, Cursor, Piece};
use crate::index::Seek;
use crate::input::Input;
use crate::intake::Intake;
use crate::open::Probe;
use crate::{Error, Format, Limits, OpenOptions, Stream, StreamKind};
use lobula_core::Geometry;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use columns::{ColumnCursor, Columns};
use layout::Layout;
use time_index::TimeIndex;
use triggers::Triggers;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format =
    Format { name: "HDF5", extensions: &["h5", "hdf5", "hdf"], create: Some(write::create), probe, open };

/// Largest sensor whose pixels an event can hold.
const GEOMETRY_MAX: Geometry = Geometry::new(u16::MAX, 1 << 15);

fn probe(probe: &Probe<'_>) -> bool {
    // Before it there may be a block of 512, 1024, 2048 ... bytes.
    let places = [0, 512, 1024, 2048];
    places.iter().any(|at| probe.head.get(*at..).is_some_and(|rest| rest.starts_with(&file::SIGNATURE)))
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let file = file::File::open(input.clone())?;
    let layout = Layout::find(&file)?;
    let events = layout.events(&file, options)?;
    source::check_memory(&file, &events.sources)?;
    let [t, x, y, p] = events.places;
    let rows = events.sources.iter().map(|source| source.rows).min().unwrap_or(0);
    let intake = Intake::new(events.geometry.unwrap_or(GEOMETRY_MAX), options);
    let mut warnings = events.warnings;
    let triggers = layout.triggers(&file, &events.path, (events.unit, events.t_offset_us));
    let triggers = triggers.and_then(|found| match found {
        Some((name, table)) => {
            source::check_memory(&file, &table.sources)?;
            Ok((Some(name), Triggers::load(&table, &input, &intake, &options.limits)?))
        }
        None => Ok((None, Triggers::default())),
    });
    // Events without them are better than none.
    let (trigger_name, triggers) = triggers.unwrap_or_else(|error| {
        warnings.push(format!("its triggers are left out: it {}", error.what()));
        (None, Triggers::default())
    });
    warnings.extend(triggers.warning.clone());
    let columns = Columns {
        input,
        sources: events.sources,
        t,
        x,
        y,
        p,
        rows,
        unit: events.unit,
        t_offset_us: events.t_offset_us,
        triggers,
    };
    let named = |kind| move |name: &str| Stream::new(kind, name);
    let streams = layout.names().map(named(StreamKind::Events));
    let of_triggers = |name: &str| {
        let rest = trigger_name.as_deref().and_then(|triggers| name.strip_prefix(triggers));
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    };
    let others = layout.others().filter(|name| !of_triggers(name));
    let streams = streams.chain(trigger_name.as_deref().map(named(StreamKind::Triggers)));
    let streams = streams.chain(others.map(named(StreamKind::Other))).collect();
    Ok(Box::new(Hdf5Recording {
        columns: Arc::new(columns),
        geometry: events.geometry,
        intake,
        streams,
        warnings,
        path: events.path,
        limits: options.limits,
        times: Mutex::new(None),
    }))
}

#[derive(Debug)]
struct Hdf5Recording {
    columns: Arc<Columns>,
    geometry: Option<Geometry>,
    /// Before the first event.
    intake: Intake,
    streams: Vec<Stream>,
    warnings: Vec<String>,
    /// Of the events in the file.
    path: String,
    limits: Limits,
    /// Made for the first slice by time; nothing in it where the times cannot be gone over alone.
    times: Mutex<Option<Option<Arc<TimeIndex>>>>,
}

impl Hdf5Recording {
    fn times(&self) -> Result<Option<Arc<TimeIndex>>, Error> {
        let mut times = self.times.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(times) = &*times {
            return Ok(times.clone());
        }
        let built = TimeIndex::build(&self.columns, &self.intake, &self.limits)?.map(Arc::new);
        Ok(times.insert(built).clone())
    }

    fn cursor(&self, rows: Range<u64>, trigger_next: usize) -> ColumnCursor {
        ColumnCursor::new(self.columns.clone(), rows, trigger_next, self.intake.clone())
    }
}

impl Container for Hdf5Recording {
    fn geometry(&self) -> Option<Geometry> {
        self.geometry
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.intake.geometry()
    }

    fn fields(&self) -> Vec<(&str, &str)> {
        vec![("events", &self.path), ("time unit", self.columns.unit.name())]
    }

    fn streams(&self) -> Vec<Stream> {
        self.streams.clone()
    }

    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    fn start(&self) -> Box<dyn Cursor> {
        Box::new(self.cursor(0..self.columns.rows, 0))
    }

    fn pieces(&self, n: usize) -> Result<Vec<Piece>, Error> {
        let Columns { triggers, rows: all, .. } = &*self.columns;
        if *all == 0 || triggers.by_time() && !triggers.is_empty() {
            // Where these come, only what is before tells.
            return Ok(vec![Piece { cursor: self.start(), wrap_us: 0 }]);
        }
        let rows = self.columns.piece_rows(n as u64);
        let starts = (0..self.columns.rows).step_by(usize::try_from(rows).unwrap_or(usize::MAX));
        let piece = |start: u64| start..start.saturating_add(rows).min(self.columns.rows);
        let cursor = |start| self.cursor(piece(start), triggers.first_from(start));
        Ok(starts.map(|start| Piece { cursor: Box::new(cursor(start)), wrap_us: 0 }).collect())
    }

    fn seek_time(&self, t: &Range<u64>) -> Option<Result<Option<Seek>, Error>> {
        let times = match self.times() {
            Ok(times) => times?,
            Err(error) => return Some(Err(error)),
        };
        // The cursor itself ends at the last row.
        let seek = |rows: Range<u64>| {
            let event_next = rows.start;
            let cursor = self.cursor(rows, times.first_trigger(event_next)).after(event_next);
            Seek { event_next, cursor: Box::new(cursor), end: u64::MAX }
        };
        Some(Ok(times.rows(t).map(seek)))
    }
}
