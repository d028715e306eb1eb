//! Messages among the records of a bag or an MCAP file: what the two have in common.

use super::log::{Log, Message, fault};
use super::tape::Tape;
use crate::Error;
use crate::input::Input;
use lobula_core::{Counters, Fault};
use std::fmt::Debug;
use std::marker::PhantomData;
use std::sync::Arc;

/// What a container of records owes.
pub(crate) trait Records: Debug + Send + Sync + Sized + 'static {
    /// A record that tells connections or their types.
    type Names;

    /// Passes over what is left of the record before and looks at the one that comes.
    fn find(log: &mut RecordLog<Self>) -> Result<Found<Self::Names>, Error>;
}

/// What a record is.
pub(crate) enum Found<N> {
    Message(Message),
    Names(N),
    /// Nothing to the reader.
    Other,
    End,
}

/// The messages of a file of records.
#[derive(Debug)]
pub(crate) struct RecordLog<R> {
    pub tape: Tape,
    /// Offsets of the chunks, where an index tells them.
    chunks: Arc<[u64]>,
    /// Bytes left of the record that was found: of a message those to read, and all are passed over by the next look.
    pub left: u64,
    pub counters: Counters,
    records: PhantomData<fn() -> R>,
}

impl<R: Records> RecordLog<R> {
    pub fn new(tape: Tape, chunks: Arc<[u64]>) -> Self {
        Self { tape, chunks, left: 0, counters: Counters::new(), records: PhantomData }
    }

    /// Gives every record of names, by a full pass.
    pub fn scan(
        mut self,
        mut each: impl FnMut(&mut Tape, R::Names) -> Result<(), Error>,
    ) -> Result<(), Error> {
        loop {
            match R::find(&mut self)? {
                Found::Names(names) => each(&mut self.tape, names)?,
                Found::End => return Ok(()),
                Found::Message(_) | Found::Other => {}
            }
        }
    }

    /// The record that comes makes no sense.
    pub fn damaged(&mut self) -> Result<Found<R::Names>, Error> {
        self.tape.pass_damage(&self.chunks, &mut self.counters);
        Ok(Found::Other)
    }
}

impl<R: Records> Log for RecordLog<R> {
    fn next(&mut self, wanted: &[u64]) -> Result<Option<Message>, Error> {
        loop {
            if self.tape.stops_after(self.left) {
                return Ok(None);
            }
            match R::find(self)? {
                Found::Message(message) if wanted.contains(&message.connection) => return Ok(Some(message)),
                Found::Message(message) if message.available < message.bytes => {
                    fault(&mut self.counters, Fault::CutShort, message.available);
                }
                Found::End => return Ok(None),
                Found::Message(_) | Found::Names(_) | Found::Other => {}
            }
        }
    }

    fn peek(&mut self, min: usize) -> Result<&[u8], Error> {
        let most = usize::try_from(self.left).unwrap_or(usize::MAX);
        let bytes = self.tape.peek(min.min(most))?;
        Ok(bytes.get(..most).unwrap_or(bytes))
    }

    fn take(&mut self, bytes: usize) {
        self.tape.take(bytes as u64);
        self.left = self.left.saturating_sub(bytes as u64);
    }

    fn position(&self) -> u64 {
        self.tape.position()
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }

    fn input(&self) -> &Arc<Input> {
        self.tape.input()
    }

    fn fork(&self) -> Self {
        let (chunks, left, counters) = (self.chunks.clone(), self.left, self.counters);
        Self { tape: self.tape.fork(), chunks, left, counters, records: PhantomData }
    }

    /// Cuts between chunks and other records of the file itself, as one pass over them finds these.
    fn pieces(&self, n: usize) -> Result<Vec<Self>, Error> {
        let Some(range) = self.tape.outside() else { return Ok(vec![self.fork()]) };
        let stride = (range.end.saturating_sub(range.start) / n.max(1) as u64).max(1);
        let mut starts = vec![range.start];
        let mut walk = Self { tape: self.tape.skim(), ..self.fork() };
        while !matches!(R::find(&mut walk)?, Found::End) {
            let Some(place) = walk.tape.outside() else { continue };
            let next = place.start.saturating_add(walk.left);
            if next >= range.start + stride * starts.len() as u64 && next < range.end {
                starts.push(next);
            }
        }
        let stops = starts.iter().copied().skip(1).chain([u64::MAX]);
        let piece = |(start, stop): (&u64, u64)| Self::new(self.tape.over(*start..stop), self.chunks.clone());
        Ok(starts.iter().zip(stops).map(piece).collect())
    }
}
