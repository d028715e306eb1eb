//! Writes HDF5 files in our own layout and in DSEC's, in constant memory but for 64 bytes to 16384 events. Only ours has
//! a place for triggers.
//!
//! Chunks are written as they fill, and what finds them after the last: so a file is one only once it is finished.

mod column;
mod structure;

use super::filter::Codec;
use crate::output::Output;
use crate::write::{self, Compression, Encoder, Kept, WriteOptions};
use crate::{Error, ErrorKind};
use column::{Column, Element};
use lobula_core::{Geometry, Polarity, Span, Trigger};
use std::path::Path;
use structure::{Attribute, Group, Structures};

/// Events of a chunk: a window of a few ms needs to decompress little, and no reader fails at 2^16 and more.
const CHUNK_ROWS: usize = 16384;

/// Which datasets are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layout {
    /// `events/{t,x,y,p}` with attributes for size and unit; `triggers/{t,id,p,event}` if there are any.
    Own,
    /// `events/{t,x,y,p}`, t from `t_offset` on, and `ms_to_idx`.
    Dsec,
}

impl Layout {
    fn new(path: &Path, name: Option<&str>) -> Result<Self, Error> {
        match name {
            None | Some("lobula") => Ok(Self::Own),
            Some("dsec") => Ok(Self::Dsec),
            Some(other) => {
                let what = format!("cannot be written: there is no layout of HDF5 called {other}");
                Err(Error::new(ErrorKind::Refused, path, what, "give one of lobula, dsec with --layout"))
            }
        }
    }
}

/// Starts a file of the layout asked for.
pub(super) fn create(
    path: &Path,
    geometry: Option<Geometry>,
    options: &WriteOptions,
) -> Result<Box<dyn Encoder>, Error> {
    let layout = Layout::new(path, options.layout.as_deref())?;
    let codec = codec(path, options.compression)?;
    let mut output = Output::create(path, options.overwrite)?;
    // The superblock comes last.
    output.write(&[0; structure::SUPERBLOCK_BYTES])?;
    let column = |element| Column::new(element, codec);
    let times = if layout == Layout::Dsec { Element::U32 } else { Element::I64 };
    Ok(Box::new(Hdf5Encoder {
        output,
        layout,
        geometry,
        times: Vec::with_capacity(CHUNK_ROWS),
        t: column(times),
        x: column(Element::U16),
        y: column(Element::U16),
        p: column(Element::U8),
        milliseconds: column(Element::U64),
        triggers: Triggers {
            t: column(Element::I64),
            id: column(Element::U8),
            p: column(Element::U8),
            event: column(Element::U64),
        },
        origin: None,
        events: 0,
    }))
}

fn codec(path: &Path, compression: Option<Compression>) -> Result<Codec, Error> {
    match compression.unwrap_or(Compression::Gzip) {
        Compression::None => Ok(Codec::None),
        Compression::Gzip => Ok(Codec::Gzip),
        Compression::Lz4 => Ok(Codec::Lz4),
        Compression::Zstd => Ok(Codec::Zstd),
        other => {
            let what = format!("cannot be written with {}", other.name());
            let remedy = "give one of none, gzip, lz4, zstd with --compression";
            Err(Error::new(ErrorKind::Refused, path, what, remedy))
        }
    }
}

#[derive(Debug)]
struct Hdf5Encoder {
    output: Output,
    layout: Layout,
    geometry: Option<Geometry>,
    /// Of the events of the chunk that is being filled; which number is written for them is known when it is full.
    times: Vec<u64>,
    t: Column,
    x: Column,
    y: Column,
    p: Column,
    /// For each millisecond from the origin on, the number of the first event that is not before it.
    milliseconds: Column,
    triggers: Triggers,
    /// Time from which DSEC counts: the least of the first chunk.
    origin: Option<u64>,
    /// Events in chunks that were full.
    events: u64,
}

/// Columns of triggers.
#[derive(Debug)]
struct Triggers {
    t: Column,
    id: Column,
    p: Column,
    /// How many events come before.
    event: Column,
}

impl Encoder for Hdf5Encoder {
    fn events(&mut self, span: Span<'_>) -> Result<(), Error> {
        let mut rest = span.events;
        while !rest.is_empty() {
            let (these, others) = rest.split_at(rest.len().min(CHUNK_ROWS - self.times.len()));
            self.times.extend(these.iter().map(|event| span.time(*event)));
            self.x.extend(these.iter().map(|event| event.x().into()));
            self.y.extend(these.iter().map(|event| event.y().into()));
            self.p.extend(these.iter().map(|event| event.is_on().into()));
            if self.times.len() == CHUNK_ROWS {
                self.chunk()?;
            }
            rest = others;
        }
        Ok(())
    }

    fn trigger(&mut self, trigger: Trigger) -> Result<Kept, Error> {
        if self.layout == Layout::Dsec {
            return Ok(Kept::No);
        }
        let event = self.events + self.times.len() as u64;
        let t = self.told(trigger.t, 0).map_err(|error| {
            let what = format!("the time {} µs of a trigger {error}", trigger.t);
            write::refused(self.output.path(), event, &what, "write it with --rebase")
        })?;
        let Triggers { t: times, id, p, event: events } = &mut self.triggers;
        times.extend([t]);
        id.extend([trigger.channel.into()]);
        p.extend([(trigger.edge == Polarity::On).into()]);
        events.extend([event]);
        if times.gathered() == CHUNK_ROWS {
            for column in [times, id, p, events] {
                column.chunk(&mut self.output)?;
            }
        }
        Ok(Kept::Yes)
    }

    fn finish(mut self: Box<Self>) -> Result<u64, Error> {
        self.chunk()?;
        let Self { output, layout, geometry, t, x, y, p, milliseconds, triggers, origin, .. } = *self;
        let mut structures = Structures::new(output);
        let mut events = Group::default();
        for (name, column) in [("p", p), ("t", t), ("x", x), ("y", y)] {
            events.add(name, column.finish(&mut structures)?);
        }
        let mut attributes = size(geometry);
        if layout == Layout::Own {
            attributes.push(Attribute::text("time_unit", "us"));
            attributes.push(Attribute::float("timestamp_scale_ms", 0.001));
        }
        let mut root = Group::default();
        root.add("events", events.write(&mut structures, &attributes)?.object);
        if triggers.t.rows() > 0 {
            let Triggers { t, id, p, event } = triggers;
            let mut triggers = Group::default();
            for (name, column) in [("event", event), ("id", id), ("p", p), ("t", t)] {
                triggers.add(name, column.finish(&mut structures)?);
            }
            root.add("triggers", triggers.write(&mut structures, &[])?.object);
        }
        if layout == Layout::Dsec {
            root.add("ms_to_idx", milliseconds.finish(&mut structures)?);
            let origin = origin.unwrap_or(0) as i64;
            root.add("t_offset", structures.scalar(origin)?);
        }
        let root = root.write(&mut structures, &[])?;
        structures.finish(&root)
    }
}

/// The sensor's size, if it is known: in both layouts, though DSEC's own files have none.
fn size(geometry: Option<Geometry>) -> Vec<Attribute> {
    let of = |geometry: Geometry| {
        let side = |name, side: u16| Attribute::integer(name, side.into());
        [side("height", geometry.height), side("width", geometry.width)]
    };
    geometry.map(of).into_iter().flatten().collect()
}

impl Hdf5Encoder {
    /// Writes what was gathered as one chunk of each column.
    fn chunk(&mut self) -> Result<(), Error> {
        let times = std::mem::take(&mut self.times);
        let Some(least) = times.iter().min() else { return Ok(()) };
        let origin = *self.origin.get_or_insert(if self.layout == Layout::Dsec { *least } else { 0 });
        for (i, t) in times.iter().enumerate() {
            let told = self.told(*t, origin).map_err(|error| self.refused(error, i, *t))?;
            self.t.extend([told]);
            if self.layout == Layout::Dsec {
                self.milliseconds_to(told, self.events + i as u64)?;
            }
        }
        for column in [&mut self.t, &mut self.x, &mut self.y, &mut self.p] {
            column.chunk(&mut self.output)?;
        }
        self.events += times.len() as u64;
        self.times = times;
        self.times.clear();
        Ok(())
    }

    /// What is written for a time; else why it cannot be.
    fn told(&self, t: u64, origin: u64) -> Result<u64, &'static str> {
        match self.layout {
            Layout::Own => i64::try_from(t).map(|_| t).map_err(|_| "is beyond the 2^63 µs of the format"),
            Layout::Dsec => {
                i64::try_from(t).map_err(|_| "is beyond the 2^63 µs of the format")?;
                let told = t.checked_sub(origin).ok_or("is before those of the first chunk")?;
                u32::try_from(told).map(u64::from).map_err(|_| "is beyond the 2^32 µs (71 minutes) of DSEC")
            }
        }
    }

    /// Adds milliseconds up to the one that `t` is in.
    fn milliseconds_to(&mut self, t: u64, event: u64) -> Result<(), Error> {
        while self.milliseconds.rows() * 1000 <= t {
            self.milliseconds.extend([event]);
            if self.milliseconds.gathered() == CHUNK_ROWS {
                self.milliseconds.chunk(&mut self.output)?;
            }
        }
        Ok(())
    }

    fn refused(&self, why: &str, i: usize, t: u64) -> Error {
        let remedy = match self.layout {
            Layout::Own => "write it with --rebase",
            Layout::Dsec => "write it with --layout lobula, or cut it with --t-start and --t-stop",
        };
        let what = format!("the time {t} µs {why}");
        write::refused(self.output.path(), self.events + i as u64, &what, remedy)
    }
}
