//! The formats crate from outside: truth from other programs, slices against a full pass, round trips, messages.
#![allow(clippy::unwrap_used)] // helpers of tests may too

mod errors;
mod round_trip;
mod slices;
mod truth;

use lobula_core::{Event, Trigger};
use lobula_formats::{Blocks, Recording};

/// Every event with its full time, and every trigger, of blocks to their end.
fn everything(mut blocks: Blocks) -> (Vec<(u64, Event)>, Vec<Trigger>) {
    let (mut events, mut triggers) = (Vec::new(), Vec::new());
    while let Some(chunk) = blocks.next_block().unwrap() {
        let span = chunk.span();
        assert!(!span.events.is_empty() || !chunk.triggers.is_empty(), "an empty chunk says nothing");
        events.extend(span.events.iter().map(|event| (span.time(*event), *event)));
        triggers.extend(chunk.triggers);
    }
    (events, triggers)
}

fn events_of(recording: &Recording) -> Vec<(u64, Event)> {
    everything(recording.blocks()).0
}
