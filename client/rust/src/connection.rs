//! The client's end of the control socket.

use crate::control::{Banner, Hello, LINE_LEN_MAX, Reply, Request};
use crate::{Error, Root};
use core::time::Duration;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;

/// Longest time the daemon may take for an answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(5);

#[derive(Debug)]
pub(crate) struct Connection {
    root: Root,
    socket: UnixStream,
    unread: Vec<u8>,
    pub(crate) banner: Banner,
    pub(crate) hello: Hello,
}

impl Connection {
    /// Connects and says hello. The daemon's version is checked before anything is opened in shared memory.
    pub(crate) fn open(root: &Root, name: &str) -> Result<Self, Error> {
        root.identity()?;
        let socket = UnixStream::connect(root.control_socket()).map_err(|error| match error.kind() {
            ErrorKind::PermissionDenied => Error::Permission { root: root.clone() },
            _ => Error::NoDaemon { root: root.clone() },
        })?;
        socket
            .set_read_timeout(Some(ANSWER_WITHIN))
            .map_err(|error| Error::transport("control socket", error))?;
        let hello =
            Hello { generation: 0, pid: 0, camera: String::new(), width: 0, height: 0, streams: Vec::new() };
        let mut this = Self { root: root.clone(), socket, unread: Vec::new(), banner: Banner::ours(), hello };
        this.banner = parse(&this.line()?)?;
        if this.banner.wire() != Banner::ours().wire() {
            return Err(Error::AbiMismatch { ours: Banner::ours().wire(), theirs: this.banner.wire() });
        }
        match this.ask(&Request::Hello { name: name.into(), pid: std::process::id() })? {
            Reply::Hello(hello) => this.hello = hello,
            other => return Err(unexpected(&other)),
        }
        Ok(this)
    }

    /// Asks and waits for the answer. An answer that is an error becomes one here.
    pub(crate) fn ask(&mut self, request: &Request) -> Result<Reply, Error> {
        let mut line = serde_json::to_vec(request).map_err(|error| Error::transport("request", error))?;
        line.push(b'\n');
        self.socket.write_all(&line).map_err(|_| self.gone())?;
        match parse(&self.line()?)? {
            Reply::Error { kind, message } => Err(self.refused(request, &kind, message)),
            reply => Ok(reply),
        }
    }

    /// Whether the daemon still holds its end. Never waits.
    pub(crate) fn is_alive(&self) -> bool {
        peek(&self.socket)
    }

    fn refused(&self, request: &Request, kind: &str, message: String) -> Error {
        match (kind, request) {
            ("no_stream", Request::Subscribe { stream }) => {
                Error::NoStream { asked: stream.clone(), available: self.hello.streams.clone() }
            }
            ("no_device", _) => Error::NoDevice { reason: message },
            ("invalid", _) => Error::Invalid { message },
            _ => Error::Refused { message },
        }
    }

    fn gone(&self) -> Error {
        Error::NoDaemon { root: self.root.clone() }
    }

    fn line(&mut self) -> Result<Vec<u8>, Error> {
        let mut chunk = [0; 4096];
        loop {
            if let Some(end) = self.unread.iter().position(|byte| *byte == b'\n') {
                let rest = self.unread.split_off(end + 1);
                return Ok(core::mem::replace(&mut self.unread, rest));
            }
            if self.unread.len() > LINE_LEN_MAX {
                return Err(Error::Transport { message: "the daemon's answer is too long".into() });
            }
            match self.socket.read(&mut chunk) {
                Ok(0) => return Err(self.gone()),
                Ok(n) => self.unread.extend_from_slice(chunk.get(..n).unwrap_or_default()),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    return Err(Error::Timeout { waited: ANSWER_WITHIN });
                }
                Err(_) => return Err(self.gone()),
            }
        }
    }
}

fn parse<T: serde::de::DeserializeOwned>(line: &[u8]) -> Result<T, Error> {
    serde_json::from_slice(line).map_err(|error| Error::Transport {
        message: format!(
            "the daemon's answer is not understood ({error}): install both from the same release"
        ),
    })
}

pub(crate) fn unexpected(reply: &Reply) -> Error {
    Error::Transport { message: format!("the daemon answered another question: {reply:?}") }
}

#[allow(unsafe_code)] // std cannot look into a socket without taking from it
fn peek(socket: &UnixStream) -> bool {
    let mut byte = 0u8;
    // SAFETY: the descriptor is open for as long as `socket` lives; `byte` is room for the one byte asked for.
    let n = unsafe {
        libc::recv(socket.as_raw_fd(), (&raw mut byte).cast(), 1, libc::MSG_PEEK | libc::MSG_DONTWAIT)
    };
    match n {
        0 => false,
        n if n > 0 => true,
        _ => matches!(std::io::Error::last_os_error().kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
    }
}
