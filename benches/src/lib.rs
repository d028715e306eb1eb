//! What the benches share: inputs, clocks, the operations measured and the same work done by peers.
//!
//! ```text
//!  input (recording repeated in time) ─▶ op (ours) ┐
//!                                      ─▶ peers    ┴▶ contest (in turn, one core, CPU time) ─▶ report
//! ```

pub mod clock;
pub mod contest;
pub mod input;
pub mod instructions;
pub mod op;
pub mod peers;
pub mod wire;
