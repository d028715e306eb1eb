//! Groups: the names of what is in them, and where that is.
//!
//! Spec: sections III.A to III.D (old groups: a tree of names), IV.A.2.g (new ones: links in the header or in a heap)

use super::fields::{Fields, UNDEFINED};
use super::file::File;
use super::heap::{self, FractalHeap};
use super::object::{Kind, Object};
use super::tree;
use crate::Error;

/// A name in a group.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Link {
    pub name: String,
    /// Address of the object's header.
    pub object: u64,
}

/// What is in a group, by name; nothing for an object that is no group. Links to other files are left out, and soft
/// links, which are second names.
pub(super) fn links(file: &File, object: &Object) -> Result<Vec<Link>, Error> {
    let mut links = Vec::new();
    if let Some(message) = object.get(file, Kind::SymbolTable)? {
        let mut fields = file.fields(&message.body);
        let table = fields.address().zip(fields.address());
        let (tree, names) = table.ok_or_else(|| file.malformed("group", object.address))?;
        let names = heap::local(file, names)?;
        old_links(file, tree, &names, &mut links)?;
    }
    for message in object.all(Kind::Link) {
        let link = Link::parse(file.fields(&message.body));
        links.extend(link.ok_or_else(|| file.malformed("link", message.address))?);
    }
    if let Some(message) = object.get(file, Kind::LinkInfo)? {
        dense_links(file, &message.body, &mut links)?;
    }
    links.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(links)
}

/// Walks the tree of an old group, whose leaves are nodes of entries.
fn old_links(file: &File, root: u64, names: &[u8], links: &mut Vec<Link>) -> Result<(), Error> {
    let mut nodes = vec![root];
    while let Some(address) = nodes.pop() {
        let node = tree::OldNode::read(file, "group", address, 0, file.widths.length)?;
        let children = node.entries.iter().map(|entry| entry.child);
        match node.level {
            0 => {
                for child in children {
                    symbols(file, child, names, links)?;
                }
            }
            _ => nodes.extend(children),
        }
    }
    Ok(())
}

/// The entries of one node.
fn symbols(file: &File, address: u64, names: &[u8], links: &mut Vec<Link>) -> Result<(), Error> {
    let malformed = || file.malformed("group", address);
    let head = file.bytes("group", address, 8)?;
    let mut fields = file.fields(&head);
    let count = fields.signature(b"SNOD").and_then(|()| fields.skip(2)).and_then(|()| fields.u16());
    let entry_bytes = file.widths.length + file.widths.address + 24;
    let bytes = file.bytes("group", address, 8 + usize::from(count.ok_or_else(malformed)?) * entry_bytes)?;
    for entry in bytes.get(8..).unwrap_or_default().chunks_exact(entry_bytes) {
        links.extend(symbol(file, entry, names).ok_or_else(malformed)?);
    }
    Ok(())
}

fn symbol(file: &File, entry: &[u8], names: &[u8]) -> Option<Option<Link>> {
    let mut entry = file.fields(entry);
    let name_at = usize::try_from(entry.length()?).ok()?;
    let object = entry.address()?;
    let is_soft = entry.u32()? == 2;
    let name = file.fields(names.get(name_at..)?).text_to_zero(1)?;
    Some((!is_soft && object != UNDEFINED).then_some(Link { name, object }))
}

impl Link {
    /// A link message; nothing if it is none to an object of this file.
    fn parse(mut fields: Fields<'_>) -> Option<Option<Self>> {
        if fields.u8()? != 1 {
            return None;
        }
        let flags = fields.u8()?;
        let kind = if flags & 8 != 0 { fields.u8()? } else { 0 };
        // Order of creation, character set.
        fields.skip(8 * usize::from(flags >> 2 & 1) + usize::from(flags >> 4 & 1))?;
        let len = usize::try_from(fields.number(1 << (flags & 3))?).ok()?;
        let name = fields.text(len)?;
        if kind != 0 {
            return Some(None);
        }
        Some(Some(Self { name, object: fields.address()? }))
    }
}

/// Links of a group with many: in a heap, found by a tree.
fn dense_links(file: &File, info: &[u8], links: &mut Vec<Link>) -> Result<(), Error> {
    let mut fields = file.fields(info);
    let parsed = (|| {
        fields.skip(1)?;
        let flags = fields.u8()?;
        fields.skip(8 * usize::from(flags & 1))?;
        Some((fields.address()?, fields.address()?))
    })();
    let Some((heap, tree)) = parsed.filter(|(heap, _)| *heap != UNDEFINED) else { return Ok(()) };
    let heap = FractalHeap::open(file, heap)?;
    for record in tree::records(file, tree)? {
        // A hash of the name, then where in the heap.
        let id = record.get(4..).unwrap_or_default();
        let bytes = heap.object(file, id)?;
        let link = Link::parse(file.fields(&bytes));
        links.extend(link.ok_or_else(|| file.malformed("link", tree))?);
    }
    Ok(())
}
