//! Deflate (filter 1): zlib streams.

use flate2::{Decompress, FlushDecompress, Status};
use std::fmt;

/// A decompressor that is used again and again.
#[derive(Default)]
pub(super) struct Inflate(Option<Decompress>);

impl fmt::Debug for Inflate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Inflate")
    }
}

impl Inflate {
    /// Decompresses a whole stream, to `max` bytes at most.
    pub fn undo(&mut self, input: &[u8], output: &mut Vec<u8>, max: usize) -> Option<()> {
        output.resize(max, 0);
        let len = self.fill(input, output)?;
        output.truncate(len);
        Some(())
    }

    /// Decompresses a whole stream into this memory; how many bytes that were.
    pub fn fill(&mut self, input: &[u8], output: &mut [u8]) -> Option<usize> {
        let inflate = self.0.get_or_insert_with(|| Decompress::new(true));
        inflate.reset(true);
        let status = inflate.decompress(input, output, FlushDecompress::Finish).ok()?;
        (status == Status::StreamEnd).then_some(inflate.total_out() as usize)
    }
}
