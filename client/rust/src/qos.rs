//! The quality of service of each stream: a function of its name, which never changes under it.
//!
//! A client that outlives the daemon pins the service it has open, and the next daemon must find the same settings.

use crate::{PacketHeader, Stream};

/// Most events of one packet.
pub const PACKET_EVENTS_MAX: usize = 8192;

/// Queues and counts of a stream's service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// Packets a client may lag behind.
    pub depth: usize,
    /// Packets a client may hold at once.
    pub held_max: usize,
    /// Clients at once.
    pub clients_max: usize,
    /// Packets the daemon may have on loan at once.
    pub loans_max: usize,
    /// Packets a new client is given from before it came.
    pub history: usize,
    /// Whether the oldest packet gives way when a client lags too far; else the daemon waits for it.
    pub overflow: bool,
}

impl Qos {
    /// The settings of a stream.
    pub fn of(stream: &Stream) -> Self {
        let base = match (stream.view_name(), stream.is_lossless()) {
            (None, false) => Self { depth: 128, history: 0, ..Self::BASE },
            (None, true) => Self { depth: 32, history: 0, ..Self::BASE },
            (Some(_), false) => Self { depth: 2, history: 1, held_max: 2, ..Self::BASE },
            (Some(_), true) => Self { depth: 2, history: 0, held_max: 2, ..Self::BASE },
        };
        Self { overflow: !stream.is_lossless(), ..base }
    }

    const BASE: Self =
        Self { depth: 2, held_max: 4, clients_max: 8, loans_max: 2, history: 0, overflow: true };

    /// Packets that can be in use at once, and thus how many a publisher prepares memory for.
    ///
    /// Queues of different clients hold the same newest packets, whether or not the clients run, so that `depth` counts
    /// once and not once for each client (iceoryx2 by itself would reserve five times as much).
    pub const fn packets(&self) -> usize {
        self.depth + self.history + self.clients_max * self.held_max + self.loans_max + 2
    }

    /// Bytes of shared memory a publisher needs for packets of `payload` bytes, headers and bookkeeping included.
    pub const fn bytes(&self, payload: usize) -> u64 {
        const PER_PACKET: usize = size_of::<PacketHeader>() + 256;
        const BOOKKEEPING: usize = 1 << 20;
        (self.packets() * (payload + PER_PACKET) + BOOKKEEPING) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_fixed_by_the_name() {
        let events = Qos::of(&Stream::events());
        assert_eq!((events.depth, events.history, events.overflow), (128, 0, true));
        let view = Qos::of(&Stream::view("voxel"));
        assert_eq!((view.depth, view.history, view.overflow), (2, 1, true));
        assert!(!Qos::of(&Stream::events().lossless()).overflow);
        // The events of a first run fit into the 64 MiB that Docker gives.
        assert!(events.bytes(PACKET_EVENTS_MAX * 8) < 16 << 20);
    }
}
