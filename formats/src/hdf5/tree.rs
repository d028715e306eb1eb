//! B-trees of both versions: nodes of the old one, records of the new one.
//!
//! Spec: sections III.A.1 and III.A.2 of the file format

use super::fields::{Fields, bytes_for};
use super::file::File;
use crate::Error;

/// A node of an old tree.
#[derive(Debug)]
pub(super) struct OldNode {
    pub level: u8,
    pub entries: Vec<OldEntry>,
}

/// What a node says of a child.
#[derive(Debug)]
pub(super) struct OldEntry {
    /// The least key in it.
    pub key: Vec<u8>,
    pub child: u64,
}

impl OldNode {
    /// Reads a node of a tree of this kind (0: groups, 1: chunks), whose keys have this many bytes; `what` names it in
    /// errors.
    pub fn read(file: &File, what: &str, address: u64, kind: u8, key_bytes: usize) -> Result<Self, Error> {
        let malformed = || file.malformed(what, address);
        let head = file.bytes_up_to(address, 8)?;
        let mut fields = file.fields(&head);
        let count = fields.skip(6).and_then(|()| fields.u16()).ok_or_else(malformed)?;
        let entry_bytes = key_bytes + file.widths.address;
        let len = 8 + 2 * file.widths.address + usize::from(count) * entry_bytes;
        let bytes = file.bytes(what, address, len)?;
        Self::parse(file.fields(&bytes), kind, key_bytes).ok_or_else(malformed)
    }

    fn parse(mut fields: Fields<'_>, kind: u8, key_bytes: usize) -> Option<Self> {
        fields.signature(b"TREE")?;
        if fields.u8()? != kind {
            return None;
        }
        let level = fields.u8()?;
        let count = fields.u16()?;
        // Left and right.
        fields.address()?;
        fields.address()?;
        let entry = |_| Some(OldEntry { key: fields.take(key_bytes)?.to_vec(), child: fields.address()? });
        let entries = (0..count).map(entry).collect::<Option<_>>()?;
        Some(Self { level, entries })
    }
}

/// Shape of the nodes of a new tree.
struct Shape {
    node_bytes: usize,
    record_bytes: usize,
    /// For each level, from the leaves: most records of a node, and of all under it.
    levels: Vec<(u64, u64)>,
}

/// A node to be read.
#[derive(Clone, Copy)]
struct Place {
    address: u64,
    records: u64,
    level: usize,
}

/// The records of a new tree, in no order.
pub(super) fn records(file: &File, header: u64) -> Result<Vec<Vec<u8>>, Error> {
    let malformed = || file.malformed("tree", header);
    let bytes = file.bytes_up_to(header, 64)?;
    let (shape, root) = Shape::parse(file, &bytes).ok_or_else(malformed)?;
    let (mut records, mut places) = (Vec::new(), vec![root]);
    while let Some(place) = places.pop().filter(|place| file.offset(place.address).is_some()) {
        let bytes = file.bytes_up_to(place.address, shape.node_bytes)?;
        shape.read(file, &bytes, place, &mut records, &mut places).ok_or_else(malformed)?;
    }
    Ok(records)
}

/// Signature, version and type, and the checksum at the end of a node.
const NODE_FRAME_BYTES: usize = 10;

impl Shape {
    fn parse(file: &File, header: &[u8]) -> Option<(Self, Place)> {
        let mut fields = file.fields(header);
        fields.signature(b"BTHD")?;
        fields.skip(2)?;
        let node_bytes = fields.u32()? as usize;
        let record_bytes = usize::from(fields.u16()?);
        let depth = usize::from(fields.u16()?);
        fields.skip(2)?;
        let root = Place { address: fields.address()?, records: fields.u16()?.into(), level: depth };
        let leaf_max = (node_bytes.checked_sub(NODE_FRAME_BYTES)?.checked_div(record_bytes)?) as u64;
        let mut shape = Self { node_bytes, record_bytes, levels: vec![(leaf_max, leaf_max)] };
        for _ in 0..depth.min(64) {
            shape.add_level(file.widths.address)?;
        }
        (depth < shape.levels.len()).then_some((shape, root))
    }

    fn add_level(&mut self, address_bytes: usize) -> Option<()> {
        let pointer = address_bytes + self.count_bytes(self.levels.len());
        let room = self.node_bytes.checked_sub(NODE_FRAME_BYTES + pointer)?;
        let most = (room / (self.record_bytes + pointer)) as u64;
        let (_, under) = *self.levels.last()?;
        let all = (most + 1).checked_mul(under)?.checked_add(most)?;
        self.levels.push((most, all));
        Some(())
    }

    /// Bytes of the two counts of a pointer to a child of a node at this level.
    fn count_bytes(&self, level: usize) -> usize {
        let most = |level: usize| self.levels.get(level).copied().unwrap_or_default();
        let (leaf, _) = most(0);
        let (_, under) = most(level - 1);
        bytes_for(leaf) + if level > 1 { bytes_for(under) } else { 0 }
    }

    fn read(
        &self,
        file: &File,
        bytes: &[u8],
        place: Place,
        records: &mut Vec<Vec<u8>>,
        places: &mut Vec<Place>,
    ) -> Option<()> {
        let mut fields = file.fields(bytes);
        fields.signature(if place.level == 0 { b"BTLF" } else { b"BTIN" })?;
        fields.skip(2)?;
        for _ in 0..place.records {
            records.push(fields.take(self.record_bytes)?.to_vec());
        }
        let Some(below) = place.level.checked_sub(1) else { return Some(()) };
        let (leaf, _) = *self.levels.first()?;
        let count_bytes = bytes_for(leaf);
        for _ in 0..=place.records {
            let address = fields.address()?;
            let count = fields.number(count_bytes)?;
            fields.skip(self.count_bytes(place.level) - count_bytes)?;
            places.push(Place { address, records: count, level: below });
        }
        Some(())
    }
}
