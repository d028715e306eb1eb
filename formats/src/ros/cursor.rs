//! The cursor over the events of one topic.

use super::event_array::{self, EventArrays};
use super::event_packet::{self, EventPackets};
use super::fields::Wire;
use super::log::{Log, Message};
use super::notes::Notes;
use crate::Error;
use crate::byte_cursor::{Bad, Step};
use crate::container::{Cursor, Piece, Stop};
use lobula_core::{Counters, Event, Fault, Sink, Trigger};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;

/// Most bytes that come before the events of a message: the frame's and the encoding's name are the only long ones.
pub(crate) const HEAD_BYTES_MAX: usize = 4096;

/// More bytes than any event or word has: where so many make none, what comes is no event.
const UNIT_BYTES_MAX: usize = 64;

/// Most bytes of packets looked at to find where a decoder can start.
const SETTLE_BYTES_MAX: usize = 1 << 20;

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

    /// Whether the next message goes on with a word that this one began.
    fn is_in_word(&self) -> bool {
        matches!(self, Self::Packets(packets) if packets.is_in_word())
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
    /// Messages still to come of `log`.
    messages_left: u64,
    /// What comes after them, in a recording that is read in pieces.
    then: VecDeque<(L, u64)>,
    /// Whether another cursor goes on after that.
    goes_on: bool,
    /// Messages that were damaged, and what other logs could not read.
    damaged: Counters,
    in_the_dark: bool,
    ended: bool,
}

impl<L: Log> TopicCursor<L> {
    /// A cursor at the first message of `log`.
    pub fn new(log: L, topic: Arc<EventTopic>, notes: Arc<Notes>, body: Body) -> Self {
        Self {
            log,
            topic,
            notes,
            body,
            left: None,
            messages_left: u64::MAX,
            then: VecDeque::new(),
            goes_on: false,
            damaged: Counters::new(),
            in_the_dark: false,
            ended: false,
        }
    }

    /// The same with buffers of its own.
    pub fn copy(&self) -> Self {
        Self {
            log: self.log.fork(),
            topic: self.topic.clone(),
            notes: self.notes.clone(),
            body: self.body.clone(),
            left: self.left,
            messages_left: self.messages_left,
            then: self.then.iter().map(|(log, messages)| (log.fork(), *messages)).collect(),
            goes_on: self.goes_on,
            damaged: self.damaged,
            in_the_dark: self.in_the_dark,
            ended: self.ended,
        }
    }

    /// The same over another log.
    fn over(&self, log: L) -> Self {
        Self::new(log, self.topic.clone(), self.notes.clone(), self.body.clone())
    }

    /// Cursors over a stretch of messages each, about `n`, or one.
    pub fn pieces(&self, n: usize) -> Result<Vec<Piece>, Error> {
        let piece = |cursor: Self, wrap_us| Piece { cursor: Box::new(cursor), wrap_us };
        match &self.body {
            Body::None => Ok(vec![piece(self.copy(), 0)]),
            Body::Arrays(_) => {
                Ok(self.log.pieces(n)?.into_iter().map(|log| piece(self.over(log), 0)).collect())
            }
            Body::Packets(packets) => {
                let wraps_us = [0].into_iter().chain(std::iter::repeat(packets.wrap_us()));
                Ok(self
                    .packet_pieces(n)?
                    .into_iter()
                    .zip(wraps_us)
                    .map(|(cursor, us)| piece(cursor, us))
                    .collect())
            }
        }
    }

    /// Of packets, whose bytes go on from message to message: each piece but the last also has the first messages of the
    /// next, which are decoded before that one starts, so that it knows time, row and base.
    fn packet_pieces(&self, n: usize) -> Result<Vec<Self>, Error> {
        let logs = self.log.pieces(n)?;
        let settled: Vec<_> =
            logs.par_iter().skip(1).map(|log| self.settled(log)).collect::<Result<_, _>>()?;
        let mut logs = logs.into_iter();
        let Some(mut last) = logs.next().map(|log| self.over(log)) else { return Ok(vec![self.copy()]) };
        let mut pieces = Vec::new();
        for (log, settled) in logs.zip(settled) {
            match settled {
                Some((next, messages)) => {
                    last.then.push_back((log, messages));
                    last.goes_on = true;
                    pieces.push(std::mem::replace(&mut last, next));
                }
                None => last.then.push_back((log, u64::MAX)),
            }
        }
        pieces.push(last);
        Ok(pieces)
    }

    /// A cursor behind so many messages of a log that its decoder knows all that it needs; `None` where they do not tell.
    fn settled(&self, log: &L) -> Result<Option<(Self, u64)>, Error> {
        let Some(messages) = self.messages_to_settle(log.fork())? else { return Ok(None) };
        let mut cursor = Self { messages_left: messages, goes_on: true, ..self.over(log.fork()) };
        // What these messages hold belongs to the piece before.
        let (mut events, mut triggers) = (vec![Event::default(); 1024], [Trigger::default(); 16]);
        while cursor.fill(&mut Sink::with_triggers(&mut events, &mut triggers))? == Stop::Full {}
        let Body::Packets(packets) = &mut cursor.body else { return Ok(None) };
        packets.begin_piece();
        let is_sound = packets.missing() == 0 && cursor.damaged.bytes_faulty == 0;
        let cursor = Self { messages_left: u64::MAX, goes_on: false, ended: false, ..cursor };
        Ok(is_sound.then_some((cursor, messages)))
    }

    /// How many messages of a log tell all; `None` where they do not, or there are none.
    fn messages_to_settle(&self, mut log: L) -> Result<Option<u64>, Error> {
        let Body::Packets(packets) = &self.body else { return Ok(None) };
        let mut bytes = Vec::new();
        for messages in 1.. {
            let Some(message) = log.next(&self.topic.connections)? else { break };
            // Where each message begins anew, the first still tells the number of the next.
            let Some(encoding) = packets.encoding() else { return Ok(Some(messages)) };
            let head = log.peek(HEAD_BYTES_MAX)?;
            let Some(head) = event_packet::Head::parse(head, self.topic.wire) else { break };
            let (head_bytes, available) = (head.bytes, message.available.saturating_sub(head.bytes as u64));
            let mut left = available.min(head.events_bytes.into()) as usize;
            log.take(head_bytes);
            while left > 0 && bytes.len() < SETTLE_BYTES_MAX {
                let some = log.peek(1)?;
                let some = some.get(..left.min(some.len())).unwrap_or_default();
                if some.is_empty() {
                    return Ok(None);
                }
                bytes.extend_from_slice(some);
                let taken = some.len();
                left -= taken;
                log.take(taken);
            }
            if encoding.settled(&bytes).is_some() {
                return Ok(Some(messages));
            }
            if bytes.len() >= SETTLE_BYTES_MAX {
                break;
            }
        }
        Ok(None)
    }

    /// The message that comes next, of this log or the next.
    fn next(&mut self) -> Result<Option<Message>, Error> {
        loop {
            let message = match self.messages_left {
                0 => None,
                _ => self.log.next(&self.topic.connections)?,
            };
            if message.is_some() {
                self.messages_left -= 1;
                return Ok(message);
            }
            let Some((log, messages)) = self.then.pop_front() else { return Ok(None) };
            // The next piece took the first byte of these messages for the first of a word.
            self.in_the_dark |= self.body.is_in_word();
            self.damaged.add(self.log.counters());
            (self.log, self.messages_left) = (log, messages);
        }
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
            match self.next()? {
                Some(message) => self.begin(message)?,
                None => {
                    if !self.goes_on {
                        self.body.end();
                    }
                    self.ended = true;
                }
            }
        }
        Ok(Stop::End)
    }

    fn position(&self) -> u64 {
        if self.ended { self.log.input().len() } else { self.log.position() }
    }

    fn now(&self) -> u64 {
        match &self.body {
            Body::Packets(packets) => packets.now(),
            _ => 0,
        }
    }

    fn in_the_dark(&self) -> bool {
        self.in_the_dark || matches!(&self.body, Body::Packets(packets) if packets.in_the_dark())
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
