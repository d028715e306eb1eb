//! The same work done by other libraries, in the same run.

use lobula_core::Event;

use crate::contest::{Peer, Protocol};
use crate::op::Op;
use crate::op::fused::Stretch;
use crate::wire::Wire;

#[cfg_attr(feature = "peers", path = "eventcv.rs")]
#[cfg_attr(not(feature = "peers"), path = "absent.rs")]
mod side;

pub use side::load;

/// A library beside ours. Its input is prepared before the clock runs.
pub trait Library {
    /// Its ways of doing `op`; the quickest counts.
    fn ways(&self, op: Op, protocol: Protocol) -> Vec<Peer<'_>>;

    /// The events it decodes, or that its call makes of them; times modulo 2^32. Empty for an operation that gives a tensor.
    fn events(&self, op: Op) -> Vec<Event>;

    /// Its ways of decoding a stream of a format beside EVT3.
    ///
    /// # Errors
    /// A sentence, where it cannot open the stream.
    fn decoders<'a>(&self, wire: &'a Wire, protocol: Protocol) -> Result<Vec<Peer<'a>>, String>;

    /// Its ways from EVT3 words to the tensor of an operation.
    ///
    /// # Errors
    /// A sentence, where it cannot open the stream.
    fn fused<'a>(&'a self, op: Op, stretch: &Stretch<'_>) -> Result<Vec<Peer<'a>>, String>;

    /// The events it decodes of such a stream; `None` where it does not know the format.
    fn decoded(&self, wire: &Wire) -> Option<Vec<Event>>;

    /// The tensor it builds. Empty for an operation that gives events.
    fn tensor(&self, op: Op) -> Vec<f32>;
}
