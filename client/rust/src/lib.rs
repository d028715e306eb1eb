//! # lobula-client
//!
//! Client of lobulad: subscribe to the events and views of a camera in shared memory, without a copy; wait for them;
//! ask the daemon how it is. The one definition of service names, headers and quality of service.
//!
//! ```text
//!  Client ── control socket (JSON lines) ──▶ lobulad
//!    ├─ EventSubscriber ◀── lobula/v1/<camera>/events       Packet: header + &[Event]
//!    └─ ViewSubscriber  ◀── lobula/v1/<camera>/view/<name>  Tensor: header + &[u8 | f16 | f32]
//! ```
//!
//! Everybody who may enter the directory of the instance can write to what is shared there: it is the trust domain.

mod error;
mod instance;
mod stream;

mod header;
mod qos;

pub mod control;
pub mod transport;

mod client;
mod connection;
mod events;
mod feed;
mod views;

pub use client::{Client, ClientOptions, SubscribeOptions, Wake};
pub use error::Error;
pub use events::{EventSubscriber, Packet};
pub use header::{
    ABI, ByteLedger, ClockMap, EventLedger, Flags, Line, PacketHeader, ShmEvent, Stamps, TensorHeader,
};
pub use instance::Root;
pub use lobula_core::representation::Dtype;
pub use qos::{PACKET_EVENTS_MAX, Qos};
pub use stream::{Stream, check_name};
pub use views::{Tensor, ViewSubscriber};
