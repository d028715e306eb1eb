//! What the operations that build a tensor share. Tensors and maps are plain `Vec`s, as in the chain and for its users:
//! no large pages on our side that the peer does not have.

use std::hint::black_box;

use bytemuck::Zeroable;
use lobula_core::Representation;
use lobula_core::representation::{Build, Parameters};
use lobula_core::tensor::Element;

use super::Op;
use crate::contest::{Contest, Protocol, Unit, Work};
use crate::input::{Scene, packets};
use crate::peers::Library;

/// The contests of a representation in its defaults, which no peer has.
///
/// # Errors
/// A sentence, where it cannot be made.
pub fn of_defaults<'a, R>(
    op: Op,
    scene: &'a Scene,
    _: Option<&'a dyn Library>,
) -> Result<Vec<Contest<'a>>, String>
where
    R: Build<Vec<u32>> + 'static,
    R::Pixel: Element,
{
    let parameters = Parameters::default();
    let make =
        move || R::build(&parameters, scene.geometry, vec![0; R::state_len(&parameters, scene.geometry)]);
    make().map_err(|e| e.to_string())?;
    #[allow(clippy::expect_used)] // it was made above
    let make = move || make().expect("made above");
    Tensor { op, bar_stream: 2.0, tolerance: 0.0, note: "with the settings that are its defaults" }
        .contests(scene, None, make)
}

/// An operation that builds a tensor.
pub struct Tensor {
    /// Which.
    pub op: Op,
    /// How much faster `stream` shall be; `whole` twice.
    pub bar_stream: f64,
    /// How far an element may be from the peer's.
    pub tolerance: f32,
    /// How the two sides differ in what they do.
    pub note: &'static str,
}

impl Tensor {
    /// The operation's contests, where `make` makes our representation.
    ///
    /// # Errors
    /// A sentence, where the peer builds another tensor.
    pub fn contests<'a, R>(
        &self,
        scene: &'a Scene,
        peer: Option<&'a dyn Library>,
        make: impl Fn() -> R + Copy + 'a,
    ) -> Result<Vec<Contest<'a>>, String>
    where
        R: Representation + 'a,
        R::Pixel: Element,
    {
        self.contests_but(0, scene, peer, make)
    }

    /// The same, where up to `outliers` elements may be any.
    ///
    /// # Errors
    /// A sentence, where the peer builds another tensor.
    pub fn contests_but<'a, R>(
        &self,
        outliers: usize,
        scene: &'a Scene,
        peer: Option<&'a dyn Library>,
        make: impl Fn() -> R + Copy + 'a,
    ) -> Result<Vec<Contest<'a>>, String>
    where
        R: Representation + 'a,
        R::Pixel: Element,
    {
        if let Some(peer) = peer {
            // Empty where it has no such tensor.
            let theirs = Some(peer.tensor(self.op)).filter(|tensor| !tensor.is_empty());
            theirs.map_or(Ok(()), |theirs| self.same(outliers, &build(scene, &mut make()), &theirs))?;
        }
        let contest = |protocol, ours, bar| Contest {
            op: self.op.name(),
            kernel: "portable",
            protocol,
            unit: Unit::Time,
            events: scene.tensor_events,
            expected: scene.tensor_events as u64,
            ours,
            peers: peer.map_or_else(Vec::new, |peer| peer.ways(self.op, protocol)),
            bar: Some(bar),
            note: self.note,
        };
        Ok(vec![
            contest(Protocol::Whole, whole(scene, make), 2.0),
            contest(Protocol::Stream, stream(scene, make()), self.bar_stream),
        ])
    }

    /// Refuses tensors of which more than `outliers` elements are not the peer's, or as much of it as ours can hold.
    ///
    /// # Errors
    /// A sentence.
    pub fn same<P: Element>(&self, outliers: usize, ours: &[P], theirs: &[f32]) -> Result<(), String> {
        if ours.len() != theirs.len() {
            return Err(format!("{}: ours {} elements, theirs {}", self.op.name(), ours.len(), theirs.len()));
        }
        let most = P::from_real(f32::INFINITY).real();
        let far = |at: &usize| (ours[*at].real() - theirs[*at].min(most)).abs() > self.tolerance;
        let differ = (0..ours.len()).filter(far).count();
        let first = (0..ours.len()).find(far).filter(|_| differ > outliers);
        first.map_or(Ok(()), |i| {
            Err(format!(
                "{}: {differ} elements differ, the first {i}: ours {}, theirs {}",
                self.op.name(),
                ours[i].real(),
                theirs[i]
            ))
        })
    }
}

/// A fresh tensor of the scene's events, packet by packet.
pub fn build<R: Representation>(scene: &Scene, representation: &mut R) -> Vec<R::Pixel> {
    let mut out = fresh(representation);
    fill(scene, representation, &mut out);
    out
}

/// Memory for a tensor.
fn fresh<R: Representation>(representation: &R) -> Vec<R::Pixel> {
    vec![R::Pixel::zeroed(); representation.shape().len()]
}

/// Fills `out` and returns how many events went into it.
fn fill<R: Representation>(scene: &Scene, representation: &mut R, out: &mut [R::Pixel]) -> u64 {
    let mut events = 0;
    representation.begin(scene.tensor_window, out);
    for packet in packets(scene.span(scene.tensor_events)) {
        if representation.accumulate(packet, out).is_ok() {
            events += packet.events.len() as u64;
        }
    }
    representation.finish(out);
    events
}

/// All events at once, into a fresh tensor with fresh state.
fn whole<'a, R: Representation>(scene: &'a Scene, make: impl Fn() -> R + 'a) -> Work<'a> {
    Box::new(move || {
        let mut representation = make();
        let mut out = fresh(&representation);
        let span = scene.span(scene.tensor_events);
        representation.begin(scene.tensor_window, &mut out);
        let done = representation.accumulate(span, &mut out);
        representation.finish(&mut out);
        black_box(out);
        done.map_or(0, |()| span.events.len() as u64)
    })
}

/// A packet at a time, into a tensor and state used again.
fn stream<'a, R: Representation + 'a>(scene: &'a Scene, mut representation: R) -> Work<'a> {
    let mut out = build(scene, &mut representation);
    Box::new(move || {
        let events = fill(scene, &mut representation, &mut out);
        black_box(&out);
        events
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_is_what_our_elements_can_hold_of_the_peers() {
        let op = Tensor { op: Op::Count, bar_stream: 1.0, tolerance: 0.0, note: "" };
        assert_eq!(op.same(0, &[255u8, 3], &[300.0, 3.0]), Ok(()));
        assert!(op.same(0, &[254u8, 3], &[300.0, 3.0]).is_err());
        assert!(op.same(0, &[255.0f32, 3.0], &[300.0, 3.0]).is_err());
        assert_eq!(op.same(1, &[254u8, 3], &[300.0, 3.0]), Ok(()));
        assert!(op.same(1, &[255u8], &[255.0, 0.0]).is_err());
    }
}
