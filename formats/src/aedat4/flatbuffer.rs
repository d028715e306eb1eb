//! FlatBuffers, as much as AEDAT 4 has of them: read with every offset checked, and written.
//!
//! Spec: <https://flatbuffers.dev/internals/>
//!
//! ```text
//! u32 size of what follows | u32 root | identifier | tables, vectors, strings anywhere, by offsets
//! table: i32 back to its vtable | fields          vtable: u16 its size, u16 size of the table, u16 place of each field
//! vector: u32 count | elements
//! ```

/// Bytes of an offset, a count or a size.
const WORD: usize = 4;

/// The four letters that tell what a buffer holds, if it is long enough. The buffer starts with its size.
pub(super) fn identifier(buffer: &[u8]) -> Option<[u8; 4]> {
    buffer.get(2 * WORD..3 * WORD)?.first_chunk().copied()
}

/// A table in a buffer that starts with its size.
#[derive(Clone, Copy, Debug)]
pub(super) struct Table<'a> {
    buffer: &'a [u8],
    at: usize,
    /// Places of its fields, two bytes each.
    fields: &'a [u8],
}

impl<'a> Table<'a> {
    /// The outermost table.
    pub fn root(buffer: &'a [u8]) -> Option<Self> {
        Self::at(buffer, follow(buffer, WORD)?)
    }

    fn at(buffer: &'a [u8], at: usize) -> Option<Self> {
        let back = i64::from(i32::from_le_bytes(chunk(buffer, at)?));
        let vtable = usize::try_from(i64::try_from(at).ok()?.checked_sub(back)?).ok()?;
        let bytes = usize::from(u16::from_le_bytes(chunk(buffer, vtable)?));
        let fields = buffer.get(vtable.checked_add(WORD)?..vtable.checked_add(bytes)?)?;
        Some(Self { buffer, at, fields })
    }

    /// Where a field is; `None` where it has its default.
    fn place(&self, field: usize) -> Option<usize> {
        let place = u16::from_le_bytes(chunk(self.fields, 2 * field)?);
        (place != 0).then(|| self.at.saturating_add(place.into()))
    }

    fn number<const N: usize>(&self, field: usize) -> Option<[u8; N]> {
        chunk(self.buffer, self.place(field)?)
    }

    /// A field of 8 bytes; absent or out of bounds is `None`, here and below.
    pub fn i64(&self, field: usize) -> Option<i64> {
        self.number(field).map(i64::from_le_bytes)
    }

    pub fn i32(&self, field: usize) -> Option<i32> {
        self.number(field).map(i32::from_le_bytes)
    }

    pub fn i16(&self, field: usize) -> Option<i16> {
        self.number(field).map(i16::from_le_bytes)
    }

    pub fn i8(&self, field: usize) -> Option<i8> {
        self.number(field).map(i8::from_le_bytes)
    }

    pub fn f32(&self, field: usize) -> Option<f32> {
        self.number(field).map(f32::from_le_bytes)
    }

    /// Bytes of a vector of bytes or of a string.
    pub fn bytes(&self, field: usize) -> Option<&'a [u8]> {
        let Vector { first, count } = self.vector(field)?;
        self.buffer.get(first..first.checked_add(count)?)
    }

    /// A vector; whether all its elements are there is not known yet.
    pub fn vector(&self, field: usize) -> Option<Vector> {
        let at = follow(self.buffer, self.place(field)?)?;
        let count = u32::from_le_bytes(chunk(self.buffer, at)?);
        Some(Vector { first: at + WORD, count: usize::try_from(count).ok()? })
    }
}

/// Elements in a buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Vector {
    /// Where they begin.
    pub first: usize,
    /// How many the buffer says there are.
    pub count: usize,
}

impl Vector {
    /// How many of them lie in the buffer, if each takes this many bytes.
    pub fn there(self, buffer: &[u8], element_bytes: usize) -> usize {
        (buffer.len().saturating_sub(self.first) / element_bytes).min(self.count)
    }

    /// The table that an element refers to.
    pub fn table(self, buffer: &[u8], element: usize) -> Option<Table<'_>> {
        let at = self.first.checked_add(element.checked_mul(WORD)?)?;
        Table::at(buffer, follow(buffer, at)?)
    }
}

/// Where the offset at this place leads to.
fn follow(buffer: &[u8], at: usize) -> Option<usize> {
    let offset = u32::from_le_bytes(chunk(buffer, at)?);
    at.checked_add(usize::try_from(offset).ok()?)
}

fn chunk<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..)?.first_chunk().copied()
}

/// A buffer being written, front to back. Positions count from its size, as alignment does.
#[derive(Debug, Default)]
pub(super) struct Builder {
    bytes: Vec<u8>,
}

impl Builder {
    /// Starts a buffer whose outermost table has these [fields](Self::table); tells where the table is.
    pub fn start(&mut self, identifier: [u8; 4], fields: &[u16], table_bytes: u16) -> usize {
        self.bytes.clear();
        self.bytes.extend_from_slice(&[0; 2 * WORD]);
        self.bytes.extend_from_slice(&identifier);
        let vtable = self.vtable(fields, table_bytes);
        let table = self.table(vtable);
        self.refer(WORD, table);
        table
    }

    /// Places of the fields of tables of this size; 0 is an absent one. For use by many tables.
    pub fn vtable(&mut self, fields: &[u16], table_bytes: u16) -> usize {
        // Tables of ours begin where a place that is a multiple of 8, plus 4, is right for 8-byte fields.
        let at = self.bytes.len();
        self.bytes.extend_from_slice(&((fields.len() * 2 + WORD) as u16).to_le_bytes());
        self.bytes.extend_from_slice(&table_bytes.to_le_bytes());
        fields.iter().for_each(|field| self.bytes.extend_from_slice(&field.to_le_bytes()));
        at
    }

    /// Adds a table of zeroes, all its fields to be [put](Self::put): its 8-byte fields belong at 4, 12, 20 and so on.
    pub fn table(&mut self, vtable: usize) -> usize {
        let bytes = u16::from_le_bytes(chunk(&self.bytes, vtable + 2).unwrap_or_default());
        while self.bytes.len() % 8 != WORD {
            self.bytes.push(0);
        }
        let at = self.bytes.len();
        self.bytes.resize(at + usize::from(bytes), 0);
        self.put(at, ((at - vtable) as i32).to_le_bytes());
        at
    }

    /// Adds a vector of elements of which `first_align` is 4 or 8; the bytes come after. The field there refers to it.
    pub fn vector(&mut self, field: usize, count: usize, first_align: usize) -> usize {
        while !(self.bytes.len() + WORD).is_multiple_of(first_align) {
            self.bytes.push(0);
        }
        let at = self.bytes.len();
        self.refer(field, at);
        self.bytes.extend_from_slice(&(count as u32).to_le_bytes());
        at + WORD
    }

    /// Overwrites bytes.
    pub fn put<const N: usize>(&mut self, at: usize, value: [u8; N]) {
        if let Some(slot) = self.bytes.get_mut(at..at + N) {
            slot.copy_from_slice(&value);
        }
    }

    /// Makes the offset at a place lead to another.
    pub fn refer(&mut self, from: usize, to: usize) {
        self.put(from, ((to - from) as u32).to_le_bytes());
    }

    /// Adds bytes.
    pub fn extend(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// The buffer, whole.
    pub fn finish(&mut self) -> &[u8] {
        let size = self.bytes.len() - WORD;
        self.put(0, (size as u32).to_le_bytes());
        &self.bytes
    }
}
