//! What the statistics share: events are read and stay as they are.

use std::hint::black_box;

use lobula_core::Span;
use lobula_core::statistics::{EventRate, Intervals, PixelTimes, Tally};

use super::Op;
use crate::contest::{Contest, Protocol, Unit};
use crate::input::{Scene, packets};
use crate::peers::Library;

/// Length of a bin of the rate, in µs.
pub const BIN_US: u32 = 1_000;

/// The contests of the number of events in each bin of time.
///
/// # Errors
/// A sentence, where it cannot be made.
pub fn event_rate<'a>(
    op: Op,
    scene: &'a Scene,
    peer: Option<&'a dyn Library>,
) -> Result<Vec<Contest<'a>>, String> {
    let all = scene.span(scene.events.len());
    let bins = (all.t_last - all.t_first) / u64::from(BIN_US) + 2;
    let bins = usize::try_from(bins).map_err(|e| e.to_string())?;
    let make = move || {
        EventRate::try_new(scene.t_first, BIN_US.into(), vec![Tally::default(); bins])
            .map_err(|e| e.to_string())
    };
    let mut rate = make()?;
    let note = "bins of 1 ms, each polarity apart";
    Ok(vec![contest(op, scene, peer, note, move |span| {
        rate.push(span);
        black_box(&rate);
    })])
}

/// The contests of times between events of a pixel.
///
/// # Errors
/// A sentence, where it cannot be made.
pub fn intervals<'a>(
    op: Op,
    scene: &'a Scene,
    _: Option<&'a dyn Library>,
) -> Result<Vec<Contest<'a>>, String> {
    let pixels = vec![PixelTimes::default(); Intervals::<Vec<PixelTimes>>::state_len(scene.geometry)];
    let mut intervals = Intervals::try_new(scene.geometry, pixels).map_err(|e| e.to_string())?;
    let note = "of each pixel: first, last and number; of all: a histogram";
    Ok(vec![contest(op, scene, None, note, move |span| {
        let _ = intervals.push(span);
        black_box(&intervals);
    })])
}

/// The contest of `read`, which is given all events packet by packet.
fn contest<'a>(
    op: Op,
    scene: &'a Scene,
    peer: Option<&'a dyn Library>,
    note: &'static str,
    mut read: impl FnMut(Span<'_>) + 'a,
) -> Contest<'a> {
    let ours = move || {
        packets(scene.span(scene.events.len())).for_each(&mut read);
        scene.events.len() as u64
    };
    Contest {
        op: op.name(),
        kernel: "portable",
        protocol: Protocol::Stream,
        unit: Unit::Rate,
        events: scene.events.len(),
        expected: scene.events.len() as u64,
        ours: Box::new(ours),
        peers: peer.map_or_else(Vec::new, |peer| peer.ways(op, Protocol::Stream)),
        bar: Some(2.0),
        note,
    }
}
