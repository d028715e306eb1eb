//! Arrays of chunks by number: fixed, for datasets that do not grow, and extensible, for those that do.

use super::{Chunk, Width};
use crate::Error;
use crate::hdf5::fields::{Fields, UNDEFINED};
use crate::hdf5::file::File;

/// Chunks of a fixed array.
pub(super) fn fixed(file: &File, header: u64, total: u64, width: Width) -> Result<Vec<Chunk>, Error> {
    if header == UNDEFINED {
        return Ok(Vec::new());
    }
    let malformed = || file.malformed("array of chunks", header);
    let bytes = file.bytes_up_to(header, 64)?;
    let mut fields = file.fields(&bytes);
    let parsed = (|| {
        fields.signature(b"FAHD")?;
        fields.skip(2)?;
        let (entry_bytes, page_bits) = (fields.u8()?, fields.u8()?);
        Some((entry_bytes, page_bits, fields.length()?, fields.address()?))
    })();
    let (entry_bytes, page_bits, entries, block) = parsed.ok_or_else(malformed)?;
    if block == UNDEFINED {
        return Ok(Vec::new());
    }
    let page = 1u64.checked_shl(page_bits.into()).ok_or_else(malformed)?;
    let head = 6 + file.widths.address as u64;
    let mut array = Array { file, width, entry_bytes: entry_bytes.into(), total, chunks: Vec::new() };
    if entries <= page {
        array.read(block.saturating_add(head), 0, entries)?;
        return Ok(array.chunks);
    }
    // A bit for each page, a checksum; then pages, each with a checksum.
    let mut at = block.saturating_add(head + entries.div_ceil(page).div_ceil(8) + 4);
    let mut number = 0;
    while number < entries && number < total {
        array.read(at, number, page.min(entries - number))?;
        at = at.saturating_add(page.saturating_mul(entry_bytes.into()) + 4);
        number = number.saturating_add(page);
    }
    Ok(array.chunks)
}

/// Reads runs of entries.
struct Array<'a> {
    file: &'a File,
    width: Width,
    entry_bytes: usize,
    /// Chunks of the dataset.
    total: u64,
    chunks: Vec<Chunk>,
}

impl Array<'_> {
    /// Reads `count` entries, the first of them of this number; not those beyond the dataset's last.
    fn read(&mut self, address: u64, number: u64, count: u64) -> Result<(), Error> {
        let count = count.min(self.total.saturating_sub(number));
        let malformed = || self.file.malformed("array of chunks", address);
        let len = usize::try_from(count).ok().and_then(|count| count.checked_mul(self.entry_bytes));
        let bytes = self.file.bytes("array of chunks", address, len.ok_or_else(malformed)?)?;
        for (i, entry) in bytes.chunks_exact(self.entry_bytes.max(1)).enumerate() {
            let chunk = self.width.entry(&mut self.file.fields(entry), number + i as u64);
            self.chunks.push(chunk.ok_or_else(malformed)?);
        }
        Ok(())
    }
}

/// Shape of an extensible array.
struct Shape {
    entry_bytes: usize,
    index_entries: u64,
    /// Entries of the smallest data block.
    block_entries: u64,
    /// Super blocks, whether they are blocks of their own or not.
    supers: u32,
    /// Of these, the first have their data blocks' addresses in the index block.
    supers_in_index: u32,
    /// Bytes of an offset in the array.
    offset_bytes: usize,
    /// Entries of a page: longer data blocks are cut into pages.
    page: u64,
    index_block: u64,
}

impl Shape {
    fn parse(mut fields: Fields<'_>) -> Option<Self> {
        fields.signature(b"EAHD")?;
        fields.skip(2)?;
        let [entry_bytes, bits, index_entries, block_entries, pointers, page_bits] =
            [fields.u8()?, fields.u8()?, fields.u8()?, fields.u8()?, fields.u8()?, fields.u8()?];
        for _ in 0..6 {
            fields.length()?;
        }
        let supers = 1 + u32::from(bits).checked_sub(u32::from(block_entries).checked_ilog2()?)?;
        let supers_in_index = 2 * u32::from(pointers).checked_ilog2()?;
        let shape = Self {
            entry_bytes: entry_bytes.into(),
            index_entries: index_entries.into(),
            block_entries: block_entries.into(),
            supers,
            supers_in_index,
            offset_bytes: usize::from(bits).div_ceil(8),
            page: 1u64.checked_shl(page_bits.into())?,
            index_block: fields.address()?,
        };
        (bits <= 64 && entry_bytes > 0).then_some(shape)
    }

    /// Data blocks of a super block, and entries of each.
    fn blocks(&self, of: u32) -> (u64, u64) {
        (1 << (of / 2), self.block_entries << of.div_ceil(2))
    }
}

/// Chunks of an extensible array.
pub(super) fn extensible(file: &File, header: u64, total: u64, width: Width) -> Result<Vec<Chunk>, Error> {
    if header == UNDEFINED {
        return Ok(Vec::new());
    }
    let malformed = || file.malformed("array of chunks", header);
    let bytes = file.bytes_up_to(header, 128)?;
    let shape = Shape::parse(file.fields(&bytes)).ok_or_else(malformed)?;
    if shape.index_block == UNDEFINED {
        return Ok(Vec::new());
    }
    let mut array = Array { file, width, entry_bytes: shape.entry_bytes, total, chunks: Vec::new() };
    let mut at = shape.index_block.saturating_add(6 + file.widths.address as u64);
    array.read(at, 0, shape.index_entries)?;
    at = at.saturating_add(shape.index_entries * shape.entry_bytes as u64);
    let mut number = shape.index_entries;
    for of in 0..shape.supers.min(60) {
        if number >= total {
            break;
        }
        let (blocks, entries) = shape.blocks(of);
        let is_in_index = of < shape.supers_in_index;
        let addresses = if is_in_index { blocks } else { 1 };
        let there = addresses.min(total.div_ceil(entries) + 1) as usize * file.widths.address;
        let bytes = file.bytes("array of chunks", at, there)?;
        let mut fields = file.fields(&bytes);
        if is_in_index {
            read_blocks(&mut array, &shape, fields, number, entries)?;
        } else {
            let address = fields.address().ok_or_else(malformed)?;
            read_super(&mut array, &shape, address, number, of)?;
        }
        at = at.saturating_add(addresses.saturating_mul(file.widths.address as u64));
        number = number.saturating_add(blocks.saturating_mul(entries));
    }
    Ok(array.chunks)
}

/// Reads the data blocks of a super block.
fn read_super(array: &mut Array<'_>, shape: &Shape, address: u64, number: u64, of: u32) -> Result<(), Error> {
    if address == UNDEFINED {
        return Ok(());
    }
    let file = array.file;
    let (blocks, entries) = shape.blocks(of);
    let pages = if entries > shape.page { entries.div_ceil(shape.page) } else { 0 };
    let bitmaps = blocks.saturating_mul(pages.div_ceil(8));
    let head = 6 + (file.widths.address + shape.offset_bytes) as u64;
    let at = address.saturating_add(head).saturating_add(bitmaps);
    let left = array.total.saturating_sub(number).div_ceil(entries);
    let len = blocks.min(left) as usize * file.widths.address;
    let bytes = file.bytes("array of chunks", at, len)?;
    read_blocks(array, shape, file.fields(&bytes), number, entries)
}

/// Reads the data blocks at these addresses.
fn read_blocks(
    array: &mut Array<'_>,
    shape: &Shape,
    mut addresses: Fields<'_>,
    mut number: u64,
    entries: u64,
) -> Result<(), Error> {
    let head = 6 + (array.file.widths.address + shape.offset_bytes) as u64;
    while let Some(block) = addresses.address().filter(|_| number < array.total) {
        if block != UNDEFINED {
            let mut at = block.saturating_add(head);
            if entries <= shape.page {
                array.read(at, number, entries)?;
            } else {
                at = at.saturating_add(4);
                for page in 0..entries / shape.page {
                    let first = number + page * shape.page;
                    if first < array.total {
                        array.read(at, first, shape.page)?;
                    }
                    at = at.saturating_add(shape.page * shape.entry_bytes as u64 + 4);
                }
            }
        }
        number = number.saturating_add(entries);
    }
    Ok(())
}
