//! What can go wrong for a client, and what to do about it.

use crate::instance::Root;
use core::fmt;
use core::time::Duration;

/// Why a call failed. Every message says what to do next.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Error {
    /// Nothing serves the instance (or it went away and has not come back within the time given).
    NoDaemon {
        /// The instance.
        root: Root,
    },
    /// The instance belongs to somebody else.
    Permission {
        /// The instance.
        root: Root,
    },
    /// The daemon is there, but nothing came in time.
    Timeout {
        /// How long was waited.
        waited: Duration,
    },
    /// The daemon is there, but its camera is not.
    NoDevice {
        /// What the daemon says.
        reason: String,
    },
    /// Packets were overwritten before they were read.
    Overrun {
        /// How many events (of views: windows) were missed.
        lost: u64,
    },
    /// More packets are held at once than the service allows.
    HeldTooMany {
        /// How many may be held.
        max: usize,
    },
    /// The daemon speaks another version.
    AbiMismatch {
        /// What this library speaks: wire version and version of iceoryx2.
        ours: String,
        /// What the daemon speaks.
        theirs: String,
    },
    /// There is no such stream.
    NoStream {
        /// What was asked for.
        asked: String,
        /// What there is.
        available: Vec<String>,
    },
    /// A name, path or setting is not allowed.
    Invalid {
        /// What is wrong with it, and what is allowed.
        message: String,
    },
    /// The file system of the instance is too small.
    NoSpace {
        /// The instance.
        root: Root,
        /// Bytes needed.
        need: u64,
        /// Bytes free.
        free: u64,
    },
    /// Somebody else already serves the instance.
    InUse {
        /// The instance.
        root: Root,
    },
    /// The daemon refused a request.
    Refused {
        /// What it says.
        message: String,
    },
    /// Shared memory or the control socket failed in a way that has no name here.
    Transport {
        /// What was done and what happened.
        message: String,
    },
}

impl Error {
    pub(crate) fn transport(what: &str, error: impl fmt::Debug) -> Self {
        Self::Transport { message: format!("{what}: {error:?}") }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const MIB: f64 = 1024.0 * 1024.0;
        match self {
            Self::NoDaemon { root } => write!(
                f,
                "no lobulad serves {root}: start one with `lobula serve`, or set LOBULA_ROOT to the directory of the one that runs"
            ),
            Self::Permission { root } => write!(
                f,
                "{root} may not be entered: run as the user who started lobulad, or join the group of the directory"
            ),
            Self::Timeout { waited } => {
                write!(f, "nothing came within {waited:?}: see `lobula status` for the state of the source")
            }
            Self::NoDevice { reason } => write!(f, "the camera is not there: {reason}"),
            Self::Overrun { lost } => {
                write!(f, "{lost} were overwritten before they were read: read sooner, or do less per packet")
            }
            Self::HeldTooMany { max } => {
                write!(f, "more than {max} packets are held at once: drop one before the next is received")
            }
            Self::AbiMismatch { ours, theirs } => write!(
                f,
                "this program speaks {ours} and the daemon {theirs}: install both from the same release"
            ),
            Self::NoStream { asked, available } => {
                write!(f, "there is no stream `{asked}`: the daemon has {}", available.join(", "))
            }
            Self::NoSpace { root, need, free } => write!(
                f,
                "{root} lies in a file system with {:.1} MiB free, and {:.1} MiB are needed: enlarge it (as root: mount -o remount,size=512M /dev/shm; Docker: --shm-size=512m) or configure fewer or smaller views",
                *free as f64 / MIB,
                *need as f64 / MIB
            ),
            Self::InUse { root } => write!(
                f,
                "another lobulad already serves {root}: stop it, or give this one a directory of its own (`instance.root`, LOBULA_ROOT)"
            ),
            Self::Invalid { message } | Self::Refused { message } | Self::Transport { message } => {
                f.write_str(message)
            }
        }
    }
}

impl core::error::Error for Error {}
