//! Where the chunks of a dataset are: every kind of index of them.
//!
//! Spec: sections III.A (trees), VII.A to VII.D (single chunk, implicit, fixed array, extensible array)

use super::fields::{Fields, UNDEFINED};
use super::file::File;
use super::tree::{self, OldNode};
use crate::Error;

mod array;

/// How a dataset is cut into chunks, and what finds them.
#[derive(Clone, Debug)]
pub(super) struct Chunking {
    /// Elements of a chunk in each dimension.
    pub sides: Vec<u64>,
    /// Bytes of a chunk, before filters.
    pub bytes: u64,
    index: Index,
}

#[derive(Clone, Debug)]
enum Index {
    OldTree { root: u64 },
    Single { address: u64, stored: Option<(u64, u32)> },
    Implicit { address: u64 },
    FixedArray { header: u64 },
    ExtensibleArray { header: u64 },
    NewTree { header: u64 },
}

/// A chunk in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Chunk {
    /// Its place in the grid, counted along the last dimension first.
    pub number: u64,
    pub address: u64,
    /// Bytes as stored.
    pub bytes: u32,
    /// A bit for each filter that was left out.
    pub mask: u32,
}

impl Chunking {
    pub fn parse(mut fields: Fields<'_>, version: u8) -> Option<Self> {
        let flags = if version > 3 { fields.u8()? } else { 0 };
        let rank = usize::from(fields.u8()?).checked_sub(1)?;
        if version == 3 {
            let root = fields.address()?;
            let sides = (0..=rank).map(|_| fields.u32().map(u64::from)).collect::<Option<_>>()?;
            return Self::new(sides, Index::OldTree { root });
        }
        let width = usize::from(fields.u8()?);
        let sides = (0..=rank).map(|_| fields.number(width)).collect::<Option<_>>()?;
        let index = match fields.u8()? {
            1 => {
                let stored = if flags & 2 != 0 { Some((fields.length()?, fields.u32()?)) } else { None };
                Index::Single { address: fields.address()?, stored }
            }
            2 => Index::Implicit { address: fields.address()? },
            3 => {
                fields.skip(1)?;
                Index::FixedArray { header: fields.address()? }
            }
            4 => {
                fields.skip(5)?;
                Index::ExtensibleArray { header: fields.address()? }
            }
            5 => {
                fields.skip(6)?;
                Index::NewTree { header: fields.address()? }
            }
            _ => return None,
        };
        Self::new(sides, index)
    }

    /// The last side is that of the element, in bytes.
    fn new(mut sides: Vec<u64>, index: Index) -> Option<Self> {
        let bytes = sides.iter().try_fold(1u64, |product, side| product.checked_mul(*side))?;
        sides.pop()?;
        (bytes > 0).then_some(Self { sides, bytes, index })
    }
}

/// The grid of a dataset's chunks.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    /// Chunks in each dimension.
    counts: Vec<u64>,
    sides: Vec<u64>,
}

impl Grid {
    pub fn new(dimensions: &[u64], chunking: &Chunking) -> Self {
        let count = |(length, side): (&u64, &u64)| length.div_ceil((*side).max(1));
        let counts = dimensions.iter().zip(&chunking.sides).map(count).collect();
        Self { counts, sides: chunking.sides.clone() }
    }

    /// Number of chunks.
    fn total(&self) -> u64 {
        self.counts.iter().fold(1, |product, count| product.saturating_mul(*count))
    }

    /// Number of the chunk at these places, counted in chunks.
    fn number(&self, places: impl Iterator<Item = u64>) -> Option<u64> {
        let mut number = 0u64;
        for (place, count) in places.zip(&self.counts) {
            if place >= *count {
                return None;
            }
            number = number.checked_mul(*count)?.checked_add(place)?;
        }
        Some(number)
    }
}

/// The chunks that are in the file, in the order of their numbers.
pub(super) fn chunks(
    file: &File,
    chunking: &Chunking,
    grid: &Grid,
    filtered: bool,
) -> Result<Vec<Chunk>, Error> {
    let width = Width::of(chunking, filtered);
    let mut chunks = match chunking.index {
        Index::OldTree { root } => old_tree(file, root, grid)?,
        Index::Single { address, stored } => single(file, address, stored, chunking)?,
        Index::Implicit { address } => implicit(file, address, chunking, grid),
        Index::FixedArray { header } => array::fixed(file, header, grid.total(), width)?,
        Index::ExtensibleArray { header } => array::extensible(file, header, grid.total(), width)?,
        Index::NewTree { header } => new_tree(file, header, grid, width)?,
    };
    chunks.retain(|chunk| chunk.address != UNDEFINED);
    chunks.sort_unstable_by_key(|chunk| chunk.number);
    chunks.dedup_by_key(|chunk| chunk.number);
    Ok(chunks)
}

/// What an entry of a new index says beside the address.
#[derive(Clone, Copy, Debug)]
struct Width {
    chunk_bytes: u32,
    /// Bytes of the size; none where chunks have no filters, and so their own size.
    size: Option<usize>,
}

impl Width {
    fn of(chunking: &Chunking, filtered: bool) -> Self {
        let bits = chunking.bytes.max(1).ilog2() as usize;
        let chunk_bytes = u32::try_from(chunking.bytes).unwrap_or(u32::MAX);
        Self { chunk_bytes, size: filtered.then(|| (1 + (bits + 8) / 8).min(8)) }
    }

    fn entry(self, fields: &mut Fields<'_>, number: u64) -> Option<Chunk> {
        let address = fields.address()?;
        let Some(size) = self.size else {
            return Some(Chunk { number, address, bytes: self.chunk_bytes, mask: 0 });
        };
        let bytes = u32::try_from(fields.number(size)?).unwrap_or(u32::MAX);
        Some(Chunk { number, address, bytes, mask: fields.u32()? })
    }
}

fn old_tree(file: &File, root: u64, grid: &Grid) -> Result<Vec<Chunk>, Error> {
    let (mut chunks, mut nodes) = (Vec::new(), vec![root]);
    if root == UNDEFINED {
        return Ok(chunks);
    }
    let key_bytes = 8 + 8 * (grid.sides.len() + 1);
    while let Some(address) = nodes.pop() {
        let malformed = || file.malformed("tree of chunks", address);
        let node = OldNode::read(file, "tree of chunks", address, 1, key_bytes)?;
        if node.level > 0 {
            nodes.extend(node.entries.iter().map(|entry| entry.child));
            continue;
        }
        for entry in &node.entries {
            let mut key = file.fields(&entry.key);
            let sizes = key.u32().zip(key.u32());
            let (bytes, mask) = sizes.ok_or_else(malformed)?;
            let places = grid.sides.iter().map(|side| key.u64().unwrap_or(u64::MAX) / (*side).max(1));
            // Chunks beyond the dataset's end are left from when it was longer.
            let Some(number) = grid.number(places) else { continue };
            chunks.push(Chunk { number, address: entry.child, bytes, mask });
        }
    }
    Ok(chunks)
}

fn single(
    file: &File,
    address: u64,
    stored: Option<(u64, u32)>,
    chunking: &Chunking,
) -> Result<Vec<Chunk>, Error> {
    let (bytes, mask) = stored.unwrap_or((chunking.bytes, 0));
    let bytes = u32::try_from(bytes).map_err(|_| file.malformed("chunk", address))?;
    Ok(vec![Chunk { number: 0, address, bytes, mask }])
}

/// One after the other, as far as the file goes.
fn implicit(file: &File, address: u64, chunking: &Chunking, grid: &Grid) -> Vec<Chunk> {
    let start = file.offset(address).unwrap_or(u64::MAX);
    let there = file.input.len().saturating_sub(start).div_ceil(chunking.bytes.max(1));
    let bytes = u32::try_from(chunking.bytes).unwrap_or(u32::MAX);
    let chunk = |number| {
        let address = address.saturating_add(chunking.bytes.saturating_mul(number));
        Chunk { number, address, bytes, mask: 0 }
    };
    (0..grid.total().min(there)).map(chunk).collect()
}

fn new_tree(file: &File, header: u64, grid: &Grid, width: Width) -> Result<Vec<Chunk>, Error> {
    if header == UNDEFINED {
        return Ok(Vec::new());
    }
    let mut chunks = Vec::new();
    for record in tree::records(file, header)? {
        let mut fields = file.fields(&record);
        let chunk = width.entry(&mut fields, 0).ok_or_else(|| file.malformed("tree of chunks", header))?;
        let places = grid.counts.iter().map(|_| fields.u64().unwrap_or(u64::MAX));
        chunks.extend(grid.number(places).map(|number| Chunk { number, ..chunk }));
    }
    Ok(chunks)
}
