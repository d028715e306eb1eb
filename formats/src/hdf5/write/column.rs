//! A column being written: a chunked dataset of one dimension.

use super::CHUNK_ROWS;
use super::structure::Structures;
use crate::Error;
use crate::hdf5::filter::{Codec, Pack};
use crate::output::Output;

/// Type of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Element {
    U8,
    U16,
    U32,
    U64,
    I64,
}

impl Element {
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::U32 => 4,
            Self::U64 | Self::I64 => 8,
        }
    }
}

/// Where a chunk was written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chunk {
    pub address: u64,
    pub bytes: u32,
}

#[derive(Debug)]
pub(super) struct Column {
    pub element: Element,
    pub codec: Codec,
    pack: Pack,
    /// Of the chunk that is being filled.
    bytes: Vec<u8>,
    pub chunks: Vec<Chunk>,
    /// Rows of a chunk: known when the first is written.
    pub chunk_rows: usize,
    /// In chunks that are written.
    rows: u64,
}

impl Column {
    pub fn new(element: Element, codec: Codec) -> Self {
        let bytes = Vec::with_capacity(CHUNK_ROWS * element.bytes());
        Self {
            element,
            codec,
            pack: Pack::default(),
            bytes,
            chunks: Vec::new(),
            chunk_rows: CHUNK_ROWS,
            rows: 0,
        }
    }

    /// Adds numbers, which fit.
    pub fn extend(&mut self, numbers: impl IntoIterator<Item = u64>) {
        let width = self.element.bytes();
        for number in numbers {
            self.bytes.extend_from_slice(number.to_le_bytes().get(..width).unwrap_or_default());
        }
    }

    /// Rows that are not written yet.
    pub fn gathered(&self) -> usize {
        self.bytes.len() / self.element.bytes()
    }

    pub fn rows(&self) -> u64 {
        self.rows + self.gathered() as u64
    }

    /// Writes what was gathered as a chunk: of the length that every chunk has, which is that of the first.
    pub fn chunk(&mut self, output: &mut Output) -> Result<(), Error> {
        if self.chunks.is_empty() {
            self.chunk_rows = self.gathered();
        }
        self.rows += self.gathered() as u64;
        let width = self.element.bytes();
        self.bytes.resize(self.chunk_rows * width, 0);
        let packed = self.pack.pack(self.codec, &self.bytes, width);
        let packed = packed.ok_or_else(|| {
            let failed = std::io::Error::other("the compressor failed");
            Error::io(output.path(), "compressing it", failed)
        })?;
        self.chunks.push(Chunk { address: output.len(), bytes: packed.len() as u32 });
        output.write(packed)?;
        self.bytes.clear();
        Ok(())
    }

    /// Writes the rest and what describes the dataset; the address of that.
    pub fn finish(mut self, structures: &mut Structures) -> Result<u64, Error> {
        if !self.bytes.is_empty() {
            self.chunk(structures.output())?;
        }
        structures.dataset(&self)
    }
}
