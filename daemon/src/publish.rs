//! The publishing ends of a camera: what a packet's header says, and how it goes out.

use crate::shared::Shared;
use iceoryx2::node::Node;
use lobula_client::transport::{self, Gated, Outlet};
use lobula_client::{Error, Line, PACKET_EVENTS_MAX, PacketHeader, Qos, Root, ShmEvent, Stamps, Stream};
use lobula_core::Event;

/// The stream of a camera's events: that of a lossless replay has a name of its own.
pub fn events_stream(lossless: bool) -> Stream {
    if lossless { Stream::events().lossless() } else { Stream::events() }
}

/// The stream of a view.
pub fn view_stream(name: &str, lossless: bool) -> Stream {
    if lossless { Stream::view(name).lossless() } else { Stream::view(name) }
}

/// Publishes packets of events. Belongs to the pipeline's thread.
#[derive(Debug)]
pub struct EventOutlet {
    outlet: Outlet<ShmEvent, PacketHeader>,
    _node: Node<Gated>,
}

impl EventOutlet {
    /// Opens the camera's stream of events.
    pub fn create(root: &Root, shared: &Shared) -> Result<Self, Error> {
        let node = transport::node(root, "lobulad-events")?;
        let stream = events_stream(shared.lossless);
        let patience = shared.lossless.then(|| shared.patience.clone());
        let outlet = Outlet::create(&node, root, &stream, &shared.camera, PACKET_EVENTS_MAX, patience)?;
        Ok(Self { outlet, _node: node })
    }

    /// Sends a packet and returns its header as it went, with the time. None: there was no memory, and it was not sent.
    pub fn send(
        &self,
        header: PacketHeader,
        events: &[Event],
        now_ns: impl Fn() -> u64,
    ) -> Result<Option<PacketHeader>, Error> {
        let Some(mut loan) = self.outlet.loan(events.len())? else { return Ok(None) };
        bytemuck::cast_slice_mut(loan.payload_mut()).copy_from_slice(events);
        let stamps = Stamps { published_ns: now_ns(), ..header.stamps };
        let header = PacketHeader { stamps, ..header };
        *loan.user_header_mut() = header;
        self.outlet.send(loan)?;
        Ok(Some(header))
    }
}

/// Bytes of shared memory that the events need.
pub fn events_bytes(lossless: bool) -> u64 {
    Qos::of(&events_stream(lossless)).bytes(PACKET_EVENTS_MAX * size_of::<ShmEvent>())
}

/// Bytes of shared memory that a view with tensors of `len_bytes` needs.
pub fn view_bytes(name: &str, lossless: bool, len_bytes: usize) -> u64 {
    Qos::of(&view_stream(name, lossless)).bytes(len_bytes.next_multiple_of(size_of::<Line>()))
}
