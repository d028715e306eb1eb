//! Attributes: what a file says about a group or a dataset beside the data.
//!
//! Spec: section IV.A.2.m of the file format

use super::datatype::{Datatype, Number};
use super::fields::UNDEFINED;
use super::file::File;
use super::heap::{self, FractalHeap};
use super::object::{Kind, Object};
use super::{dataset, number, tree};
use crate::Error;

/// What an attribute says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Attribute {
    pub name: String,
    pub value: Value,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Numbers(Vec<f64>),
    Text(String),
    /// Of a type that says nothing about events.
    Other,
}

/// Most numbers of an attribute that are looked at.
const NUMBERS_MAX: usize = 16;

/// The attributes of an object.
pub(super) fn attributes(file: &File, object: &Object) -> Result<Vec<Attribute>, Error> {
    let mut attributes = Vec::new();
    for message in object.all(Kind::Attribute) {
        attributes.push(parse(file, &message.body, message.address)?);
    }
    if let Some(info) = object.get(file, Kind::AttributeInfo)? {
        let mut fields = file.fields(&info.body);
        let parsed = (|| {
            fields.skip(1)?;
            let flags = fields.u8()?;
            fields.skip(2 * usize::from(flags & 1))?;
            Some((fields.address()?, fields.address()?))
        })();
        let (heap, tree) = parsed.ok_or_else(|| file.malformed("attribute", info.address))?;
        if heap != UNDEFINED {
            let heap = FractalHeap::open(file, heap)?;
            for record in tree::records(file, tree)? {
                // Where in the heap, then flags, order and hash.
                let bytes = heap.object(file, record.get(..8).unwrap_or_default())?;
                attributes.push(parse(file, &bytes, tree)?);
            }
        }
    }
    Ok(attributes)
}

fn parse(file: &File, body: &[u8], address: u64) -> Result<Attribute, Error> {
    let parts = Parts::parse(file, body).ok_or_else(|| file.malformed("attribute", address))?;
    let Parts { name, datatype, elements, data } = parts;
    let value = match datatype {
        Datatype::Number(of) => Value::Numbers(numbers(of, elements, data)),
        Datatype::Text(_) => Value::Text(text(data)),
        Datatype::TextElsewhere => {
            let mut fields = file.fields(data);
            let place = fields.u32().and_then(|_| fields.address().zip(fields.u32()));
            let (collection, number) = place.ok_or_else(|| file.malformed("attribute", address))?;
            Value::Text(text(&heap::global(file, collection, number)?))
        }
        _ => Value::Other,
    };
    Ok(Attribute { name, value })
}

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(bytes.get(..end).unwrap_or_default()).trim_end().to_owned()
}

pub(super) fn numbers(of: Number, elements: u64, data: &[u8]) -> Vec<f64> {
    let elements = usize::try_from(elements).unwrap_or(usize::MAX).min(NUMBERS_MAX);
    let pieces = data.chunks_exact(of.kind.bytes()).take(elements);
    pieces.map(|bytes| number::value(of, bytes).as_f64()).collect()
}

struct Parts<'a> {
    name: String,
    datatype: Datatype,
    elements: u64,
    data: &'a [u8],
}

impl<'a> Parts<'a> {
    fn parse(file: &File, body: &'a [u8]) -> Option<Self> {
        let mut fields = file.fields(body);
        let version = fields.u8()?;
        let flags = fields.u8()?;
        let [name, datatype, dataspace] = [fields.u16()?, fields.u16()?, fields.u16()?].map(usize::from);
        let pad = if version == 1 { 8 } else { 1 };
        fields.skip(usize::from(version == 3))?;
        let name = fields.text(name.next_multiple_of(pad))?;
        let datatype = fields.take(datatype.next_multiple_of(pad))?;
        // A committed type is elsewhere; nothing that we look for has one.
        let datatype = match version > 1 && flags & 1 != 0 {
            true => Datatype::Other { bytes: 0, name: "committed" },
            false => Datatype::parse(&mut file.fields(datatype))?,
        };
        let dataspace = fields.take(dataspace.next_multiple_of(pad))?;
        let dimensions = dataset::dimensions(file.fields(dataspace))?;
        let elements = dimensions.iter().try_fold(1u64, |product, side| product.checked_mul(*side))?;
        Some(Self { name, datatype, elements, data: fields.rest() })
    }
}
