//! One binary of end-to-end tests.

mod bits;
mod c_core;
mod firmware;
mod proof;
mod toolchain;
