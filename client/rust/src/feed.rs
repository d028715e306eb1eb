//! The receiving end of a stream, of events or of tensors: opens its port, waits, and opens it again when the daemon
//! has gone and come back.

use crate::client::{Link, Wake};
use crate::control::TensorInfo;
use crate::transport::{Gated, free_bytes, open_services};
use crate::{Error, Qos, Root, Stream};
use core::fmt::Debug;
use core::time::Duration;
use iceoryx2::node::Node;
use iceoryx2::port::ReceiveError;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ZeroCopySend;
use iceoryx2::sample::Sample;
use std::rc::Rc;
use std::time::Instant;

/// Longest sleep before the daemon is looked for again.
const NAP: Duration = Duration::from_millis(50);
/// Looks for a packet of one that polls before the clock and the daemon are looked at.
const POLLS: u32 = 64;
/// How long a service may be in the making, or in its removal.
const SETTLE_WITHIN: Duration = Duration::from_secs(2);

/// Room for the files of a node, a port and its connection: some ten of a few KB.
const PORT_BYTES: u64 = 256 << 10;

#[derive(Debug)]
pub(crate) struct Feed<T, H>
where
    T: Debug + ZeroCopySend + 'static,
    H: Debug + ZeroCopySend + 'static,
{
    link: Rc<Link>,
    stream: Stream,
    wake: Wake,
    port: Option<Port<T, H>>,
    tensor: Option<TensorInfo>,
    epoch: u64,
    misses: u32,
}

#[derive(Debug)]
struct Port<T, H>
where
    T: Debug + ZeroCopySend + 'static,
    H: Debug + ZeroCopySend + 'static,
{
    node: Rc<Node<Gated>>,
    subscriber: Subscriber<Gated, [T], H>,
    listener: Option<Listener<Gated>>,
}

impl<T, H> Feed<T, H>
where
    T: Debug + ZeroCopySend,
    H: Debug + ZeroCopySend,
{
    pub(crate) fn open(link: Rc<Link>, stream: Stream, wake: Wake) -> Result<Self, Error> {
        let mut feed = Self { link, stream, wake, port: None, tensor: None, epoch: 0, misses: 0 };
        feed.attach()?;
        Ok(feed)
    }

    pub(crate) fn tensor(&self) -> Option<&TensorInfo> {
        self.tensor.as_ref()
    }

    pub(crate) fn stream(&self) -> &Stream {
        &self.stream
    }

    /// The next packet, if there is one. Finds the daemon again where it has come back.
    pub(crate) fn try_recv(&mut self) -> Result<Option<Sample<Gated, [T], H>>, Error> {
        if let Some(sample) = self.take()? {
            return Ok(Some(sample));
        }
        // A look costs a system call now and then, and reading the clock as much as looking for a packet: a loop that
        // polls comes here millions of times a second.
        self.misses = self.misses.wrapping_add(1);
        if self.wake == Wake::Sleep || self.misses.is_multiple_of(POLLS) {
            self.link.look();
        }
        if self.link.is_up() && self.link.epoch() != self.epoch {
            self.attach_again()?;
            return self.take();
        }
        Ok(None)
    }

    /// The next packet, waiting for it.
    pub(crate) fn recv(&mut self, timeout: Duration) -> Result<Sample<Gated, [T], H>, Error> {
        let start = Instant::now();
        loop {
            if let Some(sample) = self.try_recv()? {
                return Ok(sample);
            }
            if self.wake == Wake::Poll && !self.misses.is_multiple_of(POLLS) {
                core::hint::spin_loop();
                continue;
            }
            let left = timeout.saturating_sub(start.elapsed());
            if left.is_zero() {
                return Err(match self.link.is_up() {
                    true => Error::Timeout { waited: timeout },
                    false => Error::NoDaemon { root: self.link.root().clone() },
                });
            }
            self.wait(left.min(NAP));
        }
    }

    fn take(&self) -> Result<Option<Sample<Gated, [T], H>>, Error> {
        let Some(port) = &self.port else { return Ok(None) };
        port.subscriber.receive().map_err(|error| match error {
            ReceiveError::ExceedsMaxBorrows => Error::HeldTooMany { max: Qos::of(&self.stream).held_max },
            error => Error::transport("receive", error),
        })
    }

    fn wait(&self, longest: Duration) {
        match self.port.as_ref().map(|port| &port.listener) {
            Some(Some(listener)) => {
                // Interrupted or failed: the caller looks for a packet and for the daemon either way.
                if listener.timed_wait(|_| {}, longest).is_err() {
                    std::thread::yield_now();
                }
            }
            Some(None) => core::hint::spin_loop(),
            None => std::thread::sleep(longest.min(Duration::from_millis(5))),
        }
    }

    /// Subscribes anew. That the daemon vanished meanwhile is no error: it is looked for again.
    fn attach_again(&mut self) -> Result<(), Error> {
        match self.attach() {
            Err(Error::NoDaemon { .. } | Error::Timeout { .. } | Error::Transport { .. }) => Ok(()),
            result => result,
        }
    }

    fn attach(&mut self) -> Result<(), Error> {
        let subscribed = self.link.subscribe(&self.stream)?;
        check_room(self.link.root())?;
        let node = self.link.node()?;
        let same_node = self.port.as_ref().is_some_and(|port| Rc::ptr_eq(&port.node, &node));
        if !same_node {
            self.port = None; // an old directory's port first lets go of its memory
            self.port = Some(self.settle(&node)?);
        }
        self.tensor = subscribed.tensor;
        if let Some(port) = &self.port {
            self.link.attached(&self.stream, port.subscriber.id().value())?;
        }
        self.epoch = self.link.epoch();
        Ok(())
    }

    /// Opens the port, waiting out a service that is being made or removed.
    fn settle(&self, node: &Rc<Node<Gated>>) -> Result<Port<T, H>, Error> {
        let start = Instant::now();
        loop {
            match self.open_port(node) {
                Err(Error::Transport { .. }) if start.elapsed() < SETTLE_WITHIN => {
                    std::thread::sleep(Duration::from_millis(5));
                }
                result => return result,
            }
        }
    }

    fn open_port(&self, node: &Rc<Node<Gated>>) -> Result<Port<T, H>, Error> {
        let (data, wake) = open_services::<T, H>(node, &self.stream, &self.link.camera())?;
        let listener = match self.wake {
            Wake::Poll => None,
            Wake::Sleep => Some(
                wake.listener_builder()
                    .create()
                    .map_err(|error| Error::transport(&format!("wake-up of {}", self.stream), error))?,
            ),
        };
        let subscriber = data
            .subscriber_builder()
            .create()
            .map_err(|error| Error::transport(&format!("subscription to {}", self.stream), error))?;
        Ok(Port { node: node.clone(), subscriber, listener })
    }
}

/// A port is a few small files, which iceoryx2 does not take room for before it writes to them.
fn check_room(root: &Root) -> Result<(), Error> {
    let (need, free) = (PORT_BYTES, free_bytes(root)?);
    if free < need { Err(Error::NoSpace { root: root.clone(), need, free }) } else { Ok(()) }
}
