//! The housekeeping thread: control, the clients that have gone, the rates. Nothing in the path of events waits for it.

use crate::clock;
use crate::control::{AttachedPort, Connection, Control, refuse};
use crate::ledger::Counts;
use crate::publish::{events_stream, view_stream};
use crate::shared::Shared;
use core::sync::atomic::Ordering;
use iceoryx2::node::Node;
use lobula_client::Stream;
use lobula_client::control::{
    Hello, Reply, Request, SourceState, Status, Subscribed, TensorInfo, ViewStatus,
};
use lobula_client::transport::Gated;
use lobula_core::Fault;
use std::sync::Arc;
use std::thread::Thread;

/// Longest wait for a request before the clock is looked at.
const NAP_MS: i32 = 50;
/// Time between two cleanings, and over which rates are taken.
const ROUND_NS: u64 = 1_000_000_000;
/// Time between a client's going and the cleaning after it: its process needs a moment to be gone.
const GONE_NS: u64 = 100_000_000;

/// What does not change while the daemon runs.
#[derive(Debug)]
pub struct Facts {
    /// The source in words.
    pub source: String,
    /// The views, by name.
    pub views: Vec<(String, TensorInfo)>,
}

/// Answers clients and cleans up after them.
pub struct Housekeeping {
    control: Control,
    shared: Arc<Shared>,
    facts: Facts,
    node: Node<Gated>,
    source: Thread,
    start_ns: u64,
    clean_ns: u64,
    rates: Rates,
}

/// Counts of two moments, a round apart.
#[derive(Default)]
struct Rates {
    since_ns: u64,
    counts: Counts,
    bytes_per_s: f64,
    events_in_per_s: f64,
    events_out_per_s: f64,
    latency_ns_mean: u64,
}

impl Housekeeping {
    /// Over an open control socket. `source` is woken when a replay may start.
    pub fn new(
        control: Control,
        shared: Arc<Shared>,
        facts: Facts,
        node: Node<Gated>,
        source: Thread,
    ) -> Self {
        let start_ns = clock::now_ns();
        let rates = Rates { since_ns: start_ns, ..Rates::default() };
        Self { control, shared, facts, node, source, start_ns, clean_ns: start_ns + ROUND_NS, rates }
    }

    /// Serves until all stops.
    pub fn run(&mut self, stop: impl Fn() -> bool) {
        while !self.shared.is_stopping() {
            if stop() {
                self.shared.stop();
            }
            self.round();
        }
        // Answers that are still due, above all the one to `stop`.
        self.serve(0);
    }

    fn round(&mut self) {
        for gone in self.serve(NAP_MS) {
            for port in &gone.ports {
                self.shared.patience.forget(port.port);
            }
            self.clean_ns = self.clean_ns.min(clock::now_ns() + GONE_NS);
        }
        self.start_when_ready();
        let now = clock::now_ns();
        if now >= self.clean_ns {
            self.node.try_cleanup_dead_nodes();
            self.clean_ns = now + ROUND_NS;
        }
        if now >= self.rates.since_ns + ROUND_NS {
            self.rates.turn(now, self.shared.board.read());
        }
    }

    fn serve(&mut self, timeout_ms: i32) -> Vec<Connection> {
        let desk =
            Desk { shared: &self.shared, facts: &self.facts, rates: &self.rates, start_ns: self.start_ns };
        self.control.serve(timeout_ms, |connections, index, request| desk.answer(connections, index, request))
    }

    /// A lossless replay starts once as many clients are ready as each of them waits for.
    fn start_when_ready(&self) {
        if self.shared.is_playing() {
            return;
        }
        if let (ready, Some(needed)) = readiness(self.control.connections())
            && ready >= needed
        {
            self.shared.play();
            self.source.unpark();
        }
    }
}

/// How many clients are ready, and how many must be.
fn readiness(connections: &[Connection]) -> (u32, Option<u32>) {
    let ready = connections.iter().filter_map(|connection| connection.ready_for);
    (ready.clone().count() as u32, ready.max())
}

/// What answers are made from.
struct Desk<'a> {
    shared: &'a Shared,
    facts: &'a Facts,
    rates: &'a Rates,
    start_ns: u64,
}

impl Desk<'_> {
    fn answer(&self, connections: &mut [Connection], index: usize, request: Request) -> Reply {
        let Some(connection) = connections.get_mut(index) else {
            return refuse("refused", "the connection is closed".into());
        };
        match request {
            Request::Hello { name, pid } => {
                connection.name = name.chars().filter(|c| !c.is_control()).take(64).collect();
                connection.pid = pid;
                Reply::Hello(self.hello())
            }
            Request::Subscribe { stream } => self.subscribe(&stream),
            Request::Attached { stream, port } => self.attach(connection, stream, &port),
            Request::Play { clients } => self.play(connections, index, clients),
            Request::Status {} => Reply::Status(Box::new(self.status(connections))),
            Request::Stop {} => {
                self.shared.stop();
                Reply::Done {}
            }
        }
    }

    fn hello(&self) -> Hello {
        Hello {
            generation: self.shared.generation,
            pid: std::process::id(),
            camera: self.shared.camera.clone(),
            width: self.shared.geometry.width,
            height: self.shared.geometry.height,
            streams: self.streams().map(|(stream, _)| stream.to_string()).collect(),
        }
    }

    fn streams(&self) -> impl Iterator<Item = (Stream, Option<&TensorInfo>)> {
        let lossless = self.shared.lossless;
        let views = self.facts.views.iter();
        core::iter::once((events_stream(lossless), None))
            .chain(views.map(move |(name, info)| (view_stream(name, lossless), Some(info))))
    }

    fn subscribe(&self, asked: &str) -> Reply {
        let Some((stream, tensor)) = self.streams().find(|(stream, _)| stream.to_string() == asked) else {
            let streams: Vec<_> = self.streams().map(|(stream, _)| stream.to_string()).collect();
            return refuse("no_stream", format!("there is no stream `{asked}`, only {}", streams.join(", ")));
        };
        Reply::Subscribed(Subscribed {
            service: stream.service_name(&self.shared.camera),
            width: self.shared.geometry.width,
            height: self.shared.geometry.height,
            tensor: tensor.cloned(),
        })
    }

    fn attach(&self, connection: &mut Connection, stream: String, port: &str) -> Reply {
        let Ok(port) = u128::from_str_radix(port, 16) else {
            return refuse("invalid", format!("`{port}` is no port: give its id in hexadecimal digits"));
        };
        self.shared.patience.remember(port);
        let port = AttachedPort { stream, port };
        if !connection.ports.contains(&port) && connection.ports.len() < 64 {
            connection.ports.push(port);
        }
        Reply::Done {}
    }

    fn play(&self, connections: &mut [Connection], index: usize, clients: u32) -> Reply {
        if !self.shared.lossless {
            let message = "no lossless replay is configured: set lossless = true in camera.source";
            return refuse("refused", message.into());
        }
        if self.shared.is_playing() {
            return refuse("refused", "the replay has started: start lobulad again for another".into());
        }
        if clients == 0 {
            return refuse(
                "invalid",
                "a replay for no client would be lost: give clients of 1 or more".into(),
            );
        }
        if let Some(connection) = connections.get_mut(index) {
            connection.ready_for = Some(clients);
        }
        let (ready, needed) = readiness(connections);
        Reply::Waiting { ready, needed: needed.unwrap_or(clients) }
    }

    fn status(&self, connections: &[Connection]) -> Status {
        let counts = self.shared.board.read();
        let Rates { bytes_per_s, events_in_per_s, events_out_per_s, latency_ns_mean, .. } = *self.rates;
        let faults = Fault::ALL.iter().zip(counts.faults).map(|(fault, n)| (fault.name().to_owned(), n));
        Status {
            version: env!("CARGO_PKG_VERSION").into(),
            pid: std::process::id(),
            generation: self.shared.generation,
            uptime_s: (clock::now_ns() - self.start_ns) as f64 / 1e9,
            camera: self.shared.camera.clone(),
            width: self.shared.geometry.width,
            height: self.shared.geometry.height,
            source: self.facts.source.clone(),
            state: self.state(),
            degraded: self.shared.degraded(),
            bytes: counts.bytes,
            events: counts.events,
            faults: faults.collect(),
            triggers: counts.triggers,
            packets: counts.packets,
            behind: self.shared.behind.load(Ordering::Relaxed),
            views_missed: self.shared.views_missed.load(Ordering::Relaxed),
            stream_time_us: counts.stream_time_us,
            bytes_per_s,
            events_in_per_s,
            events_out_per_s,
            latency_ns_mean,
            latency_ns_max: counts.latency_ns_max,
            clients: connections.iter().map(Connection::status).collect(),
            views: self.view_status().collect(),
        }
    }

    fn state(&self) -> SourceState {
        if self.shared.is_playing() { self.shared.state() } else { SourceState::Waiting }
    }

    fn view_status(&self) -> impl Iterator<Item = ViewStatus> {
        self.facts.views.iter().zip(&self.shared.views).map(|((name, _), counts)| ViewStatus {
            name: name.clone(),
            published: counts.published.load(Ordering::Relaxed),
            skipped: counts.skipped.load(Ordering::Relaxed),
            late: counts.late.load(Ordering::Relaxed),
            overflowed: counts.overflowed.load(Ordering::Relaxed),
        })
    }
}

impl Rates {
    fn turn(&mut self, now_ns: u64, counts: Counts) {
        let seconds = (now_ns - self.since_ns) as f64 / 1e9;
        let before = &self.counts;
        let per_s = |now: u64, before: u64| now.saturating_sub(before) as f64 / seconds;
        self.bytes_per_s = per_s(counts.bytes.input, before.bytes.input);
        self.events_in_per_s = per_s(counts.events.decoded, before.events.decoded);
        self.events_out_per_s = per_s(counts.events.published, before.events.published);
        let packets = counts.latency_packets - before.latency_packets;
        self.latency_ns_mean =
            (counts.latency_ns_sum - before.latency_ns_sum).checked_div(packets).unwrap_or_default();
        (self.counts, self.since_ns) = (counts, now_ns);
    }
}
