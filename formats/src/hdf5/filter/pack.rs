//! The filters that we write with: shuffle, then a compressor.

use super::shuffle;
use libdeflater::{CompressionLvl, Compressor};
use std::fmt;

/// A compressor to write with; elements of more than one byte are shuffled before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::hdf5) enum Codec {
    None,
    Gzip,
    Lz4,
    Zstd,
}

/// Memory to compress with, used again and again.
#[derive(Default)]
pub(in crate::hdf5) struct Pack {
    shuffled: Vec<u8>,
    packed: Vec<u8>,
    deflate: Option<Compressor>,
    zstd: Option<zstd::bulk::Compressor<'static>>,
}

impl fmt::Debug for Pack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Pack")
    }
}

impl Pack {
    /// Compresses a chunk of elements of this many bytes; `None` where the compressor fails, for want of memory.
    pub fn pack<'a>(&'a mut self, codec: Codec, chunk: &'a [u8], element: usize) -> Option<&'a [u8]> {
        if codec == Codec::None {
            return Some(chunk);
        }
        let mut from = chunk;
        if element > 1 {
            shuffle::shuffle(chunk, &mut self.shuffled, element);
            from = &self.shuffled;
        }
        self.packed.clear();
        match codec {
            Codec::None => {}
            Codec::Gzip => {
                let level = || Compressor::new(CompressionLvl::default());
                deflate_to(self.deflate.get_or_insert_with(level), from, &mut self.packed)?;
            }
            Codec::Lz4 => lz4_to(from, &mut self.packed),
            Codec::Zstd => {
                if self.zstd.is_none() {
                    self.zstd = zstd::bulk::Compressor::new(3).ok();
                }
                self.packed = self.zstd.as_mut()?.compress(from).ok()?;
            }
        }
        Some(&self.packed)
    }
}

fn deflate_to(deflate: &mut Compressor, from: &[u8], to: &mut Vec<u8>) -> Option<()> {
    to.resize(deflate.zlib_compress_bound(from.len()), 0);
    let len = deflate.zlib_compress(from, to).ok()?;
    to.truncate(len);
    Some(())
}

/// One block, in the frame that `lz4` tells.
fn lz4_to(from: &[u8], to: &mut Vec<u8>) {
    to.extend_from_slice(&(from.len() as u64).to_be_bytes());
    to.extend_from_slice(&(from.len() as u32).to_be_bytes());
    let packed = lz4_flex::block::compress(from);
    let stored = if packed.len() < from.len() { packed.as_slice() } else { from };
    to.extend_from_slice(&(stored.len() as u32).to_be_bytes());
    to.extend_from_slice(stored);
}
