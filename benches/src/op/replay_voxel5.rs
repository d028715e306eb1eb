//! A recording replayed: EVT3 bytes to a voxel grid of 5 bins for each millisecond.

use std::hint::black_box;

use lobula_core::chain::{Offline, View, ViewSpec};
use lobula_core::representation::Kind;
use lobula_core::wire::evt3::Decoder;
use lobula_core::{Closed, Decode, Event, Sink};

use super::Op;
use super::voxel5::BINS;
use crate::contest::{Contest, Protocol, Unit, Work};
use crate::input::{PACKET_EVENTS, Scene};
use crate::peers::Library;

/// Length of a window in µs.
pub const PERIOD_US: u32 = 1_000;

/// The operation's contests.
///
/// # Errors
/// A sentence, where the view cannot be made.
pub fn contests<'a>(scene: &'a Scene, peer: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    Ok(vec![Contest {
        op: Op::ReplayVoxel5.name(),
        kernel: "auto",
        protocol: Protocol::Stream,
        unit: Unit::Rate,
        events: scene.events.len(),
        expected: scene.events.len() as u64,
        ours: replay(scene)?,
        peers: peer.map_or_else(Vec::new, |peer| peer.ways(Op::ReplayVoxel5, Protocol::Stream)),
        bar: Some(2.0),
        note: "bytes to a grid a millisecond; ours: one tensor, erased where it was drawn; peer: a fresh one each",
    }])
}

fn replay(scene: &Scene) -> Result<Work<'_>, String> {
    let spec = ViewSpec { bins: Some(BINS), ..ViewSpec::new(Op::ReplayVoxel5.name(), Kind::VoxelGrid, PERIOD_US) };
    let view = move || View::try_new(&spec, scene.geometry).map_err(|e| e.to_string());
    let len_bytes = view()?.len_bytes();
    let mut buffer = vec![Event::default(); PACKET_EVENTS];
    Ok(Box::new(move || {
        let Ok(mut view) = view() else { return 0 };
        let mut events = 0;
        let mut canvas = Offline::new(len_bytes, |closed: Closed, tensor: &[u8]| {
            events += closed.events;
            black_box(tensor);
        });
        let mut decoder = Decoder::new(scene.geometry);
        let mut rest = &scene.bytes[..];
        while !rest.is_empty() {
            let mut sink = Sink::new(&mut buffer);
            let taken = decoder.decode(rest, &mut sink);
            let _ = view.push(sink.block(scene.geometry).span(), &mut canvas);
            rest = &rest[taken..];
        }
        let _ = view.finish(decoder.now(), &mut canvas);
        events
    }))
}
