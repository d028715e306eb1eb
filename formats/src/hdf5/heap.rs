//! Heaps, where names and texts are kept.
//!
//! Spec: sections III.D (local), III.E (global) and III.G (fractal) of the file format

use super::fields::{Fields, bytes_for};
use super::file::File;
use crate::Error;

/// The bytes of a local heap: the names of an old group.
pub(super) fn local(file: &File, address: u64) -> Result<Vec<u8>, Error> {
    let head = file.bytes_up_to(address, 32)?;
    let mut fields = file.fields(&head);
    let place = (|| {
        fields.signature(b"HEAP")?;
        fields.skip(4)?;
        let bytes = usize::try_from(fields.length()?).ok()?;
        fields.length()?;
        Some((fields.address()?, bytes))
    })();
    let (data, bytes) = place.ok_or_else(|| file.malformed("heap", address))?;
    file.bytes("heap", data, bytes)
}

/// The object of this number in a collection of the global heap: a text of any length.
pub(super) fn global(file: &File, collection: u64, number: u32) -> Result<Vec<u8>, Error> {
    let malformed = || file.malformed("heap", collection);
    let head = file.bytes_up_to(collection, 16)?;
    let mut fields = file.fields(&head);
    let bytes = fields.signature(b"GCOL").and_then(|()| fields.skip(4)).and_then(|()| fields.length());
    let bytes = usize::try_from(bytes.ok_or_else(malformed)?).map_err(|_| malformed())?;
    let collection = file.bytes("heap", collection, bytes)?;
    let mut fields = file.fields(&collection);
    fields.skip(8 + file.widths.length).ok_or_else(malformed)?;
    find(fields, number).ok_or_else(malformed)
}

fn find(mut objects: Fields<'_>, wanted: u32) -> Option<Vec<u8>> {
    loop {
        let number = objects.u16()?;
        objects.skip(6)?;
        let bytes = usize::try_from(objects.length()?).ok()?;
        if u32::from(number) == wanted {
            return Some(objects.take(bytes)?.to_vec());
        }
        // The last is the free space.
        objects.skip(if number == 0 { return None } else { bytes.checked_next_multiple_of(8)? })?;
    }
}

/// A fractal heap: rows of blocks, each row's twice as large as the one before.
#[derive(Debug)]
pub(super) struct FractalHeap {
    address: u64,
    offset_bytes: usize,
    length_bytes: usize,
    columns: u64,
    start_bytes: u64,
    direct_bytes_max: u64,
    root: u64,
    /// Rows of the root; 0 if that is the only block.
    root_rows: u64,
}

impl FractalHeap {
    pub fn open(file: &File, address: u64) -> Result<Self, Error> {
        let bytes = file.bytes_up_to(address, 256)?;
        Self::parse(file, &bytes, address).ok_or_else(|| file.malformed("heap", address))
    }

    fn parse(file: &File, header: &[u8], address: u64) -> Option<Self> {
        let mut fields = file.fields(header);
        fields.signature(b"FRHP")?;
        fields.skip(1 + 2)?;
        let filters_bytes = fields.u16()?;
        fields.skip(1)?;
        let managed_bytes_max = u64::from(fields.u32()?);
        // Ten lengths and two addresses of what we do not need.
        fields.skip(10 * file.widths.length + 2 * file.widths.address)?;
        let columns = u64::from(fields.u16()?);
        let (start_bytes, direct_bytes_max) = (fields.length()?, fields.length()?);
        let offset_bytes = usize::from(fields.u16()?).div_ceil(8);
        fields.skip(2)?;
        let (root, root_rows) = (fields.address()?, u64::from(fields.u16()?));
        let length_bytes = bytes_for(direct_bytes_max.min(managed_bytes_max));
        let sane = filters_bytes == 0 && columns > 0 && start_bytes.is_power_of_two();
        let heap = Self {
            address,
            offset_bytes,
            length_bytes,
            columns,
            start_bytes,
            direct_bytes_max,
            root,
            root_rows,
        };
        (sane && direct_bytes_max >= start_bytes && offset_bytes <= 8).then_some(heap)
    }

    /// The object that an identifier names.
    pub fn object(&self, file: &File, id: &[u8]) -> Result<Vec<u8>, Error> {
        let malformed = || file.malformed("heap", self.address);
        let mut fields = file.fields(id);
        let kind = fields.u8().ok_or_else(malformed)?;
        match kind >> 4 & 3 {
            0 => {
                let place = fields.number(self.offset_bytes).zip(fields.number(self.length_bytes));
                let (offset, bytes) = place.ok_or_else(malformed)?;
                let address = self.address_of(file, offset)?;
                file.bytes("heap", address, usize::try_from(bytes).map_err(|_| malformed())?)
            }
            2 => Ok(fields.take(usize::from(kind & 15) + 1).ok_or_else(malformed)?.to_vec()),
            _ => Err(file.unsupported("an HDF5 heap with huge objects")),
        }
    }

    /// Where in the file an offset in the heap is.
    fn address_of(&self, file: &File, mut offset: u64) -> Result<u64, Error> {
        let malformed = || file.malformed("heap", self.address);
        let (mut block, mut rows) = (self.root, self.root_rows);
        while rows > 0 {
            let entry = self.entry(offset, rows).ok_or_else(malformed)?;
            let prefix = 5 + file.widths.address + self.offset_bytes;
            let place =
                usize::try_from(entry.number).ok().and_then(|number| number.checked_mul(file.widths.address));
            let bytes =
                file.bytes("heap", block, prefix + place.ok_or_else(malformed)? + file.widths.address)?;
            let mut child = file.fields(&bytes);
            let read =
                child.signature(b"FHIB").and_then(|()| child.skip(bytes.len() - 4 - file.widths.address));
            block = read.and_then(|()| child.address()).ok_or_else(malformed)?;
            offset = entry.offset;
            // A block that is too large to be direct has as many rows as make its size.
            rows = match entry.bytes > self.direct_bytes_max {
                true => self.rows_of(entry.bytes).filter(|fewer| *fewer < rows).ok_or_else(malformed)?,
                false => 0,
            };
        }
        block.checked_add(offset).ok_or_else(malformed)
    }

    /// The entry of a block of rows in which an offset is.
    fn entry(&self, mut offset: u64, rows: u64) -> Option<Entry> {
        for row in 0..rows {
            let bytes = self.start_bytes.checked_shl(u32::try_from(row.saturating_sub(1)).ok()?)?;
            let row_bytes = bytes.checked_mul(self.columns)?;
            if offset < row_bytes {
                let column = offset.checked_div(bytes)?;
                return Some(Entry { number: row * self.columns + column, offset: offset % bytes, bytes });
            }
            offset -= row_bytes;
        }
        None
    }

    fn rows_of(&self, bytes: u64) -> Option<u64> {
        let first_row = self.start_bytes.checked_mul(self.columns)?;
        Some(u64::from(bytes.checked_div(first_row)?.checked_ilog2()?) + 1)
    }
}

/// A child of a block of rows.
struct Entry {
    number: u64,
    /// Of what is looked for, in the child.
    offset: u64,
    bytes: u64,
}
