//! EVT3 bytes to events.

use lobula_core::wire::evt3::{Decoder, Kernel};

use super::decode::{stream, whole};
use super::{Op, same_events};
use crate::contest::{Contest, Protocol, Unit};
use crate::input::Scene;
use crate::peers::Library;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the peer decodes other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    if let Some(peer) = peer {
        same_events(&scene.events, &peer.events(Op::Evt3Decode))?;
    }
    let contest = |kernel, protocol, ours, bar| Contest {
        op: Op::Evt3Decode.name(),
        kernel,
        protocol,
        unit: Unit::Rate,
        events: scene.events.len(),
        expected: scene.events.len() as u64,
        ours,
        peers: peer.map_or_else(Vec::new, |peer| peer.ways(Op::Evt3Decode, protocol)),
        bar: Some(bar),
        note: "same events; ours: 8 bytes an event, whole: on 2 MiB pages; peer: 13",
    };
    let kernels =
        [("portable", Kernel::Portable, 4.0), ("neon", Kernel::Neon, 4.0), ("avx512", Kernel::Avx512, 6.0)];
    let available = kernels.into_iter().filter(|(_, kernel, _)| kernel.is_available());
    Ok(available
        .flat_map(|(name, kernel, bar_stream)| {
            let decoder = move || Decoder::with_kernel(scene.geometry, kernel);
            let room = scene.bytes.len() / 2;
            [
                contest(name, Protocol::Whole, whole(&scene.bytes, room, decoder), 2.0),
                contest(name, Protocol::Stream, stream(&scene.bytes, decoder), bar_stream),
            ]
        })
        .collect())
}
