//! What makes a tensor the input of a detector: another size, and bytes. An event of these reports is an element.

use std::hint::black_box;

use lobula_core::Representation;
use lobula_core::tensor::{Method, Quantise, Resize, Size};

use super::tensor::{self, Tensor};
use super::{Op, time_surface};
use crate::contest::{Contest, Protocol, Unit, Work};
use crate::input::Scene;
use crate::peers::Library;

/// Width and height of the smaller tensor.
pub const SMALLER: (usize, usize) = (640, 360);

const NOTE_RESIZE: &str =
    "means of 2x2 of a time surface, same to 5e-4 as the surfaces are; both f32; ours into memory used again";

/// The contests of a time surface at half the resolution.
///
/// # Errors
/// A sentence, where the peer's tensor is another.
pub fn resize<'a>(
    op: Op,
    scene: &'a Scene,
    peer: Option<&'a dyn Library>,
) -> Result<Vec<Contest<'a>>, String> {
    let mut surface = time_surface::surface(scene)?;
    let (shape, size) = (surface.shape(), Size { width: SMALLER.0, height: SMALLER.1 });
    let resize = Resize::try_new(shape, size, Method::Area).map_err(|e| e.to_string())?;
    let input = tensor::build(scene, &mut surface);
    let mut out = vec![0.0f32; resize.shape().len()];
    resize.apply(&input, &mut out).map_err(|e| e.to_string())?;
    if let Some(peer) = peer {
        let alike = Tensor { op, bar_stream: 2.0, tolerance: 5e-4, note: NOTE_RESIZE };
        alike.same(0, &out, &peer.tensor(op))?;
    }
    let elements = input.len();
    let ours = Box::new(move || {
        let done = resize.apply(&input, &mut out);
        black_box(&out);
        done.map_or(0, |()| elements as u64)
    });
    Ok(vec![contest(op, elements, peer, NOTE_RESIZE, ours)])
}

/// The contests of a time surface in bytes.
///
/// # Errors
/// A sentence, where it cannot be made.
pub fn bytes<'a>(op: Op, scene: &'a Scene, _: Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String> {
    let input = tensor::build(scene, &mut time_surface::surface(scene)?);
    let (elements, mut out) = (input.len(), vec![0; input.len()]);
    let ours = Box::new(move || {
        let done = Quantise::to(1.0).apply(&input, &mut out);
        black_box(&out);
        done.map_or(0, |_| elements as u64)
    });
    Ok(vec![contest(op, elements, None, "of a time surface of f32; an element in place of an event", ours)])
}

fn contest<'a>(
    op: Op,
    elements: usize,
    peer: Option<&'a dyn Library>,
    note: &'static str,
    ours: Work<'a>,
) -> Contest<'a> {
    Contest {
        op: op.name(),
        kernel: "portable",
        protocol: Protocol::Stream,
        unit: Unit::Time,
        events: elements,
        expected: elements as u64,
        ours,
        peers: peer.map_or_else(Vec::new, |peer| peer.ways(op, Protocol::Stream)),
        bar: Some(2.0),
        note,
    }
}
