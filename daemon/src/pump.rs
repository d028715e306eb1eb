//! The pipeline's thread: takes what arrived through the pipeline, and sends the packets that come out of it to the
//! clients and to the views.
//!
//! Between bytes and publish it takes no lock, does no I/O, and allocates nothing of its own (iceoryx2 allocates once for
//! each loan).

use crate::clock;
use crate::feed::Deliveries;
use crate::ledger::Counts;
use crate::pipeline::{Arrival, Outlet, Pipeline};
use crate::publish::EventOutlet;
use crate::shared::Shared;
use crate::views::ViewInlet;
use core::time::Duration;
use lobula_client::{Flags, PacketHeader};
use lobula_core::{Event, Fault};
use std::sync::Arc;
use std::thread::{self, Thread};

/// Time between two packets after the end, which tell clients that come late.
const AFTER_END: Duration = Duration::from_millis(10);
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
    /// When the packet before was sent, or could not be.
    sent_ns: u64,
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
        let ports =
            Ports { shared, events, views, latency: Latency::default(), stream_time_us: 0, sent_ns: 0 };
        Self { pipeline, ports, beat: Duration::from_micros(packet_us.into()) }
    }

    /// The thread: until the source has ended and all stops.
    pub fn run(mut self, mut deliveries: Deliveries, source: &Thread) {
        clock::wake_punctually();
        loop {
            let Some(delivery) = deliveries.pop() else {
                thread::park_timeout(self.beat);
                if deliveries.ring().is_empty() {
                    self.beat();
                }
                continue;
            };
            let stamped = delivery.header();
            let arrival = Arrival {
                bytes: delivery.elements(),
                due_ns: stamped.due_ns,
                arrived_ns: stamped.arrived_ns,
                lost: 0,
                restart: stamped.restart,
            };
            self.pipeline.feed(arrival, &mut self.ports);
            drop(delivery);
            source.unpark();
            if stamped.end {
                break;
            }
            // The source pauses: what waits for more to fill its packet goes now.
            if deliveries.ring().is_empty() {
                self.pipeline.flush(&mut self.ports);
            }
            self.report();
        }
        self.end();
    }

    /// An empty packet after a packet's time without one. A lossless replay has no need of it: its clients wait.
    fn beat(&mut self) {
        let beat_ns = self.beat.as_nanos() as u64;
        if !self.ports.shared.lossless && clock::now_ns() >= self.ports.sent_ns + beat_ns {
            self.pipeline.heartbeat(&mut self.ports);
            self.report();
        }
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

impl Outlet for Ports {
    fn packet(&mut self, header: PacketHeader, events: &[Event]) -> bool {
        let sent = self.events.send(header, events, clock::now_ns).unwrap_or_else(|error| {
            self.shared.degrade(format!("packets cannot be sent: {error}"));
            None
        });
        self.sent_ns = clock::now_ns();
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
