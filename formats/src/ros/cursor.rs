//! The cursor over the events of one topic.

use super::event_array::{self, EventArrays};
use super::event_packet::{self, EventPackets};
use super::fields::Wire;
use super::log::{Log, Message};
use super::notes::Notes;
use crate::Error;
use crate::byte_cursor::{Bad, Step};
use crate::container::{Cursor, Stop};
use lobula_core::{Counters, Fault, Sink};
use std::sync::Arc;

/// Most bytes that come before the events of a message: the frame's and the encoding's name are the only long ones.
pub(crate) const HEAD_BYTES_MAX: usize = 4096;

/// More bytes than any event or word has: where so many make none, what comes is no event.
const UNIT_BYTES_MAX: usize = 64;

/// A topic of events.
#[derive(Debug)]
pub(crate) struct EventTopic {
    /// Numbers of its connections.
    pub connections: Vec<u64>,
    /// How its messages are serialised.
    pub wire: Wire,
}

/// Decoder of the messages of a topic, by their type.
#[derive(Clone, Debug)]
pub(crate) enum Body {
    /// There is no message.
    None,
    Arrays(EventArrays),
    Packets(EventPackets),
}

impl Body {
    /// Begins with a message; how many bytes its head has. `None` where it is damaged.
    fn begin(&mut self, head: &[u8], wire: Wire, bytes: u64) -> Option<usize> {
        match self {
            Self::None => None,
            Self::Arrays(arrays) => {
                let head = event_array::Head::parse(head, wire)?;
                arrays.begin(head, bytes).then_some(head.bytes)
            }
            Self::Packets(packets) => {
                let head = event_packet::Head::parse(head, wire)?;
                packets.begin(head, bytes).then_some(head.bytes)
            }
        }
    }

    /// A message was passed over.
    fn skip(&mut self) {
        if let Self::Packets(packets) = self {
            packets.skip();
        }
    }

    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        match self {
            Self::None => Ok(Step { taken: 0, full: false }),
            Self::Arrays(arrays) => arrays.decode(bytes, sink),
            Self::Packets(packets) => packets.decode(bytes, sink),
        }
    }

    /// The message ends after these untaken bytes.
    fn finish(&mut self, unread: u64) {
        match self {
            Self::None => {}
            Self::Arrays(arrays) => arrays.finish(unread),
            Self::Packets(packets) => packets.finish(unread),
        }
    }

    fn end(&mut self) {
        if let Self::Packets(packets) = self {
            packets.end();
        }
    }

    fn counters(&self) -> Counters {
        match self {
            Self::None => Counters::new(),
            Self::Arrays(arrays) => arrays.intake.counters,
            Self::Packets(packets) => packets.counters(),
        }
    }

    fn missing(&self) -> u64 {
        match self {
            Self::Packets(packets) => packets.missing(),
            _ => 0,
        }
    }
}

/// A place among the events of a topic.
#[derive(Debug)]
pub(crate) struct TopicCursor<L> {
    log: L,
    topic: Arc<EventTopic>,
    notes: Arc<Notes>,
    body: Body,
    /// Bytes still to come of the message that is being decoded.
    left: Option<u64>,
    /// Messages that were damaged.
    damaged: Counters,
    ended: bool,
}

impl<L: Log> TopicCursor<L> {
    /// A cursor at the first message of `log`.
    pub fn new(log: L, topic: Arc<EventTopic>, notes: Arc<Notes>, body: Body) -> Self {
        Self { log, topic, notes, body, left: None, damaged: Counters::new(), ended: false }
    }

    /// The same with buffers of its own.
    pub fn copy(&self) -> Self {
        Self {
            log: self.log.fork(),
            topic: self.topic.clone(),
            notes: self.notes.clone(),
            body: self.body.clone(),
            left: self.left,
            damaged: self.damaged,
            ended: self.ended,
        }
    }

    /// Cursors over a stretch of messages each, where none needs what came before it: about `n`, or one.
    pub fn pieces(&self, n: usize) -> Result<Vec<Self>, Error> {
        if !matches!(self.body, Body::Arrays(_)) {
            return Ok(vec![self.copy()]);
        }
        let (topic, notes, body) = (&self.topic, &self.notes, &self.body);
        let cursor = |log| Self::new(log, topic.clone(), notes.clone(), body.clone());
        Ok(self.log.pieces(n)?.into_iter().map(cursor).collect())
    }

    /// Reads the head of a message.
    fn begin(&mut self, message: Message) -> Result<(), Error> {
        let available = usize::try_from(message.available).unwrap_or(usize::MAX);
        let head = self.log.peek(HEAD_BYTES_MAX.min(available))?;
        let head = head.get(..available.min(head.len())).unwrap_or_default();
        match self.body.begin(head, self.topic.wire, message.bytes) {
            Some(head_bytes) => {
                self.log.take(head_bytes);
                self.left = Some(message.available - head_bytes as u64);
            }
            None => {
                let cut = message.available < message.bytes;
                let fault = if cut { Fault::CutShort } else { Fault::Damaged };
                super::log::fault(&mut self.damaged, fault, message.available);
                self.body.skip();
            }
        }
        Ok(())
    }

    /// Decodes of the message; whether the sink takes no more.
    fn decode(&mut self, left: u64, sink: &mut Sink<'_>) -> Result<bool, Error> {
        let mut left = left;
        let mut min = 1;
        let full = loop {
            let position = self.log.position();
            let len = usize::try_from(left).unwrap_or(usize::MAX);
            let bytes = self.log.peek(min.min(len))?;
            let bytes = bytes.get(..len.min(bytes.len())).unwrap_or_default();
            let had = bytes.len();
            let decoded = self.body.decode(bytes, sink);
            let step = decoded.map_err(|bad| {
                let Bad { offset, kind, what, remedy } = bad;
                Error::new(kind, self.log.input().path(), what, remedy).at(position + offset as u64)
            })?;
            self.log.take(step.taken);
            left -= step.taken as u64;
            if step.full {
                break true;
            }
            let rest = had - step.taken;
            let stuck = step.taken == 0 && (had == len || had >= UNIT_BYTES_MAX);
            if left == 0 || had == 0 || stuck {
                break false;
            }
            // What was not taken is the start of an event that goes on in the next piece.
            min = rest + 1;
        };
        self.left = Some(left);
        if !full {
            self.body.finish(left);
            self.left = None;
        }
        Ok(full)
    }
}

impl<L: Log> Cursor for TopicCursor<L> {
    fn fill(&mut self, sink: &mut Sink<'_>) -> Result<Stop, Error> {
        while !self.ended {
            if let Some(left) = self.left {
                if self.decode(left, sink)? {
                    return Ok(Stop::Full);
                }
                self.notes.missing_messages(self.body.missing());
            }
            match self.log.next(&self.topic.connections)? {
                Some(message) => self.begin(message)?,
                None => {
                    self.body.end();
                    self.ended = true;
                }
            }
        }
        Ok(Stop::End)
    }

    fn position(&self) -> u64 {
        if self.ended { self.log.input().len() } else { self.log.position() }
    }

    fn counters(&self) -> Counters {
        let mut counters = self.body.counters();
        counters.add(self.log.counters());
        counters.add(&self.damaged);
        counters
    }

    fn fork(&self) -> Box<dyn Cursor> {
        Box::new(self.copy())
    }
}
