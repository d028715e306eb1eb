//! # lobulad
//!
//! The daemon that owns the camera and publishes events and representations in shared memory. A library too, so that
//! one binary can also serve.
//!
//! ```text
//!  [source]       file, synthetic: bytes, stamped as they come
//!     | ring
//!  [pipeline]     decode -> chain, in a private block -> staging packet -> loan, write once, send, wake
//!     | ring
//!  [views]        Slicer -> Representation into the loan -> send
//!  [housekeeping] control socket, clients that have gone, rates
//! ```
//!
//! Three threads serve the camera: ports of iceoryx2 belong to one thread, a surface takes milliseconds to render, and
//! neither may delay events.

pub mod config;
pub mod floor;
pub mod source;

mod clock;
mod ledger;
mod shared;

mod feed;
mod pipeline;
mod publish;
mod pump;
mod views;

mod control;
mod gate;
mod housekeeping;
mod memory;

mod daemon;
mod serve;
mod signals;

pub use clock::now_ns;
pub use daemon::{Daemon, StartError, check};
pub use serve::{EXIT_CONFIG, serve};
pub use signals::{asked as end_asked, catch as catch_signals, die_with_parent};
