//! Rows of the tables of a SQLite database, in the order of their numbers.
//!
//! Spec: <https://www.sqlite.org/fileformat2.html>
//!
//! ```text
//! page 1    100 bytes: magic, u16 page size (1 = 65536) at 16, u8 bytes reserved in each page at 20,
//!           u32 encoding of text (1 = UTF-8) at 56; after it the root of the table of tables
//! page      u8 kind (5 inner, 13 leaf), 2, u16 cells at 3, 3, inner: u32 last child; u16 offsets of the cells
//! cell      inner: u32 child, varint key      leaf: varint bytes, varint row number, payload, u32 overflow page
//! overflow  u32 next page (0 = last), payload
//! payload   varint bytes of the head, varint kind of each column, their values
//! kind      0 null; 1 to 6 integers of 1, 2, 3, 4, 6, 8 bytes; 7 float; 8, 9 the numbers 0, 1; from 12: bytes, text
//! ```
//!
//! All numbers are big-endian; a varint has 7 bits a byte, and 8 in the ninth.

use crate::input::Input;
use crate::{Error, ErrorKind};
use std::sync::Arc;

/// What every database begins with.
pub(super) const MAGIC: &[u8; 16] = b"SQLite format 3\0";
/// Bytes of the header of a database.
const HEADER_BYTES: usize = 100;
const INNER: u8 = 5;
const LEAF: u8 = 13;
/// Deepest tree: 2^32 pages are no deeper.
const DEPTH_MAX: usize = 20;
/// Bytes of overflow pages read at once.
const READ_BYTES: usize = 64 << 10;
/// Most bytes of a row's head and its short columns.
const HEAD_BYTES_MAX: usize = 256;
/// Longest entry in the table of tables.
const SCHEMA_BYTES_MAX: usize = 64 << 10;

/// Pages of a database.
#[derive(Debug)]
pub(super) struct Database {
    input: Arc<Input>,
    page_bytes: usize,
    /// Bytes of a page without those reserved.
    usable_bytes: usize,
    /// The page of a tree that was read last.
    tree: Window,
    /// Pages that overflow, as many as are read at once.
    overflow: Window,
}

/// Bytes read from the file.
#[derive(Debug, Default)]
struct Window {
    at: u64,
    bytes: Vec<u8>,
    len: usize,
}

impl Window {
    /// `len` bytes from `offset`, read as part of `want` if they are not here; fewer at the file's end.
    fn get(&mut self, input: &Input, offset: u64, len: usize, want: usize) -> Result<&[u8], Error> {
        let inside = offset.checked_sub(self.at).and_then(|inside| usize::try_from(inside).ok());
        let inside = inside.filter(|inside| inside.checked_add(len).is_some_and(|end| end <= self.len));
        let start = match inside {
            Some(inside) => inside,
            None => {
                self.bytes.resize(want.max(len), 0);
                self.len = 0;
                self.len = input.read_at(offset, &mut self.bytes)?;
                self.at = offset;
                0
            }
        };
        Ok(self.bytes.get(start..self.len.min(start + len)).unwrap_or_default())
    }
}

impl Database {
    pub fn open(input: Arc<Input>) -> Result<Self, Error> {
        let mut header = [0; HEADER_BYTES];
        input.read_at(0, &mut header)?;
        let page_bytes = match u16_at(&header, 16) {
            Some(1) => 65536,
            bytes => usize::from(bytes.unwrap_or_default()),
        };
        let reserved = usize::from(header.get(20).copied().unwrap_or_default());
        let usable_bytes = page_bytes.saturating_sub(reserved);
        let (tree, overflow) = (Window::default(), Window::default());
        let database = Self { input, page_bytes, usable_bytes, tree, overflow };
        if !page_bytes.is_power_of_two() || page_bytes < 512 || usable_bytes < 480 {
            return Err(database.malformed("has pages of a size that SQLite does not know"));
        }
        match u32_at(&header, 56) {
            Some(0 | 1) => Ok(database),
            _ => {
                let what = "is a SQLite database with text in UTF-16";
                let remedy = "write it again with ros2 bag convert";
                Err(Error::new(ErrorKind::Unsupported, database.input.path(), what, remedy))
            }
        }
    }

    pub fn input(&self) -> &Arc<Input> {
        &self.input
    }

    /// Another without buffers.
    pub fn fork(&self) -> Self {
        let (tree, overflow) = (Window::default(), Window::default());
        Self { input: self.input.clone(), tree, overflow, ..*self }
    }

    pub fn malformed(&self, what: &str) -> Error {
        let remedy = "copy it again, or save what is left with: sqlite3 FILE .recover";
        Error::new(ErrorKind::Malformed, self.input.path(), what, remedy).at(self.tree.at)
    }

    fn offset(&self, page: u32) -> u64 {
        u64::from(page.saturating_sub(1)) * self.page_bytes as u64
    }

    /// A page of a tree, whole.
    fn tree_page(&mut self, page: u32) -> Result<&[u8], Error> {
        let (offset, len) = (self.offset(page), self.page_bytes);
        let whole = page > 0 && offset.saturating_add(len as u64) <= self.input.len();
        if !whole {
            let remedy = "copy it again from where it was recorded";
            let what = format!("ends before its page {page}");
            let at = self.input.len();
            return Err(Error::new(ErrorKind::Malformed, self.input.path(), what, remedy).at(at));
        }
        self.tree.get(&self.input, offset, len, len)
    }

    /// The table of this name.
    pub fn table(&mut self, name: &str) -> Result<Option<Table>, Error> {
        let mut tables = Table::new(1, Vec::new());
        while let Some(row) = tables.next(self)? {
            let Some(row) = row.whole(self, SCHEMA_BYTES_MAX)? else { continue };
            let text = |column| row.value(column).and_then(Value::text);
            if text(0).as_deref() != Some("table") || text(1).as_deref() != Some(name) {
                continue;
            }
            let root = row.value(3).and_then(Value::integer).and_then(|root| u32::try_from(root).ok());
            let columns = columns(&text(4).unwrap_or_default());
            return Ok(root.map(|root| Table::new(root, columns)));
        }
        Ok(None)
    }
}

/// The names of the columns in the words that made a table.
fn columns(sql: &str) -> Vec<String> {
    let inside = sql.split_once('(').map_or("", |(_, inside)| inside);
    let mut depth = 0;
    let parts = inside.split(|c| {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        (c == ',' && depth == 0) || (c == ')' && depth < 0)
    });
    let name = |part: &str| {
        let word = part.split_whitespace().next().unwrap_or_default();
        word.trim_matches(['"', '`', '[', ']']).to_ascii_lowercase()
    };
    parts.map(name).filter(|name| !name.is_empty()).collect()
}

/// The rows of a table, and a place among them.
#[derive(Clone, Debug)]
pub(super) struct Table {
    columns: Arc<[String]>,
    /// From the root: a page, and the cell of it that comes.
    path: Vec<(u32, u16)>,
}

impl Table {
    fn new(root: u32, columns: Vec<String>) -> Self {
        Self { columns: columns.into(), path: vec![(root, 0)] }
    }

    /// Which column has this name.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|one| one == name)
    }

    /// The next row.
    pub fn next(&mut self, database: &mut Database) -> Result<Option<Row>, Error> {
        let usable_bytes = database.usable_bytes;
        while let Some((page_number, cell)) = self.path.last_mut() {
            let bytes = database.tree_page(*page_number)?;
            let page = Page::new(bytes, *page_number);
            let at = *cell;
            *cell = cell.saturating_add(1);
            match page.and_then(|page| page.step(at, usable_bytes)) {
                Some(Step::Row(row)) => return Ok(Some(Row { page: *page_number, ..row })),
                Some(Step::Child(child)) if self.path.len() < DEPTH_MAX => self.path.push((child, 0)),
                Some(Step::Up) => drop(self.path.pop()),
                Some(Step::Child(_)) | None => {
                    // After an error there is no more.
                    self.path.clear();
                    return Err(database.malformed("has a page that is none of a table"));
                }
            }
        }
        Ok(None)
    }
}

/// A page of a tree.
#[derive(Clone, Copy)]
struct Page<'a> {
    bytes: &'a [u8],
    /// Where its own header stands.
    header: usize,
    kind: u8,
    cells: u16,
}

/// What a cell of a tree leads to.
enum Step {
    Row(Row),
    Child(u32),
    Up,
}

impl<'a> Page<'a> {
    fn new(bytes: &'a [u8], number: u32) -> Option<Self> {
        let header = if number == 1 { HEADER_BYTES } else { 0 };
        let kind = *bytes.get(header)?;
        (kind == INNER || kind == LEAF).then_some(())?;
        Some(Self { bytes, header, kind, cells: u16_at(bytes, header + 3)? })
    }

    fn step(self, cell: u16, usable_bytes: usize) -> Option<Step> {
        let inner = self.kind == INNER;
        if cell > self.cells || (cell == self.cells && !inner) {
            return Some(Step::Up);
        }
        if cell == self.cells {
            return u32_at(self.bytes, self.header + 8).map(Step::Child);
        }
        let pointers = self.header + if inner { 12 } else { 8 };
        let at = usize::from(u16_at(self.bytes, pointers + 2 * usize::from(cell))?);
        if inner {
            return u32_at(self.bytes, at).map(Step::Child);
        }
        Row::parse(self.bytes, at, usable_bytes).map(Step::Row)
    }
}

/// A row: where its payload is.
#[derive(Clone, Debug, Default)]
pub(super) struct Row {
    /// Its number, which is also the value of a column that is the primary key.
    pub id: i64,
    bytes: u64,
    page: u32,
    /// Offset in the page and length of what stands there.
    local: (usize, usize),
    /// Where the rest begins; 0 if there is none.
    overflow: u32,
}

impl Row {
    fn parse(page: &[u8], at: usize, usable_bytes: usize) -> Option<Self> {
        let mut rest = page.get(at..)?;
        let bytes = u64::try_from(varint(&mut rest)?).ok()?;
        let id = varint(&mut rest)?;
        let start = page.len() - rest.len();
        let local_bytes = local_bytes(bytes, usable_bytes);
        page.get(start..start + local_bytes)?;
        let whole = local_bytes as u64 == bytes;
        let overflow = if whole { 0 } else { u32_at(page, start + local_bytes)? };
        Some(Self { id, bytes, page: 0, local: (start, local_bytes), overflow })
    }

    /// Bytes of its payload.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// A part of its payload, to be read in pieces.
    pub fn payload(&self, offset: u64, bytes: u64) -> Payload {
        let Self { page, local, overflow, .. } = *self;
        Payload { page, local, overflow, skip: offset, left: bytes }
    }

    /// Its head, with the values that stand in the first bytes; `None` where it is damaged.
    pub fn head(&self, database: &mut Database) -> Result<Option<Columns>, Error> {
        let (start, len) = self.local;
        let page = database.tree_page(self.page)?;
        let bytes = page.get(start..start + len.min(HEAD_BYTES_MAX)).unwrap_or_default();
        Ok(Columns::parse(bytes.to_vec(), self.bytes))
    }

    /// All of it; `None` where it is damaged or longer than `most`.
    pub fn whole(&self, database: &mut Database, most: usize) -> Result<Option<Columns>, Error> {
        if self.bytes > most as u64 {
            return Ok(None);
        }
        let mut bytes = Vec::new();
        let mut payload = self.payload(0, self.bytes);
        while payload.read(database, &mut bytes)? {}
        Ok(Columns::parse(bytes, self.bytes))
    }
}

/// Bytes of a payload that stand in the page itself.
fn local_bytes(bytes: u64, usable_bytes: usize) -> usize {
    let most = usable_bytes - 35;
    if bytes <= most as u64 {
        return bytes as usize;
    }
    let least = (usable_bytes - 12) * 32 / 255 - 23;
    let local = least + ((bytes - least as u64) % (usable_bytes as u64 - 4)) as usize;
    if local <= most { local } else { least }
}

/// A part of a row's payload that is still to be read.
#[derive(Clone, Debug, Default)]
pub(super) struct Payload {
    page: u32,
    /// What stands in the page of the row; nothing once it was read.
    local: (usize, usize),
    overflow: u32,
    /// Bytes before it.
    skip: u64,
    left: u64,
}

impl Payload {
    /// Bytes still to be read.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// Adds the next bytes to `out`; false at the end.
    pub fn read(&mut self, database: &mut Database, out: &mut Vec<u8>) -> Result<bool, Error> {
        if self.left == 0 {
            return Ok(false);
        }
        let (start, len) = std::mem::take(&mut self.local);
        if len > 0 {
            let page = database.tree_page(self.page)?;
            let piece = page.get(start..start + len).unwrap_or_default();
            self.add(piece, out);
            return Ok(true);
        }
        let (offset, usable_bytes) = (database.offset(self.overflow), database.usable_bytes);
        let page = database.overflow.get(&database.input, offset, usable_bytes, READ_BYTES)?;
        let next = u32_at(page, 0).filter(|_| self.overflow > 0 && page.len() == usable_bytes);
        let Some(next) = next else {
            self.left = 0;
            let what = "ends inside a row";
            let remedy = "copy it again from where it was recorded";
            let at = offset.min(database.input.len());
            return Err(Error::new(ErrorKind::Malformed, database.input.path(), what, remedy).at(at));
        };
        self.add(page.get(4..).unwrap_or_default(), out);
        self.overflow = next;
        Ok(true)
    }

    fn add(&mut self, piece: &[u8], out: &mut Vec<u8>) {
        let skip = usize::try_from(self.skip).unwrap_or(usize::MAX).min(piece.len());
        self.skip -= skip as u64;
        let piece = piece.get(skip..).unwrap_or_default();
        let len = usize::try_from(self.left).unwrap_or(usize::MAX).min(piece.len());
        self.left -= len as u64;
        out.extend_from_slice(piece.get(..len).unwrap_or_default());
    }
}

/// The columns of a row, those at least that stand in its first bytes.
pub(super) struct Columns {
    bytes: Vec<u8>,
    /// Kind and offset of each.
    columns: Vec<(u64, u64)>,
}

/// Most columns of a row.
const COLUMNS_MAX: usize = 64;

impl Columns {
    fn parse(bytes: Vec<u8>, payload_bytes: u64) -> Option<Self> {
        let mut rest = bytes.as_slice();
        let head_bytes = usize::try_from(varint(&mut rest)?).ok()?;
        let mut kinds = bytes.get(bytes.len() - rest.len()..head_bytes)?;
        let mut columns = Vec::new();
        let mut offset = head_bytes as u64;
        while !kinds.is_empty() && columns.len() < COLUMNS_MAX {
            let kind = u64::try_from(varint(&mut kinds)?).ok()?;
            columns.push((kind, offset));
            offset = offset.checked_add(value_bytes(kind))?;
        }
        (offset <= payload_bytes).then_some(Self { bytes, columns })
    }

    /// The value of a column, if it is here.
    pub fn value(&self, column: usize) -> Option<Value<'_>> {
        let (kind, offset) = *self.columns.get(column)?;
        let start = usize::try_from(offset).ok()?;
        let end = start.checked_add(usize::try_from(value_bytes(kind)).ok()?)?;
        Some(Value { kind, bytes: self.bytes.get(start..end)? })
    }

    /// Offset and length in the payload of a column that is bytes.
    pub fn blob(&self, column: usize) -> Option<(u64, u64)> {
        let (kind, offset) = *self.columns.get(column)?;
        (kind >= 12 && kind % 2 == 0).then(|| (offset, value_bytes(kind)))
    }
}

/// A value of a column.
#[derive(Clone, Copy)]
pub(super) struct Value<'a> {
    kind: u64,
    bytes: &'a [u8],
}

impl Value<'_> {
    pub fn integer(self) -> Option<i64> {
        match self.kind {
            1..=6 => {
                let negative = self.bytes.first().is_some_and(|first| *first >= 0x80);
                let start = if negative { -1 } else { 0 };
                Some(self.bytes.iter().fold(start, |value, byte| value << 8 | i64::from(*byte)))
            }
            8 => Some(0),
            9 => Some(1),
            _ => None,
        }
    }

    pub fn text(self) -> Option<String> {
        (self.kind >= 13 && self.kind % 2 == 1).then(|| String::from_utf8_lossy(self.bytes).into_owned())
    }
}

/// Length of a value of this kind.
fn value_bytes(kind: u64) -> u64 {
    match kind {
        1..=4 => kind,
        5 => 6,
        6 | 7 => 8,
        12.. => (kind - 12) / 2,
        _ => 0,
    }
}

fn varint(bytes: &mut &[u8]) -> Option<i64> {
    let mut value = 0i64;
    for i in 0..9 {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        if i == 8 {
            return Some(value << 8 | i64::from(*byte));
        }
        value = value << 7 | i64::from(byte & 0x7F);
        if byte & 0x80 == 0 {
            break;
        }
    }
    Some(value)
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(*bytes.get(at..)?.first_chunk()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn varints_have_seven_bits_a_byte_and_eight_in_the_ninth() {
        let read = |bytes: &[u8]| varint(&mut &*bytes);
        assert_eq!(read(&[0x7F]), Some(127));
        assert_eq!(read(&[0x81, 0x00]), Some(128));
        assert_eq!(read(&[0xFF; 9]), Some(-1));
        assert_eq!(read(&[0x80]), None);
    }

    #[test]
    fn columns_are_named_in_the_words_that_made_the_table() {
        let sql = "CREATE TABLE messages(id INTEGER PRIMARY KEY,\"topic_id\" INTEGER NOT NULL, x DECIMAL(3, 4), data BLOB NOT NULL)";
        assert_eq!(columns(sql), ["id", "topic_id", "x", "data"]);
    }
}
