//! The formats crate from outside: truth from other programs, slices against a full pass, round trips, messages.
#![allow(clippy::unwrap_used)] // helpers of tests may too

mod conversion;
mod errors;
mod hdf5;
mod left_out;
mod peer_faults;
mod ros;
mod round_trip;
mod slices;
mod truth;

use lobula_core::wire::Encoding;
use lobula_core::{Event, Geometry, Trigger};
use lobula_formats::{Blocks, Error, Part, Recording, WriteOptions, Writer};
use std::path::Path;

/// What blocks gave until their end.
#[derive(Default)]
struct All {
    /// With their full times.
    events: Vec<(u64, Event)>,
    triggers: Vec<Trigger>,
    /// How many of the events came before each trigger.
    places: Vec<usize>,
}

fn everything(mut blocks: Blocks) -> All {
    let mut all = All::default();
    while let Some(chunk) = blocks.next_block().unwrap() {
        assert!(chunk.parts().next().is_some(), "an empty chunk says nothing");
        for part in chunk.parts() {
            match part {
                Part::Events(span) => {
                    all.events.extend(span.events.iter().map(|event| (span.time(*event), *event)))
                }
                Part::Trigger(_) => all.places.push(all.events.len()),
            }
        }
        all.triggers.extend(chunk.triggers);
    }
    all
}

fn events_of(recording: &Recording) -> Vec<(u64, Event)> {
    everything(recording.blocks()).events
}

/// A RAW file of this encoding, whatever it is called.
fn raw_writer(
    path: impl AsRef<Path>,
    encoding: Encoding,
    geometry: Geometry,
    options: &WriteOptions,
) -> Result<Writer, Error> {
    let mut options = options.clone();
    (options.encoding, options.format) = (Some(encoding), Some("raw".into()));
    Writer::create(path, Some(geometry), &options)
}
