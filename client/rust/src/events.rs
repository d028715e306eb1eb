//! Packets of events, as they come.

use crate::client::{Link, Wake};
use crate::feed::Feed;
use crate::header::{ABI, Flags, PacketHeader, ShmEvent};
use crate::transport::Gated;
use crate::{Error, Stream};
use core::ops::Deref;
use core::time::Duration;
use iceoryx2::sample::Sample;
use lobula_core::{Event, Span, full_time};
use std::rc::Rc;

/// Receives the events of the camera. Made by [`Client::events`](crate::Client::events).
#[derive(Debug)]
pub struct EventSubscriber {
    feed: Feed<ShmEvent, PacketHeader>,
    cursor: Option<Cursor>,
    lost: u64,
}

/// How far this client has come in a generation.
#[derive(Clone, Copy, Debug)]
struct Cursor {
    generation: u64,
    published: u64,
}

impl EventSubscriber {
    pub(crate) fn open(link: Rc<Link>, stream: Stream, wake: Wake) -> Result<Self, Error> {
        Ok(Self { feed: Feed::open(link, stream, wake)?, cursor: None, lost: 0 })
    }

    /// The next packet, waiting for at most `timeout`. Empty packets (heartbeats) come too.
    ///
    /// While the daemon is gone it waits for it to come back; the first packet of the new one says
    /// [`generation_changed`](Packet::generation_changed).
    ///
    /// # Errors
    /// [`Error::Timeout`]: nothing came. [`Error::NoDaemon`]: nothing came since there is no daemon.
    /// [`Error::HeldTooMany`]: drop a packet first. [`Error::AbiMismatch`]: a daemon of another version came back.
    pub fn recv(&mut self, timeout: Duration) -> Result<Packet, Error> {
        loop {
            let sample = self.feed.recv(timeout)?;
            if let Some(packet) = self.account(sample)? {
                return Ok(packet);
            }
        }
    }

    /// The next packet, if it is there. Never waits.
    ///
    /// # Errors
    /// As [`Self::recv`], but for the first two.
    pub fn try_recv(&mut self) -> Result<Option<Packet>, Error> {
        while let Some(sample) = self.feed.try_recv()? {
            if let Some(packet) = self.account(sample)? {
                return Ok(Some(packet));
            }
        }
        Ok(None)
    }

    /// Events lost so far: published while this client was subscribed, and overwritten before it read them.
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// What it is subscribed to.
    pub fn stream(&self) -> &Stream {
        self.feed.stream()
    }

    /// Works out what was lost before a packet. None: left over from a generation that has gone.
    fn account(&mut self, sample: Sample<Gated, [ShmEvent], PacketHeader>) -> Result<Option<Packet>, Error> {
        let header = *sample.user_header();
        if header.abi != ABI {
            let wire = |abi: u32| format!("wire version {abi}");
            return Err(Error::AbiMismatch { ours: wire(ABI), theirs: wire(header.abi) });
        }
        let end = header.published_before.saturating_add(sample.payload().len() as u64);
        let (changed, lost_before) = match self.cursor {
            None => (false, 0),
            Some(cursor) if header.generation < cursor.generation => return Ok(None),
            Some(cursor) if header.generation > cursor.generation => (true, 0),
            Some(cursor) => (false, header.published_before.saturating_sub(cursor.published)),
        };
        self.cursor = Some(Cursor { generation: header.generation, published: end });
        self.lost += lost_before;
        Ok(Some(Packet { sample, lost_before, generation_changed: changed }))
    }
}

/// A packet of events, in shared memory for as long as it is held: at most 4 at once. Reads as `&[Event]`.
#[derive(Debug)]
pub struct Packet {
    sample: Sample<Gated, [ShmEvent], PacketHeader>,
    lost_before: u64,
    generation_changed: bool,
}

impl Packet {
    /// Its header.
    pub fn header(&self) -> &PacketHeader {
        self.sample.user_header()
    }

    /// Its events with what is needed to know their full time.
    pub fn span(&self) -> Span<'_> {
        let header = self.header();
        Span { t_first: header.t_first, t_last: header.t_last, geometry: header.geometry(), events: self }
    }

    /// Full time of one of its events, in µs.
    pub fn time(&self, event: Event) -> u64 {
        full_time(self.header().t_first, event.t())
    }

    /// Events that were published between the packet before and this one, and overwritten before they were read.
    pub const fn lost_before(&self) -> u64 {
        self.lost_before
    }

    /// Whether the daemon was started anew since the packet before. What was lost across that is not known.
    pub const fn generation_changed(&self) -> bool {
        self.generation_changed
    }

    /// Whether the source has ended.
    pub fn is_end(&self) -> bool {
        self.header().flags().contains(Flags::END)
    }

    /// The packet, unless something was lost before it.
    ///
    /// # Errors
    /// [`Error::Overrun`], with the number of events lost.
    pub fn gapless(self) -> Result<Self, Error> {
        match self.lost_before {
            0 => Ok(self),
            lost => Err(Error::Overrun { lost }),
        }
    }
}

impl Deref for Packet {
    type Target = [Event];

    fn deref(&self) -> &[Event] {
        bytemuck::cast_slice(self.sample.payload())
    }
}
