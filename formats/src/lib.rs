//! # lobula-formats
//!
//! Recordings of event cameras on disk: probe, open, index, slice, write. Times are µs in 64 bits, coordinates have
//! their origin top left, and what a file does not tell is asked for, never guessed.
//!
//! ```text
//!  path ─▶ open (FORMATS: by content) ─▶ Recording ─▶ blocks, slice_time, slice_events ─▶ Chunk { block, triggers }
//!                                            ├─▶ payload: the camera's bytes as they came
//!                                            └─▶ Summary, Digest
//!  Span ─▶ RawWriter ─▶ path
//! ```
//!
//! A format is one module that implements `Container` and one line in [`FORMATS`]; blocks, index, slices and summary
//! come from that. Memory is bounded by [`Limits`] whatever the file says or how long it is.

mod container;
mod digest;
mod error;
mod index;
mod info;
mod input;
mod large;
mod limits;
mod open;
mod output;
mod raw;
mod recording;

pub use digest::Digest;
pub use error::{Error, ErrorKind};
pub use index::{Index, Times};
pub use info::{Summary, WithDigest};
pub use large::LargeArray;
pub use limits::Limits;
pub use open::{FORMATS, Format, OpenOptions, open, open_with};
pub use raw::{Payload, RawWriter, Rebase, WriteOptions, Written};
pub use recording::{Blocks, Chunk, Part, Recording};
