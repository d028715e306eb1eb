//! The tool as users run it: processes, exit codes, output.
#![allow(clippy::unwrap_used)] // helpers of tests may too

mod clients;
mod convert;
mod demo;
mod hot_pixels;
mod info;
mod render;
mod tool;
