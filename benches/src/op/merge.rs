//! Two streams as one, in order of time.

use std::hint::black_box;

use lobula_core::merge::{Merge, MergeInput};
use lobula_core::{Event, Sink, Span};
use lobula_formats::LargeArray;

use super::Op;
use super::moved::Moved;
use crate::contest::{Contest, Protocol, Work};
use crate::input::{PACKET_EVENTS, Scene};
use crate::peers::Library;

/// The operation's contests: the streams are the scene's ON and its OFF events.
///
/// # Errors
/// A sentence, where there is no memory.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let op = Moved {
        op: Op::Merge,
        same: false,
        note: "ON and OFF events; those that step back in time: ours come late, the peer's are sorted",
    };
    let all = scene.events.len();
    let of = |on: bool| scene.events.iter().copied().filter(|event| event.is_on() == on).collect();
    let (on, off): (Vec<Event>, Vec<Event>) = (of(true), of(false));
    let (on_again, off_again) = (on.clone(), off.clone());
    let whole: Work<'a> = Box::new(move || {
        let Ok(mut merged) = LargeArray::zeroed(all + Sink::LEN_MIN) else { return 0 };
        let mut sink = Sink::new(&mut merged);
        let taken = merge(scene, [&on, &off], |merge, inputs| merge.merge(inputs, &mut sink).unwrap_or_default());
        black_box(merged);
        taken
    });
    let mut packet = vec![Event::default(); PACKET_EVENTS];
    let stream: Work<'a> = Box::new(move || {
        merge(scene, [&on_again, &off_again], |merge, inputs| {
            let mut sink = Sink::new(&mut packet);
            let taken = merge.merge(inputs, &mut sink).unwrap_or_default();
            black_box(sink.block(scene.geometry));
            taken
        })
    });
    let count = (all as u64, all);
    Ok(vec![
        op.contest(Protocol::Whole, scene, peer, count, whole),
        op.contest(Protocol::Stream, scene, peer, count, stream),
    ])
}

/// Merges until nothing is left; returns how many events.
fn merge(
    scene: &Scene,
    streams: [&[Event]; 2],
    mut once: impl FnMut(&Merge, &mut [MergeInput<'_>]) -> usize,
) -> u64 {
    let all = scene.span(scene.events.len());
    let mut inputs = streams.map(|events| MergeInput::last(Span { events, ..all }));
    let merge = Merge::new(scene.geometry);
    let mut taken = 0;
    loop {
        match once(&merge, &mut inputs) {
            0 => return taken,
            events => taken += events as u64,
        }
    }
}
