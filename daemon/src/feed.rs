//! The hop from the source to the pipeline: a ring of bytes with their stamps, and the waking of who waits at its ends.

use crate::clock;
use crate::shared::Shared;
use crate::source::{Restart, Source, Transfer};
use core::sync::atomic::Ordering;
use core::time::Duration;
use lobula_client::control::SourceState;
use lobula_core::ring;
use std::sync::Arc;
use std::thread::{self, Thread};

/// What goes with the bytes of a transfer.
#[derive(Clone, Copy, Debug, Default)]
pub struct Delivery {
    /// When they were due, in ns of CLOCK_MONOTONIC; 0: no schedule.
    pub due_ns: u64,
    /// When they came.
    pub arrived_ns: u64,
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
const NAP: Duration = Duration::from_millis(1);

/// The end that the source's thread fills.
pub type Inlet = ring::Producer<ring::Shared<Delivery, u8>>;
/// The end that the pipeline's thread empties.
pub type Deliveries = ring::Consumer<ring::Shared<Delivery, u8>>;

/// Both ends.
pub fn ring() -> (Inlet, Deliveries) {
    ring::Shared::new(SLOTS, SLOT_BYTES)
}

/// The source's thread: stamps what comes and hands it on, until the source ends or all stops.
pub fn run(mut source: Box<dyn Source>, mut inlet: Inlet, pipeline: &Thread, shared: &Arc<Shared>) {
    clock::wake_punctually();
    wait_for_play(shared);
    if !shared.is_stopping() {
        shared.set_state(SourceState::Playing);
    }
    let start_ns = clock::now_ns();
    while !shared.is_stopping() {
        let Some(mut grant) = wait_for_room(&mut inlet, shared) else { break };
        let transfer = source.read(grant.elements_mut()).unwrap_or_else(|error| {
            shared.degrade(format!("the source failed: {error}"));
            Transfer { end: true, ..Transfer::default() }
        });
        let due_ns = transfer.due_ns.map_or(0, |due| start_ns.saturating_add(due));
        if due_ns > 0 && !sleep_until(due_ns, shared) {
            break;
        }
        let delivery =
            Delivery { due_ns, arrived_ns: clock::now_ns(), restart: transfer.restart, end: false };
        if !transfer.end || transfer.bytes > 0 {
            grant.commit(delivery, transfer.bytes);
            pipeline.unpark();
        }
        if transfer.end {
            break;
        }
    }
    shared.set_state(SourceState::Ended);
    while inlet.ring().len() >= inlet.ring().count() {
        thread::park_timeout(NAP);
    }
    if let Some(grant) = inlet.claim() {
        grant.commit(Delivery { arrived_ns: clock::now_ns(), end: true, ..Delivery::default() }, 0);
    }
    pipeline.unpark();
}

fn wait_for_play(shared: &Shared) {
    while !shared.is_playing() && !shared.is_stopping() {
        thread::park_timeout(NAP);
    }
}

/// The next slot. What is held back here is late and not lost: files and simulations wait.
fn wait_for_room<'a>(
    inlet: &'a mut Inlet,
    shared: &Shared,
) -> Option<ring::Grant<'a, 'static, Delivery, u8>> {
    if inlet.ring().len() >= inlet.ring().count() {
        shared.ring_full.fetch_add(1, Ordering::Relaxed);
    }
    while inlet.ring().len() >= inlet.ring().count() {
        if shared.is_stopping() {
            return None;
        }
        thread::park_timeout(NAP / 4);
    }
    inlet.claim()
}

/// Sleeps until a transfer is due, in naps so that a stop is seen. False: all stops.
fn sleep_until(due_ns: u64, shared: &Shared) -> bool {
    const NAP_NS: u64 = 100_000_000;
    loop {
        let now = clock::now_ns();
        if now >= due_ns {
            return true;
        }
        if shared.is_stopping() {
            return false;
        }
        clock::sleep_until_ns(due_ns.min(now + NAP_NS));
    }
}
