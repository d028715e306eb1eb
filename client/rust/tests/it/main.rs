//! The client against daemons that are not what they should be. Real ones are met in the daemon's tests.
#![allow(clippy::unwrap_used)] // what helpers of tests unwrap says more by failing there

mod control;
