//! What goes over the control socket: newline-delimited JSON, one object a line. Debug it with
//! `socat - UNIX-CONNECT:/dev/shm/lobula-1000/control.sock`.
//!
//! The daemon speaks first, with its [`Banner`]. Then each [`Request`] is answered by one [`Reply`], in order. A
//! connection is kept for life: its end tells the client that the daemon is gone, and the daemon that the client is.

use crate::header::{ABI, ByteLedger, EventLedger};
use lobula_core::representation::Dtype;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Longest line either side reads, in bytes.
pub const LINE_LEN_MAX: usize = 64 * 1024;

/// Version of iceoryx2 that both sides must be built with.
pub const ICEORYX2: &str = "0.10.0";

/// First line of a connection, from the daemon.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Banner {
    /// Version of the daemon.
    pub lobulad: String,
    /// [`ABI`].
    pub abi: u32,
    /// [`ICEORYX2`].
    pub iceoryx2: String,
}

impl Banner {
    /// The banner of this build.
    pub fn ours() -> Self {
        Self { lobulad: env!("CARGO_PKG_VERSION").into(), abi: ABI, iceoryx2: ICEORYX2.into() }
    }

    /// What must be equal for shared memory to be understood.
    pub fn wire(&self) -> String {
        format!("wire version {} over iceoryx2 {}", self.abi, self.iceoryx2)
    }
}

/// What a client asks. `{"op":"subscribe","stream":"events"}`
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Who the client is; answered by [`Reply::Hello`].
    Hello {
        /// Name in lists.
        name: String,
        /// Process.
        pid: u32,
    },
    /// Where to find a stream; answered by [`Reply::Subscribed`].
    Subscribe {
        /// As [`Stream`](crate::Stream) is written.
        stream: String,
    },
    /// The stream's port is open; answered by [`Reply::Done`].
    Attached {
        /// As [`Stream`](crate::Stream) is written.
        stream: String,
        /// Id of the iceoryx2 subscriber in hexadecimal digits, by which the daemon knows whose queue is full.
        port: String,
    },
    /// The client is ready for a lossless replay, which starts once so many clients are; answered by [`Reply::Waiting`].
    Play {
        /// How many clients must have said `play`, this one included.
        clients: u32,
    },
    /// How the daemon is; answered by [`Reply::Status`].
    Status {},
    /// The daemon is to end; answered by [`Reply::Done`].
    Stop {},
}

/// What the daemon answers. `{"reply":"done"}`
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "reply", rename_all = "snake_case")]
pub enum Reply {
    /// Who the daemon is.
    Hello(Hello),
    /// Where the stream is.
    Subscribed(Subscribed),
    /// How the daemon is.
    Status(Box<Status>),
    /// Who is ready.
    Waiting {
        /// Clients that are ready.
        ready: u32,
        /// Clients that must be.
        needed: u32,
    },
    /// It is done.
    Done {},
    /// It is not done.
    Error {
        /// `no_stream`, `no_device`, `invalid` or `refused`.
        kind: String,
        /// Why, and what to do.
        message: String,
    },
}

/// Who the daemon is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hello {
    /// Its run, see [`PacketHeader::generation`](crate::PacketHeader::generation).
    pub generation: u64,
    /// Its process.
    pub pid: u32,
    /// Name of its camera.
    pub camera: String,
    /// Columns of the sensor.
    pub width: u16,
    /// Rows of the sensor.
    pub height: u16,
    /// What can be subscribed to.
    pub streams: Vec<String>,
}

/// Where a stream is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Subscribed {
    /// Name of the iceoryx2 services.
    pub service: String,
    /// Columns of the sensor.
    pub width: u16,
    /// Rows of the sensor.
    pub height: u16,
    /// Of a view: its tensor.
    pub tensor: Option<TensorInfo>,
}

/// What the tensors of a view are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TensorInfo {
    /// Element.
    pub dtype: Dtype,
    /// Extent, outermost first: channels, rows, columns.
    pub shape: [u32; 3],
    /// How long a window is, in µs.
    pub period_us: u64,
    /// From the start of one window to that of the next, in µs: less than that where windows overlap.
    pub stride_us: u64,
}

/// State of the source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SourceState {
    /// A lossless replay waits for its clients.
    Waiting,
    /// Bytes come.
    Playing,
    /// All was played.
    Ended,
    /// The device or file is not there; the reason is in [`Status::degraded`].
    NoDevice,
}

/// How the daemon is.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Status {
    /// Version of the daemon.
    pub version: String,
    /// Its process.
    pub pid: u32,
    /// Its run, see [`PacketHeader::generation`](crate::PacketHeader::generation).
    pub generation: u64,
    /// Seconds since its start.
    pub uptime_s: f64,
    /// Name of its camera.
    pub camera: String,
    /// Columns of the sensor.
    pub width: u16,
    /// Rows of the sensor.
    pub height: u16,
    /// What the source is, in words.
    pub source: String,
    /// State of the source.
    pub state: SourceState,
    /// What is not as it should be, in words; empty when all is well.
    pub degraded: Vec<String>,
    /// Ledger of bytes.
    pub bytes: ByteLedger,
    /// Ledger of events.
    pub events: EventLedger,
    /// Malformed words by kind.
    pub faults: BTreeMap<String, u64>,
    /// External triggers decoded.
    pub triggers: u64,
    /// Packets published, heartbeats included.
    pub packets: u64,
    /// Transfers of a paced source that were taken more than 10 ms after they were due: the machine is too slow for it.
    pub behind: u64,
    /// Packets that the views did not get since they were behind.
    pub views_missed: u64,
    /// Stream time in µs.
    pub stream_time_us: u64,
    /// Bytes a second over the last second.
    pub bytes_per_s: f64,
    /// Events decoded a second over the last second.
    pub events_in_per_s: f64,
    /// Events published a second over the last second.
    pub events_out_per_s: f64,
    /// Mean of published - arrived over the last second, in ns.
    pub latency_ns_mean: u64,
    /// The longest published - arrived over the last second, in ns.
    pub latency_ns_max: u64,
    /// Who is connected.
    pub clients: Vec<ClientStatus>,
    /// The views.
    pub views: Vec<ViewStatus>,
}

/// A client, as the daemon sees it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClientStatus {
    /// What it calls itself.
    pub name: String,
    /// Its process.
    pub pid: u32,
    /// What it has open.
    pub streams: Vec<String>,
}

/// A view, as the daemon counts it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ViewStatus {
    /// Its name.
    pub name: String,
    /// Windows published.
    pub published: u64,
    /// Windows not published.
    pub skipped: u64,
    /// Events older than their window.
    pub late: u64,
    /// Events that their slice had no room for (`events_max` of a view whose reference is the last event).
    #[serde(default)]
    pub overflowed: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_what_the_docs_say() {
        let request: Request = serde_json::from_str(r#"{"op":"subscribe","stream":"events"}"#).unwrap();
        assert_eq!(request, Request::Subscribe { stream: "events".into() });
        assert_eq!(serde_json::to_string(&Reply::Done {}).unwrap(), r#"{"reply":"done"}"#);
        assert!(serde_json::from_str::<Request>(r#"{"op":"stop","now":true}"#).is_err());
    }
}
