//! EVT 2.1 bytes to events, in both orders of a word's halves.

use lobula_core::wire::{Encoding, WordOrder};

use super::{Op, decode};
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The operation's contests.
///
/// # Errors
/// A sentence, where a recording cannot be used.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let orders = [
        (
            WordOrder::Little,
            "asked of stream: 300 Mev/s; mask first; the peer takes EVT 2.1 for EVT 2.0: other events",
        ),
        (
            WordOrder::Legacy,
            "asked of stream: 300 Mev/s; mask last; the peer takes EVT 2.1 for EVT 2.0: other events",
        ),
    ];
    let mut contests = Vec::new();
    for (order, note) in orders {
        let wire = scene.wire(Encoding::Evt21(order))?;
        contests.extend(decode::of_wire(Op::Evt21Decode, wire, peer, note)?);
    }
    Ok(contests)
}
