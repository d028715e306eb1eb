//! The pipeline's thread: takes what arrived through the pipeline, and sends the packets that come out of it to the
//! clients and to the views.
//!
//! Between bytes and publish it takes no lock, does no I/O, and allocates nothing of its own (iceoryx2 allocates once for
//! each loan).

use crate::clock;
use crate::feed::{self, Deliveries, Delivery};
use crate::ledger::Counts;
use crate::pipeline::{Arrival, Outlet, Pipeline};
use crate::publish::EventOutlet;
use crate::shared::Shared;
use crate::views::ViewInlet;
use core::sync::atomic::Ordering;
use core::time::Duration;
use lobula_client::{Flags, PacketHeader};
use lobula_core::{Event, Fault};
use std::sync::Arc;
use std::thread::{self, Thread};

/// Time between two packets after the end, which tell clients that come late.
const AFTER_END: Duration = Duration::from_millis(10);
/// A transfer taken so long after it was due tells of a machine too slow.
const BEHIND_NS: u64 = 10_000_000;
const NS_PER_S: u64 = 1_000_000_000;

/// The pipeline with its ports.
pub struct Pump {
    pipeline: Pipeline,
    ports: Ports,
    /// Time without a packet after which an empty one goes out.
    beat: Duration,
}

/// Where packets go.
struct Ports {
    shared: Arc<Shared>,
    events: EventOutlet,
    views: Option<ViewInlet>,
    latency: Latency,
    stream_time_us: u64,
    /// When the packet before was sent, or could not be, and whether it was empty.
    sent_ns: u64,
    sent_empty: bool,
}

/// Published - arrived.
#[derive(Default)]
struct Latency {
    sum_ns: u64,
    packets: u64,
    /// Longest in the second that began at `since_ns`, and in the one before.
    max_ns: u64,
    since_ns: u64,
    max_before_ns: u64,
}

impl Pump {
    /// Sends what comes out of `pipeline` to the clients of `events` and to the views.
    pub fn new(
        shared: Arc<Shared>,
        pipeline: Pipeline,
        packet_us: u32,
        events: EventOutlet,
        views: Option<ViewInlet>,
    ) -> Self {
        let ports = Ports {
            shared,
            events,
            views,
            latency: Latency::default(),
            stream_time_us: 0,
            sent_ns: 0,
            sent_empty: false,
        };
        Self { pipeline, ports, beat: Duration::from_micros(packet_us.into()) }
    }

    /// The thread: until the source has ended and all stops.
    pub fn run(mut self, mut deliveries: Deliveries, source: &Thread) {
        clock::wake_punctually();
        loop {
            self.wait(&mut deliveries);
            let Some(delivery) = deliveries.pop() else { continue };
            let stamped = delivery.header();
            if stamped.end {
                break;
            }
            self.feed(&stamped, delivery.elements());
            drop(delivery);
            // The source pauses: what waits for more to fill its packet goes now.
            if !is_due(&mut deliveries) {
                self.pipeline.flush(&mut self.ports);
            }
            self.report();
            feed::freed(&deliveries, source);
        }
        self.end();
    }

    /// Waits for the next delivery, and while there is none lets clients see that stream time goes on.
    fn wait(&mut self, deliveries: &mut Deliveries) {
        while !is_due(deliveries) {
            let now = clock::now_ns();
            let beat_ns = self.next_beat_ns();
            let wake_ns = deliveries.peek().map_or(beat_ns, |(next, _)| next.due_ns.min(beat_ns));
            if wake_ns > now {
                thread::park_timeout(Duration::from_nanos(wake_ns - now));
            } else {
                self.beat();
            }
            if self.ports.shared.is_stopping() && !deliveries.ring().is_empty() {
                return;
            }
        }
    }

    fn feed(&mut self, stamped: &Delivery, bytes: &[u8]) {
        let now = clock::now_ns();
        if stamped.due_ns > now {
            return; // all stops, and these bytes have not come yet
        }
        if stamped.due_ns > 0 && now - stamped.due_ns > BEHIND_NS {
            self.ports.shared.behind.fetch_add(1, Ordering::Relaxed);
        }
        let arrived_ns = if stamped.due_ns > 0 { now } else { stamped.came_ns };
        let due_ns = stamped.due_ns;
        let arrival = Arrival { bytes, due_ns, arrived_ns, lost: 0, restart: stamped.restart };
        self.pipeline.feed(arrival, &mut self.ports);
    }

    /// When an empty packet is due: two packets' time after one with events, so that a paced source's jitter makes
    /// none, then each packet's time. A lossless replay has no need of it, as its clients wait.
    fn next_beat_ns(&self) -> u64 {
        let beats = if self.ports.sent_empty { 1 } else { 2 };
        let beat_ns = self.beat.as_nanos() as u64 * beats;
        if self.ports.shared.lossless { clock::now_ns() + beat_ns } else { self.ports.sent_ns + beat_ns }
    }

    fn beat(&mut self) {
        self.pipeline.heartbeat(&mut self.ports);
        self.report();
    }

    /// The source has ended. Clients that come later are told so; a lossless replay has told each of its clients.
    fn end(&mut self) {
        self.pipeline.finish(&mut self.ports);
        self.report();
        self.ports.views = None;
        while !self.ports.shared.is_stopping() {
            thread::park_timeout(AFTER_END);
            if !self.ports.shared.lossless && !self.ports.shared.is_stopping() {
                self.pipeline.finish(&mut self.ports);
                self.report();
            }
        }
    }

    fn report(&self) {
        let (counters, ports) = (self.pipeline.counters(), &self.ports);
        ports.shared.board.write(&Counts {
            bytes: self.pipeline.bytes(),
            events: self.pipeline.events(),
            faults: Fault::ALL.map(|fault| counters.faults.get(fault)),
            triggers: counters.triggers,
            packets: self.pipeline.packets(),
            stream_time_us: ports.stream_time_us,
            latency_ns_sum: ports.latency.sum_ns,
            latency_packets: ports.latency.packets,
            latency_ns_max: ports.latency.max_ns.max(ports.latency.max_before_ns),
        });
    }
}

/// Whether the next delivery is to be taken now.
fn is_due(deliveries: &mut Deliveries) -> bool {
    deliveries.peek().is_some_and(|(next, _)| next.due_ns <= clock::now_ns())
}

impl Outlet for Ports {
    fn packet(&mut self, header: PacketHeader, events: &[Event]) -> bool {
        let sent = self.events.send(header, events, clock::now_ns).unwrap_or_else(|error| {
            self.shared.degrade(format!("packets cannot be sent: {error}"));
            None
        });
        (self.sent_ns, self.sent_empty) = (clock::now_ns(), events.is_empty());
        self.stream_time_us = header.t_last;
        let Some(header) = sent else { return false };
        if !events.is_empty() {
            self.latency.add(header.stamps.arrived_ns, header.stamps.published_ns);
        }
        if let Some(views) = &mut self.views {
            views.push(&header, events, &self.shared);
        }
        true
    }
}

impl Latency {
    fn add(&mut self, arrived_ns: u64, published_ns: u64) {
        let ns = published_ns.saturating_sub(arrived_ns);
        self.sum_ns += ns;
        self.packets += 1;
        if published_ns.saturating_sub(self.since_ns) >= NS_PER_S {
            (self.max_before_ns, self.max_ns, self.since_ns) = (self.max_ns, 0, published_ns);
        }
        self.max_ns = self.max_ns.max(ns);
    }
}

/// Whether packets are of a recording, or filtered: the flags of every packet of a run.
pub fn flags(replay: bool, filtered: bool) -> Flags {
    let mut flags = Flags::default();
    if replay {
        flags |= Flags::REPLAY;
    }
    if filtered {
        flags |= Flags::FILTERED;
    }
    flags
}
