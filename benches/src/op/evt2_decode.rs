//! EVT 2.0 bytes to events.

use lobula_core::wire::Encoding;

use super::{Op, decode};
use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the recording cannot be used or the peer decodes other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let note =
        "asked of stream: 700 Mev/s; same events; ours: 8 bytes an event, whole: on 2 MiB pages; peer: 13";
    decode::of_wire(Op::Evt2Decode, scene.wire(Encoding::Evt2)?, peer, note)
}
