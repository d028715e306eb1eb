//! A running daemon: its threads, from the start to the end.

use crate::config::Config;
use crate::control::Control;
use crate::feed::{self, Deliveries};
use crate::gate::Gate;
use crate::housekeeping::{Facts, Housekeeping};
use crate::pipeline::{Identity, Pipeline};
use crate::publish::EventOutlet;
use crate::pump::{self, Pump};
use crate::shared::Shared;
use crate::source::{self, Source, SourceSpec};
use crate::views::{self, ViewArrivals, ViewInlet, Views};
use core::fmt;
use lobula_client::{Error, Root, transport};
use lobula_core::Transform;
use lobula_core::chain::{Chain, View};
use lobula_core::wire::Encoding;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{self, JoinHandle, Thread};
use std::time::{SystemTime, UNIX_EPOCH};

/// Why a daemon does not start. One sentence, with what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StartError {
    /// The configuration cannot be served, here or anywhere.
    Config(String),
    /// The machine does not allow it now.
    System(Error),
}

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(message) => f.write_str(message),
            Self::System(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for StartError {}

impl From<Error> for StartError {
    fn from(error: Error) -> Self {
        match error {
            Error::Invalid { message } => Self::Config(message),
            error => Self::System(error),
        }
    }
}

/// Checks a configuration against all it names: the source is opened, nothing is served.
///
/// # Errors
/// As [`Daemon::start`], but for what depends on the moment.
pub fn check(config: &Config) -> Result<(), StartError> {
    let source =
        source::open(&config.camera.source).map_err(|error| StartError::Config(error.to_string()))?;
    Plan::make(config, source.as_ref()).map(|_| ())
}

/// A running daemon, in threads of this process.
///
/// ```no_run
/// let config = lobulad::config::parse("")?; // a synthetic camera
/// let daemon = lobulad::Daemon::start(&config)?;
/// println!("serves {}", daemon.root());
/// daemon.join(); // until a client asks it to stop
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Daemon {
    root: Root,
    shared: Arc<Shared>,
    housekeeping: JoinHandle<()>,
}

impl Daemon {
    /// Starts to serve. When it returns, clients may connect.
    ///
    /// # Errors
    /// [`StartError::Config`]: the source cannot be opened, or the settings do not fit it. [`StartError::System`]: the
    /// instance is in use, or is somebody else's, or has no room.
    pub fn start(config: &Config) -> Result<Self, StartError> {
        Self::start_until(config, || false)
    }

    /// As [`Self::start`]; ends when `stop` says so, which is asked some 20 times a second.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn start_until(
        config: &Config,
        stop: impl Fn() -> bool + Send + 'static,
    ) -> Result<Self, StartError> {
        let source =
            source::open(&config.camera.source).map_err(|error| StartError::Config(error.to_string()))?;
        let plan = Plan::make(config, source.as_ref())?;
        let gate = Gate::enter(&plan.root)?;
        let (root, shared) = (plan.root.clone(), plan.shared.clone());
        let (tell, started) = channel();
        let housekeeping = thread::Builder::new()
            .name("housekeeping".into())
            .spawn(move || serve(plan, source, gate, stop, &tell))
            .map_err(no_thread)?;
        match started.recv() {
            Ok(Ok(())) => Ok(Self { root, shared, housekeeping }),
            Ok(Err(error)) => {
                let _ = housekeeping.join();
                Err(error)
            }
            Err(_) => Err(died("housekeeping")),
        }
    }

    /// The instance it serves.
    pub fn root(&self) -> &Root {
        &self.root
    }

    /// Its run: what [`PacketHeader::generation`](lobula_client::PacketHeader::generation) says.
    pub fn generation(&self) -> u64 {
        self.shared.generation
    }

    /// Asks it to end: the end goes out to the clients, then its files are removed.
    pub fn stop(&self) {
        self.shared.stop();
    }

    /// Waits until it has ended.
    pub fn join(self) {
        let _ = self.housekeeping.join();
    }
}

/// What is settled before anything is made.
struct Plan {
    root: Root,
    shared: Arc<Shared>,
    config: Config,
    chain: Chain,
    facts: Facts,
    /// Bytes of shared memory it needs.
    need: u64,
}

impl Plan {
    fn make(config: &Config, source: &dyn Source) -> Result<Self, StartError> {
        let root = config.instance.root.as_ref().map_or_else(Root::from_env, Root::new)?;
        let geometry = source.geometry();
        let lossless = config.camera.source.is_lossless();
        let chain = Chain::try_new(&config.filters, geometry)
            .map_err(|error| StartError::Config(error.to_string()))?;
        // Packets and views are of the sensor after the chain, and so is all that clients are told.
        let geometry = chain.output_geometry();
        let mut need = crate::publish::events_bytes(lossless);
        let mut infos = Vec::new();
        for spec in &config.views {
            let view = View::try_new(spec, geometry)
                .map_err(|error| StartError::Config(format!("view {:?}: {error}", spec.name)))?;
            need += crate::publish::view_bytes(&spec.name, lossless, view.len_bytes());
            infos.push((spec.name.clone(), views::tensor_info(&view, spec)));
        }
        let facts = Facts { source: source.describe(), views: infos };
        let shared =
            Shared::new(generation(), config.camera.name.clone(), geometry, lossless, config.views.len());
        Ok(Self { root, shared: Arc::new(shared), config: config.clone(), chain, facts, need })
    }

    fn check_room(&self) -> Result<(), Error> {
        let free = transport::free_bytes(&self.root)?;
        if self.need > free {
            return Err(Error::NoSpace { root: self.root.clone(), need: self.need, free });
        }
        Ok(())
    }
}

/// The housekeeping thread: starts the others, serves, waits for them, and clears the instance away.
fn serve(
    plan: Plan,
    source: Box<dyn Source>,
    gate: Gate,
    stop: impl Fn() -> bool,
    tell: &Sender<Result<(), StartError>>,
) {
    let shared = plan.shared.clone();
    match set_up(plan, source, &gate) {
        Ok((mut housekeeping, threads)) => {
            let _ = tell.send(Ok(()));
            housekeeping.run(stop);
            for thread in threads {
                thread.thread().unpark();
                let _ = thread.join();
            }
        }
        Err(error) => {
            shared.stop();
            gate.leave();
            let _ = tell.send(Err(error));
            return;
        }
    }
    gate.leave();
}

fn set_up(
    plan: Plan,
    source: Box<dyn Source>,
    gate: &Gate,
) -> Result<(Housekeeping, Vec<JoinHandle<()>>), StartError> {
    let root = gate.root().clone();
    // The first node cleans away what a killed daemon left, before room is measured.
    let node = transport::node(&root, "lobulad")?;
    plan.check_room()?;
    let mut threads = Vec::new();
    let started = start_threads(&plan, source, &root, &mut threads);
    let source_thread = match started {
        Ok(thread) => thread,
        Err(error) => {
            plan.shared.stop();
            for thread in threads {
                let _ = thread.join();
            }
            return Err(error);
        }
    };
    let control = Control::listen(&root).map_err(|error| Error::Transport {
        message: format!("{}: {error}", root.control_socket().display()),
    })?;
    Ok((Housekeeping::new(control, plan.shared, plan.facts, node, source_thread), threads))
}

/// Starts views, pipeline and source, in this order, each ready before the next.
fn start_threads(
    plan: &Plan,
    source: Box<dyn Source>,
    root: &Root,
    threads: &mut Vec<JoinHandle<()>>,
) -> Result<Thread, StartError> {
    let (inlet, deliveries) = feed::ring();
    let (pipeline_tell, pipeline_thread) = channel();
    let views = match plan.config.views.is_empty() {
        true => None,
        false => Some(start_views(plan, root, pipeline_thread, threads)?),
    };
    let (source_tell, source_thread) = channel();
    let encoding = source.encoding();
    let pipeline = start_pipeline(plan, root, encoding, views, deliveries, source_thread, threads)?;
    let _ = pipeline_tell.send(pipeline.clone());
    let shared = plan.shared.clone();
    let handle = spawn("source", move || feed::run(source, inlet, &pipeline, &shared))?;
    let thread = handle.thread().clone();
    let _ = source_tell.send(thread.clone());
    threads.push(handle);
    Ok(thread)
}

fn start_views(
    plan: &Plan,
    root: &Root,
    pipeline: Receiver<Thread>,
    threads: &mut Vec<JoinHandle<()>>,
) -> Result<ViewInlet, StartError> {
    let (producer, arrivals): (_, ViewArrivals) = views::ring();
    let (root, shared, specs) = (root.clone(), plan.shared.clone(), plan.config.views.clone());
    let (tell, ready) = channel();
    let handle = spawn("views", move || {
        let Some(views) = report(Views::create(&root, &shared, &specs), &tell) else { return };
        if let Ok(pipeline) = pipeline.recv() {
            views.run(arrivals, &pipeline);
        }
    })?;
    let thread = handle.thread().clone();
    threads.push(handle);
    ready.recv().unwrap_or_else(|_| Err(died("views")))?;
    Ok(ViewInlet::new(producer, thread))
}

fn start_pipeline(
    plan: &Plan,
    root: &Root,
    encoding: Encoding,
    views: Option<ViewInlet>,
    deliveries: Deliveries,
    source: Receiver<Thread>,
    threads: &mut Vec<JoinHandle<()>>,
) -> Result<Thread, StartError> {
    let (root, shared, chain) = (root.clone(), plan.shared.clone(), plan.chain.clone());
    let packet_us = plan.config.camera.packet_us;
    let replay = matches!(plan.config.camera.source, SourceSpec::File(_));
    let (tell, ready) = channel();
    let handle = spawn("pipeline", move || {
        let Some(outlet) = report(EventOutlet::create(&root, &shared), &tell) else { return };
        let flags = pump::flags(replay, chain.counts().len() > 0);
        let identity = Identity { camera: 0, generation: shared.generation, flags, packet_us };
        let pipeline = Pipeline::new(encoding, chain, identity);
        let pump = Pump::new(shared, pipeline, packet_us, outlet, views);
        if let Ok(source) = source.recv() {
            pump.run(deliveries, &source);
        }
    })?;
    let thread = handle.thread().clone();
    threads.push(handle);
    ready.recv().unwrap_or_else(|_| Err(died("pipeline")))?;
    Ok(thread)
}

/// Tells who started the thread how it went, and keeps what was made.
fn report<T>(made: Result<T, Error>, tell: &Sender<Result<(), StartError>>) -> Option<T> {
    match made {
        Ok(made) => {
            let _ = tell.send(Ok(()));
            Some(made)
        }
        Err(error) => {
            let _ = tell.send(Err(error.into()));
            None
        }
    }
}

fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, StartError> {
    let whole = || {
        let _whole = WholeOrNothing;
        body();
    };
    thread::Builder::new().name(name.into()).spawn(whole).map_err(no_thread)
}

/// A daemon with a dead thread would look alive to its clients and never end; one that is gone is started again, and
/// its clients go on.
struct WholeOrNothing;

impl Drop for WholeOrNothing {
    fn drop(&mut self) {
        if thread::panicking() {
            std::process::abort();
        }
    }
}

fn no_thread(error: std::io::Error) -> StartError {
    StartError::System(Error::Transport { message: format!("a thread cannot be started: {error}") })
}

fn died(name: &str) -> StartError {
    StartError::System(Error::Transport { message: format!("the thread `{name}` ended at its start") })
}

/// Number of this run: ms since 1970, so that it grows from run to run.
fn generation() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |since| since.as_millis() as u64)
}
