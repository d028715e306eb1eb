//! Deflate (filter 1): zlib streams.
//!
//! libdeflate has all of a stream in memory, as it is here, and is 1.6 times as fast as zlib-rs on columns that were not
//! shuffled; on shuffled ones they are alike (Sapphire Rapids, 2026-11).

use super::room;
use libdeflater::Decompressor;
use std::fmt;

/// A decompressor that is used again and again.
#[derive(Default)]
pub(super) struct Inflate(Option<Decompressor>);

impl fmt::Debug for Inflate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Inflate")
    }
}

impl Inflate {
    /// Decompresses a whole stream, to `max` bytes at most; to how many.
    pub fn undo(&mut self, input: &[u8], output: &mut Vec<u8>, max: usize) -> Option<usize> {
        self.fill(input, room(output, max))
    }

    /// Decompresses a whole stream into this memory; how many bytes that were.
    pub fn fill(&mut self, input: &[u8], output: &mut [u8]) -> Option<usize> {
        self.0.get_or_insert_with(Decompressor::new).zlib_decompress(input, output).ok()
    }
}
