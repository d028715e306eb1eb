//! The control socket: who is connected, what they ask, what they are told.
//!
//! One thread serves all connections and never waits for one: what a client does not read is bounded, and then the
//! client is let go.

use lobula_client::Root;
use lobula_client::control::{Banner, ClientStatus, LINE_LEN_MAX, Reply, Request};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::net::{UnixListener, UnixStream};

/// Most connections at once.
const CLIENTS_MAX: usize = 64;
/// Most bytes kept for a client that does not read.
const UNREAD_MAX: usize = 256 * 1024;

/// A port a client has open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttachedPort {
    /// The stream.
    pub stream: String,
    /// Id of its iceoryx2 subscriber.
    pub port: u128,
}

/// A connected client.
#[derive(Debug)]
pub struct Connection {
    socket: UnixStream,
    unread: Vec<u8>,
    unsent: Vec<u8>,
    closed: bool,
    /// What it calls itself.
    pub name: String,
    /// Its process.
    pub pid: u32,
    /// What it has open.
    pub ports: Vec<AttachedPort>,
    /// Whether it is ready for a lossless replay, and how many clients it waits for.
    pub ready_for: Option<u32>,
}

impl Connection {
    fn new(socket: UnixStream) -> Self {
        let mut this = Self {
            socket,
            unread: Vec::new(),
            unsent: Vec::new(),
            closed: false,
            name: "?".into(),
            pid: 0,
            ports: Vec::new(),
            ready_for: None,
        };
        this.queue(&Banner::ours());
        this
    }

    /// How it is listed.
    pub fn status(&self) -> ClientStatus {
        let streams = self.ports.iter().map(|port| port.stream.clone()).collect();
        ClientStatus { name: self.name.clone(), pid: self.pid, streams }
    }

    fn queue(&mut self, message: &impl serde::Serialize) {
        match serde_json::to_writer(&mut self.unsent, message) {
            Ok(()) => self.unsent.push(b'\n'),
            Err(_) => self.closed = true,
        }
        self.write();
    }

    fn write(&mut self) {
        while !self.unsent.is_empty() {
            match self.socket.write(&self.unsent) {
                Ok(0) => return self.closed = true,
                Ok(n) => drop(self.unsent.drain(..n)),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(_) => return self.closed = true,
            }
        }
        self.closed |= self.unsent.len() > UNREAD_MAX;
    }

    fn read(&mut self) {
        let mut chunk = [0; 4096];
        loop {
            match self.socket.read(&mut chunk) {
                Ok(0) => return self.closed = true,
                Ok(n) => self.unread.extend_from_slice(chunk.get(..n).unwrap_or_default()),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(_) => return self.closed = true,
            }
            if self.unread.len() > LINE_LEN_MAX {
                return;
            }
        }
    }

    fn next_line(&mut self) -> Option<Vec<u8>> {
        match self.unread.iter().position(|byte| *byte == b'\n') {
            Some(end) => {
                let rest = self.unread.split_off(end + 1);
                Some(core::mem::replace(&mut self.unread, rest))
            }
            None => {
                self.closed |= self.unread.len() > LINE_LEN_MAX;
                None
            }
        }
    }
}

/// The socket and its connections.
#[derive(Debug)]
pub struct Control {
    listener: UnixListener,
    connections: Vec<Connection>,
}

impl Control {
    /// Listens in an instance, whose directory this daemon holds.
    pub fn listen(root: &Root) -> std::io::Result<Self> {
        let listener = UnixListener::bind(root.control_socket())?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, connections: Vec::new() })
    }

    /// The connected clients.
    pub fn connections(&self) -> &[Connection] {
        &self.connections
    }

    /// Waits for at most `timeout_ms` for something to do, then answers every request by `answer`. Returns the clients
    /// that have gone.
    pub fn serve(
        &mut self,
        timeout_ms: i32,
        mut answer: impl FnMut(&mut [Connection], usize, Request) -> Reply,
    ) -> Vec<Connection> {
        wait(&self.descriptors(), timeout_ms);
        self.accept();
        for index in 0..self.connections.len() {
            if let Some(connection) = self.connections.get_mut(index) {
                connection.write();
                connection.read();
            }
            self.answer_all(index, &mut answer);
        }
        let (gone, here) = core::mem::take(&mut self.connections).into_iter().partition(|c| c.closed);
        self.connections = here;
        gone
    }

    fn answer_all(
        &mut self,
        index: usize,
        answer: &mut impl FnMut(&mut [Connection], usize, Request) -> Reply,
    ) {
        while let Some(line) = self.connections.get_mut(index).and_then(Connection::next_line) {
            let reply = match serde_json::from_slice(&line) {
                Ok(request) => answer(&mut self.connections, index, request),
                Err(error) => refuse("invalid", format!("request not understood: {error}")),
            };
            if let Some(connection) = self.connections.get_mut(index) {
                connection.queue(&reply);
            }
        }
    }

    fn accept(&mut self) {
        while let Ok((socket, _)) = self.listener.accept() {
            if self.connections.len() < CLIENTS_MAX && socket.set_nonblocking(true).is_ok() {
                self.connections.push(Connection::new(socket));
            }
        }
    }

    /// What to wait for: a newcomer, requests, and room for answers not yet sent.
    fn descriptors(&self) -> Vec<(RawFd, bool)> {
        let clients = self.connections.iter().map(|c| (c.socket.as_raw_fd(), !c.unsent.is_empty()));
        core::iter::once((self.listener.as_raw_fd(), false)).chain(clients).collect()
    }
}

/// An answer that is an error.
pub fn refuse(kind: &str, message: String) -> Reply {
    Reply::Error { kind: kind.into(), message }
}

#[allow(unsafe_code)] // std cannot wait for several sockets
fn wait(descriptors: &[(RawFd, bool)], timeout_ms: i32) {
    let events = |write: bool| if write { libc::POLLIN | libc::POLLOUT } else { libc::POLLIN };
    let mut polled: Vec<libc::pollfd> = descriptors
        .iter()
        .map(|(fd, write)| libc::pollfd { fd: *fd, events: events(*write), revents: 0 })
        .collect();
    // SAFETY: the pointer and length are those of `polled`. A signal or an error ends the wait early, which harms
    // nothing: every socket is then tried without waiting.
    unsafe { libc::poll(polled.as_mut_ptr(), polled.len() as libc::nfds_t, timeout_ms) };
}
