//! Sources: where a camera's bytes come from. Adding one = one file and one line in [`SourceSpec`] and [`open`].

mod file;
mod synthetic;

pub use file::FileSpec;
use lobula_core::Geometry;
use lobula_core::simulation::SceneSpec;
use lobula_core::wire::Encoding;
use serde::{Deserialize, Serialize};

/// Stream time in µs that a paced source gives in one packet, as a camera's USB bridge does.
pub const PACKET_US: u64 = 1000;

/// Settings of a source, told apart by `kind`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum SourceSpec {
    /// A recording, at its own pace or as fast as its clients take it.
    File(FileSpec),
    /// A synthetic scene.
    Synthetic(SceneSpec),
}

impl SourceSpec {
    /// Whether nothing may be lost: the source waits for its clients.
    pub fn is_lossless(&self) -> bool {
        matches!(self, Self::File(FileSpec { lossless: true, .. }))
    }
}

/// One packet of a source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Transfer {
    /// Bytes written.
    pub bytes: usize,
    /// When it is due, in ns after the first packet's start. `None`: at once.
    pub due_ns: Option<u64>,
    /// These bytes do not go on where the ones before ended.
    pub restart: Option<Restart>,
    /// Nothing follows, and there are no bytes.
    pub end: bool,
}

/// A recording starts over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Restart {
    /// Sensor time in µs near which its bytes start: for [`Decode::gap`](lobula_core::Decode::gap).
    pub near_us: u64,
    /// What to add to every sensor time from here on, so that stream time goes on.
    pub shift_us: u64,
}

/// Gives a camera's bytes, a packet at a time.
pub trait Source: Send {
    /// How its events are encoded.
    fn encoding(&self) -> Encoding;

    /// The sensor's size.
    fn geometry(&self) -> Geometry;

    /// What it is, in words, for the status.
    fn describe(&self) -> String;

    /// Writes the next packet to `out`, of at least [`TRANSFER_BYTES_MIN`].
    fn read(&mut self, out: &mut [u8]) -> Result<Transfer, SourceError>;
}

/// Least length of the memory for a packet.
pub const TRANSFER_BYTES_MIN: usize = 4096;

/// Why a source cannot be opened, or cannot go on.
#[derive(Debug)]
pub enum SourceError {
    /// The recording.
    Recording(lobula_formats::Error),
    /// The settings, with what to do.
    Settings(String),
}

impl core::fmt::Display for SourceError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Recording(error) => error.fmt(f),
            Self::Settings(why) => why.fmt(f),
        }
    }
}

impl std::error::Error for SourceError {}

/// Opens the source that the settings describe.
pub fn open(spec: &SourceSpec) -> Result<Box<dyn Source>, SourceError> {
    Ok(match spec {
        SourceSpec::File(spec) => Box::new(file::File::open(spec)?),
        SourceSpec::Synthetic(spec) => Box::new(synthetic::Synthetic::new(spec)?),
    })
}
