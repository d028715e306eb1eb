//! Zstandard (filter 32015): one frame a chunk.

use super::room;
use std::fmt;
use zstd::bulk::Decompressor;

/// A decompressor that is used again and again.
#[derive(Default)]
pub(super) struct Zstd(Option<Decompressor<'static>>);

impl fmt::Debug for Zstd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Zstd")
    }
}

impl Zstd {
    /// Decompresses a frame, to `max` bytes at most; to how many.
    pub fn undo(&mut self, input: &[u8], output: &mut Vec<u8>, max: usize) -> Option<usize> {
        self.fill(input, room(output, max))
    }

    /// Decompresses a frame into this memory; how many bytes that were.
    pub fn fill(&mut self, input: &[u8], output: &mut [u8]) -> Option<usize> {
        if self.0.is_none() {
            self.0 = Decompressor::new().ok();
        }
        self.0.as_mut()?.decompress_to_buffer(input, output).ok()
    }
}
