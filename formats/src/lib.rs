//! # lobula-formats
//!
//! Recordings of event cameras on disk: probe, open, index, slice, write. Times are µs in 64 bits, coordinates have
//! their origin top left, and what a file does not tell is asked for, never guessed.
//!
//! ```text
//!  path ─▶ open (FORMATS: by content) ─▶ Recording ─▶ blocks, slice_time, slice_events ─▶ Chunk { block, triggers }
//!                                            ├─▶ payload: the camera's bytes as they came
//!                                            ├─▶ imu, frames: the other streams
//!                                            ├─▶ load: all in memory, on all cores
//!                                            └─▶ Summary, Check, Digest, HotPixels
//!  Span, Chunk, ImuSample, Frame ─▶ Writer (FORMATS: by extension) ─▶ path
//! ```
//!
//! A format is one module that implements `Container`, and `Encoder` where it is written, and one line in [`FORMATS`];
//! blocks, index, slices, summary, rebasing and checks come from that. Memory is bounded by [`Limits`] whatever the
//! file says or how long it is.

#![cfg_attr(
    not(all(feature = "aedat4", feature = "hdf5", feature = "ros", feature = "tables")),
    allow(dead_code, reason = "what families share is more than a build with few of them needs")
)]

mod aedat2;
#[cfg(feature = "aedat4")]
mod aedat31;
#[cfg(feature = "aedat4")]
mod aedat4;
mod aer_header;
mod byte_cursor;
mod check;
mod container;
mod copy;
mod dat;
#[cfg(feature = "ros")]
mod db3;
mod digest;
mod error;
mod es;
#[cfg(feature = "hdf5")]
mod hdf5;
mod hot_pixels;
mod index;
mod info;
mod input;
mod intake;
mod large;
mod limits;
mod load;
#[cfg(feature = "ros")]
mod mcap;
#[cfg(feature = "tables")]
mod names;
mod nmnist;
#[cfg(feature = "tables")]
mod numpy;
mod open;
mod output;
#[cfg(feature = "tables")]
mod packed;
#[cfg(feature = "aedat4")]
mod packets;
mod raw;
mod recording;
#[cfg(feature = "ros")]
mod ros;
#[cfg(feature = "ros")]
mod rosbag;
mod stream;
#[cfg(test)]
#[cfg(feature = "tables")]
mod testing;
#[cfg(feature = "tables")]
mod text;
mod wrap;
mod write;

pub use check::Check;
pub use copy::{Copied, CopyOptions, CopyPart, copy};
pub use digest::Digest;
pub use error::{Error, ErrorKind};
pub use hot_pixels::{HotPixels, LearnedHotPixels};
pub use index::{Index, Times};
pub use info::{Summary, WithDigest};
pub use large::LargeArray;
pub use limits::Limits;
pub use load::Loaded;
#[cfg(feature = "tables")]
pub use numpy::TensorWriter;
pub use open::{Column, Columns, FORMATS, Format, OpenOptions, TimeUnit, open, open_with};
pub use raw::Payload;
pub use recording::{Blocks, Chunk, Part, Recording};
pub use stream::{Frame, ImuSample, PixelFormat, Stream, StreamKind};
pub use write::{Compression, LeftOut, Rebase, WriteOptions, Writer, Written};
