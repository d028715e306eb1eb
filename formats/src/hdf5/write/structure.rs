//! What describes the data: superblock, groups, headers of datasets, trees of chunks.
//!
//! Spec: as in the reader. The oldest form of everything is written, which every program reads.

use super::column::{Chunk, Column, Element};
use crate::Error;
use crate::hdf5::fields::UNDEFINED;
use crate::hdf5::file::SIGNATURE;
use crate::hdf5::filter::Codec;
use crate::output::Output;

pub(super) const SUPERBLOCK_BYTES: usize = 96;

/// Most children of a node of a tree of chunks, and of a group's.
const CHUNKS_OF_NODE: usize = 64;
const NODES_OF_GROUP: usize = 32;
/// Most names of a node of a group.
const NAMES_OF_NODE: usize = 8;

/// Bytes of a structure, little-endian.
#[derive(Debug, Default)]
struct Bytes(Vec<u8>);

impl Bytes {
    fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }

    fn u8(self, value: u8) -> Self {
        self.raw(&[value])
    }

    fn u16(self, value: u16) -> Self {
        self.raw(&value.to_le_bytes())
    }

    fn u32(self, value: u32) -> Self {
        self.raw(&value.to_le_bytes())
    }

    fn u64(self, value: u64) -> Self {
        self.raw(&value.to_le_bytes())
    }

    /// Zeroes up to this length.
    fn zeroes_to(mut self, len: usize) -> Self {
        self.0.resize(len.max(self.0.len()), 0);
        self
    }

    /// Zeroes up to a multiple of eight bytes.
    fn pad(self) -> Self {
        let len = self.0.len().next_multiple_of(8);
        self.zeroes_to(len)
    }
}

/// A message of an object's header.
struct Message {
    kind: u16,
    body: Vec<u8>,
}

impl Message {
    fn new(kind: u16, body: Bytes) -> Self {
        Self { kind, body: body.pad().0 }
    }
}

/// An attribute of one number or text.
#[derive(Debug)]
pub(super) struct Attribute {
    name: &'static str,
    datatype: Vec<u8>,
    data: Vec<u8>,
}

impl Attribute {
    pub fn integer(name: &'static str, value: i64) -> Self {
        Self { name, datatype: integer(Element::I64).0, data: value.to_le_bytes().to_vec() }
    }

    pub fn float(name: &'static str, value: f64) -> Self {
        // IEEE: sign at bit 63, eleven bits of exponent from 52 on, and a one before the mantissa that is not stored.
        let datatype = Bytes::default().raw(&[0x11, 0x20, 0x3F, 0]).u32(8).u16(0).u16(64);
        let datatype = datatype.raw(&[52, 11, 0, 52]).u32(1023);
        Self { name, datatype: datatype.0, data: value.to_le_bytes().to_vec() }
    }

    pub fn text(name: &'static str, value: &str) -> Self {
        let data = [value.as_bytes(), &[0]].concat();
        Self { name, datatype: Bytes::default().raw(&[0x13, 0, 0, 0]).u32(data.len() as u32).0, data }
    }

    fn message(&self) -> Message {
        let name = Bytes::default().raw(self.name.as_bytes()).u8(0);
        let scalar = dataspace(None);
        let lengths = [name.0.len(), self.datatype.len(), scalar.0.len()];
        let [name_bytes, datatype_bytes, dataspace_bytes] = lengths.map(|len| len as u16);
        let head = Bytes::default().u8(1).u8(0).u16(name_bytes).u16(datatype_bytes).u16(dataspace_bytes);
        let datatype = Bytes::default().raw(&self.datatype).pad();
        Message::new(0x0C, head.raw(&name.pad().0).raw(&datatype.0).raw(&scalar.0).raw(&self.data))
    }
}

/// The type of an integer.
fn integer(element: Element) -> Bytes {
    let signed = if element == Element::I64 { 8 } else { 0 };
    let bits = 8 * element.bytes() as u16;
    Bytes::default().raw(&[0x10, signed, 0, 0]).u32(element.bytes() as u32).u16(0).u16(bits)
}

/// A shape: one dimension, or a single element.
fn dataspace(rows: Option<u64>) -> Bytes {
    let rank = u8::from(rows.is_some());
    let head = Bytes::default().raw(&[1, rank, 0, 0, 0, 0, 0, 0]);
    rows.into_iter().fold(head, Bytes::u64)
}

/// That rows not written read as zeroes.
fn fill_value() -> Bytes {
    Bytes::default().raw(&[2, 3, 2, 1]).u32(0)
}

/// The filters that chunks go through.
fn filters(column: &Column) -> Option<Bytes> {
    let bytes = column.element.bytes();
    let mut filters = Vec::new();
    if column.codec != Codec::None && bytes > 1 {
        filters.push((2, vec![bytes as u32]));
    }
    match column.codec {
        Codec::None => {}
        Codec::Gzip => filters.push((1, vec![6])),
        Codec::Lz4 => filters.push((32004, vec![(column.chunk_rows * bytes) as u32])),
        Codec::Zstd => filters.push((32015, vec![3])),
    }
    let head = Bytes::default().raw(&[1, filters.len() as u8, 0, 0, 0, 0, 0, 0]);
    let one = |bytes: Bytes, (id, values): &(u16, Vec<u32>)| {
        // Without a name; one value, and four bytes to make eight of them.
        let bytes = bytes.u16(*id).u16(0).u16(1).u16(values.len() as u16);
        values.iter().fold(bytes, |bytes, value| bytes.u32(*value)).pad()
    };
    (!filters.is_empty()).then(|| filters.iter().fold(head, one))
}

/// A group that is being put together.
#[derive(Debug, Default)]
pub(super) struct Group {
    /// In the order of the alphabet.
    links: Vec<(&'static str, u64)>,
}

/// Where a group was written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Written {
    pub object: u64,
    tree: u64,
    heap: u64,
}

impl Group {
    /// Adds an object; names come in the order of the alphabet, at most eight.
    pub fn add(&mut self, name: &'static str, object: u64) {
        self.links.push((name, object));
    }

    pub fn write(self, structures: &mut Structures, attributes: &[Attribute]) -> Result<Written, Error> {
        // The empty name, then the others.
        let mut names = Bytes::default().u64(0);
        let mut node = Bytes::default().raw(b"SNOD").u8(1).u8(0).u16(self.links.len() as u16);
        let mut last = 0;
        for (name, object) in &self.links {
            last = names.0.len() as u64;
            // Nothing about the object is told here too.
            node = node.u64(last).u64(*object).raw(&[0; 24]);
            names = names.raw(name.as_bytes()).u8(0).pad();
        }
        let node = structures.put(node.zeroes_to(8 + NAMES_OF_NODE * 40))?;
        let tree = Bytes::default().raw(b"TREE").raw(&[0, 0]).u16(1).u64(UNDEFINED).u64(UNDEFINED);
        let tree = tree.u64(0).u64(node).u64(last);
        let tree = structures.put(tree.zeroes_to(24 + NODES_OF_GROUP * 8 + (NODES_OF_GROUP + 1) * 8))?;
        let names_bytes = names.0.len() as u64;
        let names = structures.put(names)?;
        // No free space in it.
        let heap = Bytes::default().raw(b"HEAP").u32(0).u64(names_bytes).u64(1).u64(names);
        let heap = structures.put(heap)?;
        let mut messages = vec![Message::new(0x11, Bytes::default().u64(tree).u64(heap))];
        messages.extend(attributes.iter().map(Attribute::message));
        Ok(Written { object: structures.object(&messages)?, tree, heap })
    }
}

/// Puts structures after the chunks.
#[derive(Debug)]
pub(super) struct Structures {
    output: Output,
}

impl Structures {
    pub fn new(output: Output) -> Self {
        Self { output }
    }

    pub fn output(&mut self) -> &mut Output {
        &mut self.output
    }

    /// Writes a structure at a multiple of eight bytes; its address.
    fn put(&mut self, bytes: Bytes) -> Result<u64, Error> {
        let gap = self.output.len().next_multiple_of(8) - self.output.len();
        self.output.write(&[0; 8][..gap as usize])?;
        let address = self.output.len();
        self.output.write(&bytes.0)?;
        Ok(address)
    }

    fn object(&mut self, messages: &[Message]) -> Result<u64, Error> {
        let body = |bytes: Bytes, message: &Message| {
            let bytes = bytes.u16(message.kind).u16(message.body.len() as u16).u32(0);
            bytes.raw(&message.body)
        };
        let body = messages.iter().fold(Bytes::default(), body);
        let head = Bytes::default().u8(1).u8(0).u16(messages.len() as u16).u32(1).u32(body.0.len() as u32);
        self.put(head.u32(0).raw(&body.0))
    }

    /// Writes the header of a column and the tree of its chunks.
    pub fn dataset(&mut self, column: &Column) -> Result<u64, Error> {
        let (element, chunk_rows) = (column.element, column.chunk_rows);
        let tree = self.tree(&column.chunks, chunk_rows as u64)?;
        let layout = Bytes::default().raw(&[3, 2, 2]).u64(tree);
        let layout = layout.u32(chunk_rows as u32).u32(element.bytes() as u32);
        let mut messages = vec![
            Message::new(0x01, dataspace(Some(column.rows()))),
            Message::new(0x03, integer(element)),
            Message::new(0x05, fill_value()),
            Message::new(0x08, layout),
        ];
        messages.extend(filters(column).map(|filters| Message::new(0x0B, filters)));
        self.object(&messages)
    }

    /// Writes a dataset of one number.
    pub fn scalar(&mut self, value: i64) -> Result<u64, Error> {
        let data = self.put(Bytes::default().u64(value as u64))?;
        let layout = Bytes::default().raw(&[3, 1]).u64(data).u64(8);
        let messages = [
            Message::new(0x01, dataspace(None)),
            Message::new(0x03, integer(Element::I64)),
            Message::new(0x05, fill_value()),
            Message::new(0x08, layout),
        ];
        self.object(&messages)
    }

    /// Writes the tree of a column's chunks from the leaves up; the address of its root.
    fn tree(&mut self, chunks: &[Chunk], rows: u64) -> Result<u64, Error> {
        let end = chunks.len() as u64 * rows;
        let leaf = |(i, chunk): (usize, &Chunk)| Child {
            key: (chunk.bytes, i as u64 * rows),
            address: chunk.address,
        };
        let mut children: Vec<Child> = chunks.iter().enumerate().map(leaf).collect();
        for level in 0.. {
            let nodes = children.chunks(CHUNKS_OF_NODE).len();
            if nodes == 0 {
                return Ok(UNDEFINED);
            }
            let start = self.output.len().next_multiple_of(8);
            let address = |node: usize| start + (node * NODE_BYTES) as u64;
            let mut parents = Vec::with_capacity(nodes);
            for (i, of_node) in children.chunks(CHUNKS_OF_NODE).enumerate() {
                let left = if i > 0 { address(i - 1) } else { UNDEFINED };
                let right = if i + 1 < nodes { address(i + 1) } else { UNDEFINED };
                let next = children.get((i + 1) * CHUNKS_OF_NODE).map_or((0, end), |child| child.key);
                let address = self.put(node(level, (left, right), of_node, next))?;
                parents.extend(of_node.first().map(|first| Child { key: first.key, address }));
            }
            children = parents;
            if nodes == 1 {
                break;
            }
        }
        Ok(children.first().map_or(UNDEFINED, |root| root.address))
    }

    /// Writes the superblock and gives the file its name; tells its length.
    pub fn finish(mut self, root: &Written) -> Result<u64, Error> {
        let end = self.output.len();
        let bytes = Bytes::default().raw(&SIGNATURE).raw(&[0, 0, 0, 0, 0, 8, 8, 0]);
        let bytes = bytes.u16(NAMES_OF_NODE as u16 / 2).u16(NODES_OF_GROUP as u16 / 2).u32(0);
        let bytes = bytes.u64(0).u64(UNDEFINED).u64(end).u64(UNDEFINED);
        // The root's entry: no name, its header, and that its tree and heap are told here too.
        let bytes = bytes.u64(0).u64(root.object).u32(1).u32(0).u64(root.tree).u64(root.heap);
        self.output.write_at(0, &bytes.0)?;
        self.output.finish()
    }
}

/// A child of a node of a tree of chunks.
struct Child {
    /// Bytes of the first chunk in it, and the first row of that.
    key: (u32, u64),
    address: u64,
}

/// Bytes of a node of a tree of chunks, full or not.
const NODE_BYTES: usize = 24 + CHUNKS_OF_NODE * 8 + (CHUNKS_OF_NODE + 1) * 24;

fn node(level: u8, (left, right): (u64, u64), children: &[Child], next: (u32, u64)) -> Bytes {
    let head = Bytes::default().raw(b"TREE").raw(&[1, level]).u16(children.len() as u16).u64(left).u64(right);
    // Bytes, no filter left out, the row, and the place in an element, which is 0.
    let key = |bytes: Bytes, (len, row): (u32, u64)| bytes.u32(len).u32(0).u64(row).u64(0);
    let child = |bytes: Bytes, child: &Child| key(bytes, child.key).u64(child.address);
    key(children.iter().fold(head, child), next).zeroes_to(NODE_BYTES)
}
