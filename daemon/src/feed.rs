//! The hop from the source to the pipeline: a ring of bytes with their stamps.
//!
//! A source with a schedule (a paced recording, a simulation) is read ahead, and the pipeline's thread itself waits
//! until bytes are due: a thread that only woke another would add its wake-up to every latency.

use crate::clock;
use crate::shared::Shared;
use crate::source::{Restart, Source, Transfer};
use core::time::Duration;
use lobula_client::control::SourceState;
use lobula_core::ring;
use std::sync::Arc;
use std::thread::{self, Thread};

/// What goes with the bytes of a transfer.
#[derive(Clone, Copy, Debug, Default)]
pub struct Delivery {
    /// When they are due, in ns of CLOCK_MONOTONIC; 0: no schedule.
    pub due_ns: u64,
    /// When they came, where there is no schedule.
    pub came_ns: u64,
    /// They do not go on where the ones before ended.
    pub restart: Option<Restart>,
    /// Nothing follows.
    pub end: bool,
}

/// Bytes of a slot: a paced 30 Mev/s give some 75 KB in 1 ms, a USB transfer is 16 to 128 KiB.
const SLOT_BYTES: usize = 128 << 10;
/// Number of slots: 32 ms of a paced source.
const SLOTS: usize = 32;
/// Longest wait of a source for room, or for its start, before it looks again.
const NAP: Duration = Duration::from_millis(5);

/// The end that the source's thread fills.
pub type Inlet = ring::Producer<ring::Shared<Delivery, u8>>;
/// The end that the pipeline's thread empties.
pub type Deliveries = ring::Consumer<ring::Shared<Delivery, u8>>;

/// Both ends.
pub fn ring() -> (Inlet, Deliveries) {
    ring::Shared::new(SLOTS, SLOT_BYTES)
}

/// The source's thread: hands on what comes, until the source ends or all stops.
pub fn run(mut source: Box<dyn Source>, mut inlet: Inlet, pipeline: &Thread, shared: &Arc<Shared>) {
    let mut state = SourceState::Ended;
    wait_for_play(shared);
    shared.set_state(SourceState::Playing);
    let start_ns = clock::now_ns();
    while wait_for_room(&inlet, shared) {
        let Some(mut grant) = inlet.claim() else { continue };
        let transfer = source.read(grant.elements_mut()).unwrap_or_else(|error| {
            shared.degrade(format!("the source failed: {error}"));
            state = SourceState::NoDevice;
            Transfer { end: true, ..Transfer::default() }
        });
        if transfer.end {
            break;
        }
        let due_ns = transfer.due_ns.map_or(0, |due| start_ns.saturating_add(due));
        let delivery = Delivery { due_ns, came_ns: clock::now_ns(), restart: transfer.restart, end: false };
        grant.commit(delivery, transfer.bytes);
        wake(&inlet, pipeline);
    }
    shared.set_state(state);
    while inlet.ring().len() >= inlet.ring().count() {
        thread::park_timeout(NAP);
    }
    if let Some(grant) = inlet.claim() {
        grant.commit(Delivery { came_ns: clock::now_ns(), end: true, ..Delivery::default() }, 0);
    }
    wake(&inlet, pipeline);
}

/// Tells the source that there is room again: once the ring is half empty, so that it is woken for many at a time.
pub fn freed(deliveries: &Deliveries, source: &Thread) {
    if deliveries.ring().len() <= SLOTS / 2 {
        source.unpark();
    }
}

/// The pipeline sleeps without an end in sight only where the ring is empty.
fn wake(inlet: &Inlet, pipeline: &Thread) {
    if inlet.ring().len() <= 1 {
        pipeline.unpark();
    }
}

fn wait_for_play(shared: &Shared) {
    while !shared.is_playing() && !shared.is_stopping() {
        thread::park_timeout(NAP);
    }
}

/// Waits for a free slot: files and simulations lose nothing. False: all stops.
fn wait_for_room(inlet: &Inlet, shared: &Shared) -> bool {
    while inlet.ring().len() >= inlet.ring().count() && !shared.is_stopping() {
        thread::park_timeout(NAP);
    }
    !shared.is_stopping()
}
