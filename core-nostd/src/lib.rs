//! # lobula-core
//!
//! The streaming core of Lobula: from the bytes of an event camera to filtered events and dense tensors, a packet at
//! a time, in memory that the caller brings. No heap, no clock, no I/O, no panic; the same bits on a microcontroller,
//! on the robot and offline.
//!
//! ```text
//!  &[u8] ─▶ wire (Decode) ─▶ Block ─▶ filter (Filter) ─▶ Block ─▶ window (Slicer) ─▶ representation ─▶ &mut [Pixel]
//! ```
//!
//! Features: `std` (CPU detection for SIMD kernels), `alloc` + `serde` (chains and views built from a Spec), `link`
//! (messages over a UART).
#![cfg_attr(not(any(test, feature = "std")), no_std)]

#[cfg(feature = "alloc")]
extern crate alloc;

mod block;
mod counters;
mod event;
mod geometry;
mod stage;
mod trigger;
mod unwrap;

pub mod link;
pub mod ring;
pub mod wire;

mod compact;
mod prefetch;
pub mod time_map;

pub mod filter;
pub mod transform;

pub mod augmentation;
pub mod merge;
mod random;
pub mod slice;

pub mod pipeline;

mod count_slicer;
pub mod math;
pub mod representation;
mod sliding_slicer;
pub mod statistics;
pub mod tensor;
pub mod vector;
mod window;

#[cfg(all(feature = "alloc", feature = "serde"))]
pub mod chain;

#[cfg(feature = "alloc")]
pub mod simulation;

pub use block::{Block, SPAN_MAX_US, Sink, Span, full_time};
pub use count_slicer::CountSlicer;
pub use counters::{Counters, Fault, Faults};
pub use event::{Event, Polarity};
pub use geometry::{Geometry, WrongGeometry};
pub use sliding_slicer::{BadGrid, Grid, Slide, SlidingSlicer, Stride};
pub use stage::{
    Decode, Detector, Encode, Encoded, Filter, Refused, Representation, Shape, Transform, Unfit, Window,
};
pub use trigger::Trigger;
pub use unwrap::Unwrap;
pub use window::{BadPeriod, Closed, Piece, Slicer};

pub use half::f16;
