//! One binary of end-to-end tests.
#![allow(clippy::unwrap_used)] // helpers of tests are tests too

mod bits;
mod c_core;
mod firmware;
mod neon;
mod proof;
mod toolchain;
