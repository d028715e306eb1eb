//! A synthetic event camera: a scene with known truth, as the bytes a camera would send.
//!
//! ```text
//!  SceneSpec ─▶ Scene (events of one loop, each with its Label) ─▶ Camera (EVT3 bytes, a packet per ms, for ever)
//! ```
//!
//! The scene is a loop: it is computed once, when it is made, and then replayed with its time moved on, so that a camera of
//! 30 Mev/s costs its source thread little more than a copy. Everything repeats with the loop's period, noise
//! included; since the loop follows from the spec alone, whoever has the spec has the [label](Label) of every event.
//!
//! All arithmetic is on integers, so that a spec gives the same bytes on every machine. Memory is the heap's: the
//! module needs feature `alloc`. The model of a pixel is that of a DVS: an event for each threshold that the
//! logarithm of intensity crosses (Lichtsteiner et al. 2008, 10.1109/JSSC.2007.914337); times between two rendered
//! frames are interpolated as in ESIM (Rebecq et al. 2018).

mod camera;
mod noise;
mod object;
mod pixels;
mod scene;
mod spec;
mod texture;

pub use camera::{Camera, CameraPacket};
pub use scene::{Label, LabelCounts, Scene};
pub use spec::{SceneSpec, SpecError};
