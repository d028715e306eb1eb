//! A client of the daemon.

use crate::connection::{Connection, unexpected};
use crate::control::{Hello, Reply, Request, SourceState, Status, Subscribed};
use crate::transport::{self, Gated};
use crate::{Error, EventSubscriber, Root, Stream, ViewSubscriber};
use core::cell::{Cell, RefCell};
use core::time::Duration;
use iceoryx2::node::Node;
use std::rc::Rc;
use std::time::Instant;

/// How a [`Client`] connects.
#[non_exhaustive]
#[derive(Clone, Debug, Default)]
pub struct ClientOptions {
    /// The instance; none: [`Root::find`].
    pub root: Option<Root>,
    /// Name in the daemon's list of clients; none: the program's.
    pub name: Option<String>,
}

impl ClientOptions {
    /// In this instance.
    pub fn root(self, root: Root) -> Self {
        Self { root: Some(root), ..self }
    }

    /// Under this name.
    pub fn name(self, name: impl Into<String>) -> Self {
        Self { name: Some(name.into()), ..self }
    }
}

/// How a subscriber waits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wake {
    /// Asleep until the daemon wakes it: no load, some 20 µs later.
    #[default]
    Sleep,
    /// Looks again and again: within a µs, for a whole core.
    Poll,
}

/// How a stream is subscribed to.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default)]
pub struct SubscribeOptions {
    /// How it waits.
    pub wake: Wake,
    /// Whether to take part in a lossless replay, which starts by [`Client::play`].
    pub lossless: bool,
}

impl SubscribeOptions {
    /// Polls instead of sleeping.
    pub fn poll(self) -> Self {
        Self { wake: Wake::Poll, ..self }
    }

    /// Takes part in a lossless replay.
    pub fn lossless(self) -> Self {
        Self { lossless: true, ..self }
    }
}

/// A connection to the daemon, kept for life. When the daemon goes and comes back, so do the connection and all
/// subscriptions, by themselves.
///
/// Belongs to one thread, with its subscribers; clones are the same connection. Another thread makes its own.
///
/// ```no_run
/// use core::time::Duration;
/// use lobula_client::{Client, ClientOptions, SubscribeOptions};
///
/// let client = Client::connect(ClientOptions::default().name("example"))?;
/// let mut events = client.events(SubscribeOptions::default())?;
/// loop {
///     let packet = events.recv(Duration::from_secs(1))?;
///     println!("{} events, {} lost before them", packet.len(), packet.lost_before());
///     for event in packet.iter().take(1) {
///         println!("{} µs: ({}, {})", packet.time(*event), event.x(), event.y());
///     }
/// }
/// # #[allow(unreachable_code)]
/// # Ok::<(), lobula_client::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Client {
    link: Rc<Link>,
}

impl Client {
    /// Connects to the daemon of an instance, which must be there.
    ///
    /// # Errors
    /// [`Error::NoDaemon`], [`Error::Permission`], [`Error::AbiMismatch`].
    pub fn connect(options: ClientOptions) -> Result<Self, Error> {
        let root = options.root.map_or_else(Root::find, Ok)?;
        let name = options.name.unwrap_or_else(program);
        let connection = Connection::open(&root, &name)?;
        Ok(Self { link: Rc::new(Link::new(root, name, connection)) })
    }

    /// Connects as soon as the daemon is there, for at most `within`.
    ///
    /// # Errors
    /// As [`Self::connect`]; [`Error::NoDaemon`] once the time is over.
    pub fn connect_within(options: ClientOptions, within: Duration) -> Result<Self, Error> {
        let deadline = Instant::now() + within;
        loop {
            match Self::connect(options.clone()) {
                Err(Error::NoDaemon { .. }) if Instant::now() < deadline => std::thread::sleep(RETRY),
                result => return result,
            }
        }
    }

    /// The instance.
    pub fn root(&self) -> &Root {
        &self.link.root
    }

    /// Who the daemon is (or was, if it is gone).
    pub fn hello(&self) -> Hello {
        self.link.hello.borrow().clone()
    }

    /// Whether the daemon is there now. Looks; reconnects where it has come back.
    pub fn is_connected(&self) -> bool {
        self.link.look();
        self.link.is_up()
    }

    /// Subscribes to the events.
    ///
    /// # Errors
    /// [`Error::NoDaemon`], [`Error::NoStream`] (a lossless replay is asked for and none is configured, or the other
    /// way round), [`Error::Permission`], [`Error::NoSpace`].
    pub fn events(&self, options: SubscribeOptions) -> Result<EventSubscriber, Error> {
        EventSubscriber::open(self.link.clone(), stream(Stream::events(), options), options.wake)
    }

    /// Subscribes to a view.
    ///
    /// # Errors
    /// As [`Self::events`]; [`Error::NoStream`] names the views there are.
    pub fn view(&self, name: &str, options: SubscribeOptions) -> Result<ViewSubscriber, Error> {
        crate::check_name("view", name)?;
        ViewSubscriber::open(self.link.clone(), stream(Stream::view(name), options), options.wake)
    }

    /// Says that this client has subscribed to all it wants of a lossless replay, which starts at once when `clients`
    /// clients have said so. Returns how many have. Every client of the replay says it, with the same number.
    ///
    /// # Errors
    /// [`Error::Refused`]: no lossless replay is configured, or it has been played.
    pub fn play(&self, clients: u32) -> Result<u32, Error> {
        match self.link.ask(&Request::Play { clients })? {
            Reply::Waiting { ready, .. } => Ok(ready),
            other => Err(unexpected(&other)),
        }
    }

    /// How the daemon is.
    ///
    /// # Errors
    /// [`Error::NoDaemon`].
    pub fn status(&self) -> Result<Status, Error> {
        match self.link.ask(&Request::Status {})? {
            Reply::Status(status) => Ok(*status),
            other => Err(unexpected(&other)),
        }
    }

    /// State of the camera.
    ///
    /// # Errors
    /// [`Error::NoDevice`], with the reason: the daemon runs, but its camera is not there. [`Error::NoDaemon`].
    pub fn device(&self) -> Result<SourceState, Error> {
        let status = self.status()?;
        match status.state {
            SourceState::NoDevice => Err(Error::NoDevice { reason: status.degraded.join("; ") }),
            state => Ok(state),
        }
    }

    /// Asks the daemon to end; it does so after the answer.
    ///
    /// # Errors
    /// [`Error::NoDaemon`].
    pub fn stop(&self) -> Result<(), Error> {
        self.link.ask(&Request::Stop {}).map(|_| ())
    }
}

fn stream(stream: Stream, options: SubscribeOptions) -> Stream {
    if options.lossless { stream.lossless() } else { stream }
}

fn program() -> String {
    let path = std::env::args_os().next().unwrap_or_default();
    std::path::Path::new(&path)
        .file_name()
        .map_or_else(|| "client".into(), |name| name.to_string_lossy().into_owned())
}

/// Time between two attempts to find the daemon.
const RETRY: Duration = Duration::from_millis(20);
/// Time between two looks whether the daemon is there.
const LOOK: Duration = Duration::from_millis(20);

/// What the subscribers of a client share: the control connection and the node in shared memory.
#[derive(Debug)]
pub(crate) struct Link {
    root: Root,
    name: String,
    connection: RefCell<Option<Connection>>,
    hello: RefCell<Hello>,
    node: RefCell<Option<LinkNode>>,
    /// Counts connections: a subscriber that has another number must subscribe again.
    epoch: Cell<u64>,
    looked: Cell<Instant>,
}

#[derive(Debug)]
struct LinkNode {
    node: Rc<Node<Gated>>,
    directory: (u64, u64),
}

impl Link {
    fn new(root: Root, name: String, connection: Connection) -> Self {
        let hello = RefCell::new(connection.hello.clone());
        Self {
            root,
            name,
            connection: RefCell::new(Some(connection)),
            hello,
            node: RefCell::new(None),
            epoch: Cell::new(1),
            looked: Cell::new(Instant::now()),
        }
    }

    pub(crate) fn root(&self) -> &Root {
        &self.root
    }

    pub(crate) fn epoch(&self) -> u64 {
        self.epoch.get()
    }

    pub(crate) fn camera(&self) -> String {
        self.hello.borrow().camera.clone()
    }

    pub(crate) fn is_up(&self) -> bool {
        self.connection.borrow().is_some()
    }

    /// Looks now and then whether the daemon is there, and connects again where it has come back.
    pub(crate) fn look(&self) {
        let now = Instant::now();
        if now.duration_since(self.looked.get()) < LOOK {
            return;
        }
        self.looked.set(now);
        let gone = self.connection.borrow().as_ref().is_some_and(|connection| !connection.is_alive());
        if gone {
            self.connection.replace(None);
        }
        if !self.is_up() {
            // That it is not back yet is no error: the caller's deadline decides.
            let _ = self.reconnect();
        }
    }

    fn reconnect(&self) -> Result<(), Error> {
        let connection = Connection::open(&self.root, &self.name)?;
        self.hello.replace(connection.hello.clone());
        self.connection.replace(Some(connection));
        self.epoch.set(self.epoch.get() + 1);
        Ok(())
    }

    pub(crate) fn ask(&self, request: &Request) -> Result<Reply, Error> {
        if !self.is_up() {
            self.reconnect()?;
        }
        let mut connection = self.connection.borrow_mut();
        let Some(open) = connection.as_mut() else { return Err(Error::NoDaemon { root: self.root.clone() }) };
        let reply = open.ask(request);
        if matches!(reply, Err(Error::NoDaemon { .. } | Error::Timeout { .. })) {
            *connection = None; // an answer that comes later must not be taken for that of another question
        }
        reply
    }

    pub(crate) fn subscribe(&self, stream: &Stream) -> Result<Subscribed, Error> {
        match self.ask(&Request::Subscribe { stream: stream.to_string() })? {
            Reply::Subscribed(subscribed) => Ok(subscribed),
            other => Err(unexpected(&other)),
        }
    }

    pub(crate) fn attached(&self, stream: &Stream, port: u128) -> Result<(), Error> {
        let request = Request::Attached { stream: stream.to_string(), port: format!("{port:x}") };
        self.ask(&request).map(|_| ())
    }

    /// The node in shared memory; another one where the directory was made anew.
    pub(crate) fn node(&self) -> Result<Rc<Node<Gated>>, Error> {
        let directory = self.root.identity()?;
        if let Some(open) = self.node.borrow().as_ref()
            && open.directory == directory
        {
            return Ok(open.node.clone());
        }
        let node = Rc::new(transport::node(&self.root, "lobula-client")?);
        self.node.replace(Some(LinkNode { node: node.clone(), directory }));
        Ok(node)
    }
}
