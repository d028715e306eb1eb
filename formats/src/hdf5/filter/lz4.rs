//! LZ4 (filter 32004): blocks of LZ4, each with its length.
//!
//! ```text
//! bytes of the chunk: u64, bytes of a block: u32, both big-endian
//! for each block: stored bytes u32 big-endian, then these; as many as a block has means not compressed
//! ```

use super::room;

pub(super) fn undo(input: &[u8], output: &mut Vec<u8>, max: usize) -> Option<usize> {
    let mut rest = input;
    let total = u64::from_be_bytes(*rest.split_off(..8)?.first_chunk()?);
    let block = u32::from_be_bytes(*rest.split_off(..4)?.first_chunk()?) as usize;
    let total = usize::try_from(total).ok().filter(|total| *total <= max)?;
    for to in room(output, total).chunks_mut(block.max(1)) {
        let stored = u32::from_be_bytes(*rest.split_off(..4)?.first_chunk()?) as usize;
        fill(rest.split_off(..stored)?, to)?;
    }
    Some(total)
}

/// Decompresses or copies a block into memory of its length.
pub(super) fn fill(from: &[u8], to: &mut [u8]) -> Option<()> {
    if from.len() == to.len() {
        to.copy_from_slice(from);
        return Some(());
    }
    let len = lz4_flex::block::decompress_into(from, to).ok()?;
    (len == to.len()).then_some(())
}
