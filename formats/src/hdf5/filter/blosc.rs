//! Blosc 1 (filter 32001): blocks, each shuffled, cut into the planes of the shuffle, and compressed.
//!
//! Spec: <https://github.com/Blosc/c-blosc/blob/main/README_CHUNK_FORMAT.rst>
//!
//! ```text
//! version, version of the compressor, flags, bytes of an element; u32 bytes, u32 bytes of a block, u32 stored bytes
//! flags: 1 shuffle, 2 not compressed, 4 bit shuffle, 16 blocks are not cut, 5..7 compressor
//! for each block: u32 offset from the start of all this
//! there, for each of its parts: u32 stored bytes, then these; as many as the part has means not compressed
//! ```

use super::deflate::Inflate;
use super::zstd::Zstd;
use super::{blosclz, lz4, room, shuffle};

/// Bytes of the header.
const HEADER_BYTES: usize = 16;
/// Largest elements of which blocks are cut, and the least elements in a block that is.
const CUT: (usize, usize) = (16, 128);

struct Header {
    flags: u8,
    element: usize,
    bytes: usize,
    block: usize,
}

impl Header {
    fn parse(input: &[u8]) -> Option<Self> {
        let head: &[u8; HEADER_BYTES] = input.first_chunk()?;
        let [_, _, flags, element, rest @ ..] = head;
        let word = |at: usize| Some(u32::from_le_bytes(*rest.get(at..)?.first_chunk()?) as usize);
        let (bytes, block) = (word(0)?, word(4)?);
        Some(Self { flags: *flags, element: (*element).into(), bytes, block })
    }

    fn is_stored(&self) -> bool {
        self.flags & 2 != 0
    }

    /// Parts of a block of this many bytes.
    fn parts(&self, bytes: usize) -> usize {
        let (element_max, elements_min) = CUT;
        let whole = bytes == self.block && self.flags & 16 == 0;
        let cut = whole && (1..=element_max).contains(&self.element) && bytes / self.element >= elements_min;
        if cut { self.element } else { 1 }
    }
}

pub(super) fn undo(
    input: &[u8],
    output: &mut Vec<u8>,
    max: usize,
    scratch: &mut Vec<u8>,
    inflate: &mut Inflate,
    zstd: &mut Zstd,
) -> Option<usize> {
    let header = Header::parse(input)?;
    if header.bytes > max {
        return None;
    }
    if header.is_stored() {
        output.clear();
        output.extend_from_slice(input.get(HEADER_BYTES..)?.get(..header.bytes)?);
        return Some(header.bytes);
    }
    let output = room(output, header.bytes);
    let scratch = room(scratch, header.block.min(header.bytes));
    let mut codec = Codec { compressor: header.flags >> 5, inflate, zstd };
    for (i, block) in output.chunks_mut(header.block.max(1)).enumerate() {
        let offset = input.get(HEADER_BYTES + 4 * i..)?.first_chunk()?;
        let from = input.get(u32::from_le_bytes(*offset) as usize..)?;
        let shuffled = scratch.get_mut(..block.len())?;
        match header.flags & 5 {
            1 if header.element > 1 => {
                codec.block(from, shuffled, &header)?;
                shuffle::unshuffle(shuffled, block, header.element);
            }
            4 if block.len() >= header.element => {
                codec.block(from, shuffled, &header)?;
                unshuffle_bits(shuffled, block, header.element.max(1));
            }
            _ => codec.block(from, block, &header)?,
        }
    }
    Some(header.bytes)
}

struct Codec<'a> {
    compressor: u8,
    inflate: &'a mut Inflate,
    zstd: &'a mut Zstd,
}

impl Codec<'_> {
    /// Decompresses the parts of a block.
    fn block(&mut self, mut from: &[u8], to: &mut [u8], header: &Header) -> Option<()> {
        let part = (to.len() / header.parts(to.len())).max(1);
        for part in to.chunks_mut(part) {
            let stored = u32::from_le_bytes(*from.split_off(..4)?.first_chunk()?) as usize;
            self.part(from.split_off(..stored)?, part)?;
        }
        Some(())
    }

    fn part(&mut self, from: &[u8], to: &mut [u8]) -> Option<()> {
        if from.len() == to.len() {
            to.copy_from_slice(from);
            return Some(());
        }
        let len = match self.compressor {
            0 => {
                let mut bytes = Vec::with_capacity(to.len());
                blosclz::undo(from, &mut bytes, to.len())?;
                to.get_mut(..bytes.len())?.copy_from_slice(&bytes);
                bytes.len()
            }
            1 => return lz4::fill(from, to),
            3 => self.inflate.fill(from, to)?,
            4 => self.zstd.fill(from, to)?,
            _ => return None,
        };
        (len == to.len()).then_some(())
    }
}

/// Undoes the shuffle of bits: first the lowest bits of the first bytes of all elements, eight to a byte, and so on.
/// It is not done where elements make no whole bytes; what is over makes none either.
fn unshuffle_bits(input: &[u8], output: &mut [u8], element: usize) {
    let count = input.len() / element;
    let whole = if count.is_multiple_of(8) { count * element } else { 0 };
    let (planes, rest) = input.split_at(whole);
    let (elements, over) = output.split_at_mut(whole);
    over.copy_from_slice(rest);
    for (group, elements) in elements.chunks_exact_mut(8 * element).enumerate() {
        for byte in 0..element {
            let bits: [u8; 8] = std::array::from_fn(|bit| {
                planes.get((byte * 8 + bit) * (count / 8) + group).copied().unwrap_or_default()
            });
            for (i, byte) in elements.iter_mut().skip(byte).step_by(element).enumerate() {
                *byte = (0..8).fold(0, |sum, bit| sum | (bits[bit] >> i & 1) << bit);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_by_plane() {
        // Eight elements of one byte, of which the third has the bits 0 and 7.
        let mut output = [0; 8];
        unshuffle_bits(&[4, 0, 0, 0, 0, 0, 0, 4], &mut output, 1);
        assert_eq!(output, [0, 0, 0x81, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn headers_that_lie() {
        let undone = |input: &[u8]| {
            let (inflate, zstd) = (&mut Inflate::default(), &mut Zstd::default());
            undo(input, &mut Vec::new(), 1000, &mut Vec::new(), inflate, zstd)
        };
        assert_eq!(undone(&[2, 1, 2, 1, 5, 0, 0, 0, 5, 0, 0, 0, 21, 0, 0, 0]), None, "cut short");
        assert_eq!(undone(&[2, 1, 1, 2, 255, 255, 255, 255, 0, 0, 0, 0, 0, 0, 0, 0]), None, "a bomb");
        assert_eq!(undone(&[2, 1, 1, 2, 200, 0, 0, 0, 0, 0, 0, 0, 16, 0, 0, 0]), None, "blocks of nothing");
    }
}
