//! The core's tests that need more than one module: laws that hold for every stage, and truth from outside.
#![allow(clippy::unwrap_used)] // helpers of tests are tests too

#[macro_use]
mod chunk_invariance;
mod augmentation;
mod filter;
#[cfg(feature = "link")]
mod link;
mod merge;
mod representation;
mod representation_oracles;
mod representation_stacks;
mod round_trip;
#[cfg(feature = "alloc")]
mod simulation;
mod slice;
mod sliding;
mod statistics;
mod streams;
mod tensor;
mod transform;
mod truth;
mod window;
mod wire;
