//! Events in order of time.

use std::hint::black_box;

use lobula_core::Event;
use lobula_core::slice::SliceSort;
use lobula_formats::LargeArray;

use super::moved::Moved;
use super::{Op, same_events};
use crate::contest::{Contest, Protocol};
use crate::input::{Scene, block_of};
use crate::peers::Library;

/// The operation's contest: whole alone, since it needs all events.
///
/// # Errors
/// A sentence, where the peer gives other events.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Moved {
        op: Op::SortByTime,
        same: true,
        note: "same events; the recording steps back by a few µs now and then; ours: a fresh array and fresh scratch memory",
    };
    let sorted = sort(scene)?;
    if let Some(peer) = peer {
        same_events(&sorted, &peer.events(op.op)).map_err(|e| format!("{}: {e}", op.op.name()))?;
    }
    let count = sorted.len();
    let ours = Box::new(|| black_box(sort(scene)).map_or(0, |sorted| sorted.len() as u64));
    let contest = op.contest(Protocol::Whole, scene, peer, (count as u64, count), ours);
    Ok(vec![Contest { bar: Some(2.0), ..contest }])
}

fn sort(scene: &Scene) -> Result<LargeArray<Event>, String> {
    let array = || LargeArray::zeroed(scene.events.len()).map_err(|e| e.to_string());
    let (mut events, mut scratch) = (array()?, array()?);
    let mut block = block_of(scene.span(scene.events.len()), &mut events);
    SliceSort::new(&mut scratch[..]).apply(&mut block).map_err(|e| e.to_string())?;
    Ok(events)
}
