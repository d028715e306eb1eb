//! The floor of latency: packets of events through iceoryx2 alone, sent as the daemon sends them, with nothing of ours
//! but the header. What the daemon takes is told beside it.

use crate::now_ns;
use iceoryx2::node::Node;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber;
use lobula_client::transport::{self, Gated, Outlet};
use lobula_client::{Error, Flags, PacketHeader, Root, ShmEvent, Stamps, Stream};
use std::time::Duration;

const CAMERA: &str = "floor";
const NODE: &str = "lobula-floor";

/// The end that sends.
pub struct Sender {
    outlet: Outlet<ShmEvent, PacketHeader>,
    _node: Node<Gated>,
}

impl Sender {
    /// Packets of at most `events_max` events, in the instance's directory, which must exist.
    ///
    /// # Errors
    /// Those of shared memory.
    pub fn new(root: &Root, events_max: usize) -> Result<Self, Error> {
        let node = transport::node(root, NODE)?;
        let outlet = Outlet::create(&node, root, &Stream::events(), CAMERA, events_max, None)?;
        Ok(Self { outlet, _node: node })
    }

    /// Sends a packet that is due at `due_ns`; false when there was no memory for it.
    ///
    /// # Errors
    /// Those of shared memory.
    pub fn send(&self, events: &[ShmEvent], due_ns: u64, flags: Flags) -> Result<bool, Error> {
        let Some(mut loan) = self.outlet.loan(events.len())? else { return Ok(false) };
        loan.payload_mut().copy_from_slice(events);
        let now = now_ns();
        let header = loan.user_header_mut();
        *header = PacketHeader::default();
        header.stamps = Stamps { due_ns, arrived_ns: now, decoded_ns: now, published_ns: now };
        header.flags = flags.0;
        self.outlet.send(loan)?;
        Ok(true)
    }

    /// How many receivers there are.
    pub fn receivers(&self) -> usize {
        self.outlet.clients()
    }
}

/// The end that receives.
pub struct Receiver {
    subscriber: Subscriber<Gated, [ShmEvent], PacketHeader>,
    /// None for one that polls.
    listener: Option<Listener<Gated>>,
    _node: Node<Gated>,
}

impl Receiver {
    /// A receiver that sleeps until it is woken, or polls.
    ///
    /// # Errors
    /// Those of shared memory, in words.
    pub fn new(root: &Root, sleeps: bool) -> Result<Self, String> {
        let node = transport::node(root, NODE).map_err(text)?;
        let (data, wake) =
            transport::create_services::<ShmEvent, PacketHeader>(&node, &Stream::events(), CAMERA)
                .map_err(text)?;
        let subscriber = data.subscriber_builder().create().map_err(text)?;
        let listener = match sleeps {
            true => Some(wake.listener_builder().create().map_err(text)?),
            false => None,
        };
        Ok(Self { subscriber, listener, _node: node })
    }

    /// The next packet that is there: when it was seen, and its header.
    ///
    /// # Errors
    /// Those of shared memory, in words.
    pub fn take(&self) -> Result<Option<(u64, PacketHeader)>, String> {
        Ok(self.subscriber.receive().map_err(text)?.map(|sample| (now_ns(), *sample.user_header())))
    }

    /// Waits for a packet, at most this long; one that polls only gives the core a rest.
    ///
    /// # Errors
    /// Those of shared memory, in words.
    pub fn wait(&self, at_most: Duration) -> Result<(), String> {
        match &self.listener {
            Some(listener) => {
                listener.timed_wait(|_| {}, at_most).map(|_| ()).map_err(|error| format!("{error:?}"))
            }
            None => {
                std::hint::spin_loop();
                Ok(())
            }
        }
    }
}

fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}
