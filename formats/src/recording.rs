//! A recording: its facts, its events in file order, and lazy slices by time and by number.

use crate::container::{Container, Cursor, Stop};
use crate::index::{Index, Seek, Times};
use crate::input::Input;
use crate::{Error, ErrorKind, Format, Frame, ImuSample, Limits, Payload, Stream};
use lobula_core::wire::Encoding;
use lobula_core::{Block, Counters, Event, Geometry, Sink, Span, Trigger, full_time};
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// An open recording. Nothing of it is in memory but its header, and an index once a slice was asked for.
///
/// ```no_run
/// let recording = lobula_formats::open("driving.raw")?;
/// let mut blocks = recording.blocks();
/// while let Some(chunk) = blocks.next_block()? {
///     println!("{} events, {} triggers", chunk.block.len(), chunk.triggers.len());
/// }
/// # Ok::<(), lobula_formats::Error>(())
/// ```
#[derive(Debug)]
pub struct Recording {
    input: Arc<Input>,
    format: &'static Format,
    container: Box<dyn Container>,
    limits: Limits,
    index: Mutex<Option<Arc<Index>>>,
}

impl Recording {
    pub(crate) fn new(
        input: Arc<Input>,
        format: &'static Format,
        container: Box<dyn Container>,
        limits: Limits,
    ) -> Self {
        Self { input, format, container, limits, index: Mutex::new(None) }
    }

    pub(crate) fn container(&self) -> &dyn Container {
        &*self.container
    }

    /// The file.
    pub fn path(&self) -> &Path {
        self.input.path()
    }

    /// Its format's line in the table.
    pub fn format(&self) -> &'static Format {
        self.format
    }

    /// Its length in bytes.
    pub fn bytes(&self) -> u64 {
        self.input.len()
    }

    /// The sensor's size, if the file or an option tells it.
    pub fn geometry(&self) -> Option<Geometry> {
        self.container.geometry()
    }

    /// Size that blocks carry: the sensor's, else the largest that the format can tell.
    pub fn block_geometry(&self) -> Geometry {
        self.container.geometry_of_blocks()
    }

    /// The sensor's size, for what cannot do without it.
    ///
    /// # Errors
    /// Names the option to give where the size is unknown.
    pub fn sensor_size(&self) -> Result<Geometry, Error> {
        let what = "does not tell the size of its sensor, which is needed here";
        let remedy = "give it with --sensor-size WxH";
        self.geometry().ok_or_else(|| Error::new(ErrorKind::NeedsOption, self.path(), what, remedy))
    }

    /// How events are encoded, where that is a camera's format.
    pub fn encoding(&self) -> Option<Encoding> {
        self.container.encoding()
    }

    /// The header's keys and values, in file order.
    pub fn fields(&self) -> Vec<(&str, &str)> {
        self.container.fields()
    }

    /// The camera's bytes as they came, where the file holds them: what a live source would have sent.
    pub fn payload(&self) -> Option<Payload> {
        self.container.payload()
    }

    /// Every stream of the file, also those we do not read.
    pub fn streams(&self) -> Vec<Stream> {
        self.container.streams()
    }

    /// Sentences about what is odd in the file and was no error.
    pub fn warnings(&self) -> Vec<String> {
        self.container.warnings()
    }

    /// Samples of the inertial sensor, in file order; none where the file has none. After an error there is no more.
    pub fn imu(&self) -> Box<dyn Iterator<Item = Result<ImuSample, Error>> + Send> {
        self.container.imu()
    }

    /// Frames, in file order; none where the file has none. After an error there is no more.
    pub fn frames(&self) -> Box<dyn Iterator<Item = Result<Frame, Error>> + Send> {
        self.container.frames()
    }

    /// Every event and trigger, in file order.
    pub fn blocks(&self) -> Blocks {
        let seek = Seek { cursor: self.container.start(), event_next: 0, end: u64::MAX };
        Blocks::new(self.container.geometry_of_blocks(), seek, Select::All)
    }

    /// Events and triggers of `t.start <= time < t.end` (µs), in file order: exactly those a full pass would keep,
    /// also where time steps back. Builds the index if there is none yet.
    ///
    /// # Errors
    /// Those of reading the file.
    pub fn slice_time(&self, t: Range<u64>) -> Result<Blocks, Error> {
        let seek = match self.container.seek_time(&t) {
            Some(seek) => seek?,
            None => self.index()?.seek_time(&t),
        };
        Ok(self.slice(seek, Select::Time(t)))
    }

    /// The events of these numbers, counted from 0 in file order, and the triggers whose
    /// [`ordinal`](Trigger::ordinal) is among them. Builds the index if there is none yet.
    ///
    /// # Errors
    /// Those of reading the file.
    pub fn slice_events(&self, numbers: Range<u64>) -> Result<Blocks, Error> {
        let seek = self.index()?.seek_event(numbers.start);
        Ok(self.slice(seek, Select::Events(numbers)))
    }

    fn slice(&self, seek: Option<Seek>, select: Select) -> Blocks {
        let nowhere = || Seek { cursor: self.container.start(), event_next: 0, end: 0 };
        Blocks::new(self.container.geometry_of_blocks(), seek.unwrap_or_else(nowhere), select)
    }

    /// The index, built by a full pass at the first call.
    ///
    /// # Errors
    /// Those of reading the file.
    pub fn index(&self) -> Result<Arc<Index>, Error> {
        let mut index = self.index.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(index) = &*index {
            return Ok(index.clone());
        }
        let built = Arc::new(Index::build(&*self.container, &self.limits)?);
        *index = Some(built.clone());
        Ok(built)
    }
}

/// Events of one block, and the triggers among them.
#[derive(Debug)]
pub struct Chunk<'a> {
    /// The events, to read or to filter in place. It carries the sensor's size; where that is unknown, the largest
    /// that the encoding can tell (2048x2048 for EVT).
    pub block: Block<'a>,
    /// The triggers, in file order; [`ordinal`](Trigger::ordinal) tells where they stand among all events.
    pub triggers: &'a [Trigger],
    /// How many events of the block come before each trigger.
    places: &'a [usize],
}

/// What comes next in a recording.
#[derive(Clone, Copy, Debug)]
pub enum Part<'a> {
    /// Events with no trigger between them.
    Events(Span<'a>),
    /// A trigger.
    Trigger(Trigger),
}

/// What a slice keeps.
#[derive(Clone, Debug)]
enum Select {
    All,
    Time(Range<u64>),
    Events(Range<u64>),
}

/// Blocks of a recording or a slice, one after the other in the same memory (about 130 KiB).
#[derive(Debug)]
pub struct Blocks {
    cursor: Box<dyn Cursor>,
    memory: Memory,
    select: Select,
    event_next: u64,
    end: u64,
    /// An error that came after good events: told at the next call.
    failed: Option<Error>,
    ended: bool,
}

impl Blocks {
    fn new(geometry: Geometry, seek: Seek, select: Select) -> Self {
        let Seek { cursor, event_next, end } = seek;
        let memory = Memory::new(geometry);
        Self { cursor, memory, select, event_next, end, failed: None, ended: false }
    }

    /// The next events or triggers; `None` at the end.
    ///
    /// # Errors
    /// Where the file cannot be read on: after every event before that place was given.
    pub fn next_block(&mut self) -> Result<Option<Chunk<'_>>, Error> {
        loop {
            if let Some(failed) = self.failed.take() {
                self.ended = true;
                return Err(failed);
            }
            if self.is_done() {
                return Ok(None);
            }
            match self.memory.fill(&mut *self.cursor) {
                Ok(stop) => self.ended = stop == Stop::End,
                Err(error) => self.failed = Some(error),
            }
            let event_first = self.event_next;
            self.event_next += self.memory.len as u64;
            self.memory.place(event_first);
            self.memory.keep(&self.select, event_first);
            if !self.memory.is_empty() {
                return Ok(Some(self.memory.chunk()));
            }
        }
    }

    fn is_done(&self) -> bool {
        let past = match &self.select {
            Select::Events(numbers) => self.event_next >= numbers.end,
            _ => false,
        };
        self.ended || past || self.cursor.position() >= self.end
    }

    /// Offset in the file up to which all is decoded.
    pub fn position(&self) -> u64 {
        self.cursor.progress()
    }

    /// What the decoder did, counted from the start of the recording; of a slice by time in HDF5, from where its
    /// decoding started.
    pub fn counters(&self) -> Counters {
        self.cursor.counters()
    }
}

/// The memory of one block and its triggers.
#[derive(Debug)]
pub(crate) struct Memory {
    geometry: Geometry,
    events: Box<[Event]>,
    triggers: Box<[Trigger]>,
    places: Box<[usize]>,
    len: usize,
    triggers_len: usize,
    t_first: u64,
    t_last: u64,
}

impl Memory {
    /// Events of a block: 64 KiB, which stay in the nearest caches through a chain of stages.
    const EVENTS: usize = 8192;
    const TRIGGERS: usize = 64;

    pub fn new(geometry: Geometry) -> Self {
        let events = vec![Event::default(); Self::EVENTS].into_boxed_slice();
        let triggers = vec![Trigger::default(); Self::TRIGGERS].into_boxed_slice();
        let places = vec![0; Self::TRIGGERS].into_boxed_slice();
        Self { geometry, events, triggers, places, len: 0, triggers_len: 0, t_first: 0, t_last: 0 }
    }

    /// Decodes the next block. At an error, what was decoded before is here.
    pub fn fill(&mut self, cursor: &mut dyn Cursor) -> Result<Stop, Error> {
        let mut sink = Sink::with_triggers(&mut self.events, &mut self.triggers);
        let stop = cursor.fill(&mut sink);
        self.triggers_len = sink.triggers().len();
        let block = sink.block(self.geometry);
        (self.len, self.t_first, self.t_last) = (block.len(), block.t_first, block.t_last);
        stop
    }

    pub fn events(&self) -> &[Event] {
        &self.events[..self.len]
    }

    fn triggers(&self) -> &[Trigger] {
        &self.triggers[..self.triggers_len]
    }

    fn is_empty(&self) -> bool {
        self.len == 0 && self.triggers_len == 0
    }

    /// Times of the events and triggers.
    pub fn times(&self) -> Option<Times> {
        // Distance to the anchor fits 32 bits and has no branch: this runs over every event of an index's pass.
        let anchor = self.t_first as u32;
        let near = |event: &Event| event.t().wrapping_sub(anchor) as i32;
        let low = self.events().iter().map(near).min();
        let high = self.events().iter().map(near).max();
        let full = |near: i32| full_time(self.t_first, anchor.wrapping_add_signed(near));
        let events = low.zip(high).map(|(low, high)| Times { t_min: full(low), t_max: full(high) });
        let triggers = self.triggers().iter().map(|trigger| Times { t_min: trigger.t, t_max: trigger.t });
        triggers.fold(events, |times, trigger| Times::join(times, Some(trigger)))
    }

    /// Finds where the triggers stand; `event_first` is the number of the first event here.
    fn place(&mut self, event_first: u64) {
        let len = self.len as u64;
        for (place, trigger) in self.places.iter_mut().zip(&self.triggers[..self.triggers_len]) {
            *place = trigger.ordinal.saturating_sub(event_first).min(len) as usize;
        }
    }

    /// Keeps what a slice selects; `event_first` is the number of the first event here.
    fn keep(&mut self, select: &Select, event_first: u64) {
        match select {
            Select::All => {}
            Select::Time(t) => self.keep_time(t),
            Select::Events(numbers) => self.keep_numbers(numbers, event_first),
        }
    }

    fn keep_time(&mut self, t: &Range<u64>) {
        let (mut kept, mut done) = (0, 0);
        for i in 0..=self.triggers_len {
            // The events before this trigger, in the end those after the last.
            let end = if i < self.triggers_len { self.places[i] } else { self.len };
            for j in done..end {
                let event = self.events[j];
                self.events[kept] = event;
                kept += usize::from(t.contains(&full_time(self.t_first, event.t())));
            }
            done = done.max(end);
            if i < self.triggers_len {
                self.places[i] = kept;
            }
        }
        self.len = kept;
        self.keep_triggers(|trigger| t.contains(&trigger.t));
    }

    fn keep_numbers(&mut self, numbers: &Range<u64>, event_first: u64) {
        let here = |number: u64| number.saturating_sub(event_first).min(self.len as u64) as usize;
        let start = here(numbers.start);
        let end = here(numbers.end).max(start);
        self.events.copy_within(start..end, 0);
        self.len = end - start;
        for place in &mut self.places[..self.triggers_len] {
            *place = (*place).clamp(start, end) - start;
        }
        self.keep_triggers(|trigger| numbers.contains(&trigger.ordinal));
    }

    fn keep_triggers(&mut self, keep: impl Fn(&Trigger) -> bool) {
        let mut kept = 0;
        for i in 0..self.triggers_len {
            let trigger = self.triggers[i];
            (self.triggers[kept], self.places[kept]) = (trigger, self.places[i]);
            kept += usize::from(keep(&trigger));
        }
        self.triggers_len = kept;
    }

    fn chunk(&mut self) -> Chunk<'_> {
        let events = &mut self.events[..self.len];
        let block = Block::new(self.t_first, self.t_last, self.geometry, events);
        let (triggers, places) = (&self.triggers[..self.triggers_len], &self.places[..self.triggers_len]);
        Chunk { block, triggers, places }
    }
}

impl Chunk<'_> {
    /// The events, to read.
    pub fn span(&self) -> Span<'_> {
        self.block.span()
    }

    /// Events and triggers in file order. To be taken before the block is filtered: triggers keep their place in it.
    pub fn parts(&self) -> impl Iterator<Item = Part<'_>> {
        let span = self.span();
        let ends = self.places.iter().copied().chain([span.events.len()]);
        let starts = [0].into_iter().chain(self.places.iter().copied());
        let between =
            starts.zip(ends).map(move |(start, end)| span.events.get(start..end).unwrap_or_default());
        let triggers = self.triggers.iter().map(|trigger| Some(*trigger)).chain([None]);
        between.zip(triggers).flat_map(move |(events, trigger)| {
            let events = (!events.is_empty()).then(|| Part::Events(span.with_events(events)));
            events.into_iter().chain(trigger.map(Part::Trigger))
        })
    }
}
