//! The daemon with real clients: in threads where nobody dies, in processes where somebody does.
#![allow(clippy::unwrap_used)] // what helpers of tests unwrap says more by failing there

mod kill;
mod pipeline;
mod refuse;
mod stage;
