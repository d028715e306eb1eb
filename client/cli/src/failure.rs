//! What ends the tool: a sentence for people and an exit code for programs.

use std::fmt::Display;
use std::io;

/// Why the tool ends before it is done.
#[derive(Debug)]
pub struct Failure {
    code: u8,
    message: Option<String>,
}

impl Failure {
    /// Anything without a code of its own.
    pub const GENERAL: u8 = 1;
    /// Wrong usage, or a file that cannot be used.
    pub const INPUT: u8 = 2;
    /// Ended by the user, as shells tell it.
    pub const INTERRUPTED: u8 = 130;
    const NOT_FOUND: u8 = 3;
    const NO_DAEMON: u8 = 4;
    const PERMISSION: u8 = 5;
    const TIMEOUT: u8 = 6;
    const VERSION: u8 = 8;

    /// A failure with one of the codes above.
    pub fn new(code: u8, message: impl Display) -> Self {
        Self { code, message: Some(message.to_string()) }
    }

    /// A failure without a code of its own.
    pub fn general(message: impl Display) -> Self {
        Self::new(Self::GENERAL, message)
    }

    /// The exit code.
    pub const fn code(&self) -> u8 {
        self.code
    }

    pub(crate) fn print(&self) {
        if let Some(message) = &self.message {
            eprintln!("lobula: {message}");
        }
    }
}

impl From<lobula_formats::Error> for Failure {
    fn from(error: lobula_formats::Error) -> Self {
        Self::new(Self::INPUT, error)
    }
}

impl From<lobula_client::Error> for Failure {
    fn from(error: lobula_client::Error) -> Self {
        use lobula_client::Error;
        let code = match &error {
            Error::NoDaemon { .. } => Self::NO_DAEMON,
            Error::Permission { .. } => Self::PERMISSION,
            Error::Timeout { .. } => Self::TIMEOUT,
            Error::NoStream { .. } | Error::NoDevice { .. } => Self::NOT_FOUND,
            Error::AbiMismatch { .. } => Self::VERSION,
            Error::Invalid { .. } => Self::INPUT,
            _ => Self::GENERAL,
        };
        Self::new(code, error)
    }
}

impl From<io::Error> for Failure {
    /// Of writing to the terminal or a pipe, whose reader may have seen enough.
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::BrokenPipe => Self { code: 0, message: None },
            _ => Self::general(error),
        }
    }
}
