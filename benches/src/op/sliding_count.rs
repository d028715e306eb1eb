//! Events to counts per pixel of windows of 33 ms, one each millisecond.

use lobula_core::representation::{Count, Overlap, Sliding};
use lobula_core::{Event, Grid, Piece, Representation, Slide, SlidingSlicer, Stride};

use super::Op;
use crate::contest::{Contest, Peer, Protocol, Unit, Work};
use crate::input::{Scene, packets};
use crate::peers::Library;

const GRID: Grid = Grid::Time { period_us: 33_000, stride_us: 1_000 };
/// More than a window of the scene has.
const EVENTS_MAX: usize = 1 << 20;

/// The operation's contests. No peer has it: each window drawn anew is in a peer's place.
///
/// # Errors
/// A sentence, where the grid is none.
pub fn contests<'a>(scene: &'a Scene, _: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let strides = GRID.strides().map_err(|e| e.to_string())?;
    let mut sliding = Sliding::new();
    let from_the_one_before = slid(scene, strides, move |count, slide, sum, out| {
        let _ = sliding.draw(count, slide, sum, out);
    });
    let anew = || {
        slid(scene, strides, |count, slide, _, out| {
            slide.pieces(Overlap::Anew, |piece| match piece {
                Piece::Begin(window) => count.begin(window, out),
                Piece::Events(span) => count.accumulate(span, out).unwrap_or_default(),
                Piece::End(_) => count.finish(out),
            });
        })
    };
    Ok(vec![Contest {
        op: Op::SlidingCount.name(),
        kernel: "auto",
        protocol: Protocol::Stream,
        unit: Unit::Rate,
        events: scene.events.len(),
        expected: anew()(),
        ours: from_the_one_before,
        peers: vec![Peer {
            name: "lobula-core, each window drawn anew".into(),
            work: anew(),
            expected: None,
        }],
        bar: Some(2.0),
        note: "windows of 33 ms, one each ms, u8; the same tensors",
    }])
}

/// All windows, each drawn by `draw` into the same memory. How many events they have and what the last one counts.
fn slid<'a>(
    scene: &'a Scene,
    strides: usize,
    mut draw: impl FnMut(&mut Count<u8>, &Slide<'_>, &mut [u8], &mut [u8]) + 'a,
) -> Work<'a> {
    let geometry = scene.geometry;
    let (mut strides, mut events) = (vec![Stride::default(); strides], vec![Event::default(); EVENTS_MAX]);
    let (mut sum, mut out) = (vec![0; geometry.pixels()], vec![0; geometry.pixels()]);
    Box::new(move || {
        let slicer = SlidingSlicer::try_new(GRID, geometry, &mut strides[..], &mut events[..]);
        let Ok(mut slicer) = slicer else { return 0 };
        let (mut count, mut drawn) = (Count::new(geometry), 0);
        let mut each = |slide: &Slide<'_>| {
            draw(&mut count, slide, &mut sum, &mut out);
            drawn += slide.len() as u64;
        };
        let all = scene.span(scene.events.len());
        for packet in packets(all) {
            let _ = slicer.push(packet, &mut each);
        }
        slicer.finish(all.t_last, &mut each);
        drawn + out.iter().copied().map(u64::from).sum::<u64>()
    })
}
