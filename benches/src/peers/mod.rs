//! The same work done by other libraries, in the same run.

use lobula_core::Event;

use crate::contest::{Peer, Protocol};
use crate::op::Op;

#[cfg_attr(feature = "peers", path = "eventcv.rs")]
#[cfg_attr(not(feature = "peers"), path = "absent.rs")]
mod side;

pub use side::load;

/// A library beside ours. Its input is prepared before the clock runs.
pub trait Library {
    /// Its ways of doing `op`; the quickest counts.
    fn ways(&self, op: Op, protocol: Protocol) -> Vec<Peer<'_>>;

    /// The events it decodes, or keeps; times modulo 2^32. Empty for an operation that gives a tensor.
    fn events(&self, op: Op) -> Vec<Event>;

    /// The tensor it builds. Empty for an operation that gives events.
    fn tensor(&self, op: Op) -> Vec<f32>;
}
