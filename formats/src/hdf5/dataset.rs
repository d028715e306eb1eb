//! Datasets: shape, type of the elements, where they are and through which filters they went.
//!
//! Spec: sections IV.A.2.b (dataspace), IV.A.2.i (layout) and IV.A.2.l (filters) of the file format

use super::chunks::{self, Grid};
use super::datatype::Datatype;
use super::fields::Fields;
use super::file::File;
use super::filter::Filter;
use super::object::{Kind, Object};
use crate::Error;

/// A dataset, of which nothing but the header was read.
#[derive(Clone, Debug)]
pub(super) struct Dataset {
    /// Its path in the file.
    pub name: String,
    /// Length of each dimension; empty for a single element.
    pub dimensions: Vec<u64>,
    pub datatype: Datatype,
    pub storage: Storage,
    pub filters: Vec<Filter>,
}

/// Where the elements are.
#[derive(Clone, Debug)]
pub(super) enum Storage {
    /// In one piece.
    Whole { address: u64, bytes: u64 },
    /// In chunks of one shape.
    Chunks(chunks::Chunking),
}

impl Dataset {
    /// Whether an object is one.
    pub fn is(object: &Object) -> bool {
        object.has(Kind::Layout)
    }

    pub fn open(file: &File, name: &str, object: &Object) -> Result<Self, Error> {
        let malformed = || file.malformed(&format!("dataset {name}"), object.address);
        if object.has(Kind::ExternalFiles) {
            return Err(file.unsupported(format!("the dataset {name} in other files")));
        }
        let message = |kind| object.get(file, kind)?.ok_or_else(malformed);
        let dimensions = dimensions(file.fields(&message(Kind::Dataspace)?.body)).ok_or_else(malformed)?;
        let datatype = message(Kind::Datatype)?;
        let datatype = Datatype::parse(&mut file.fields(&datatype.body)).ok_or_else(malformed)?;
        let filters = match object.get(file, Kind::Filters)? {
            Some(message) => pipeline(file, name, file.fields(&message.body))?.ok_or_else(malformed)?,
            None => Vec::new(),
        };
        let layout = message(Kind::Layout)?;
        let class = Class::parse(file, &layout.body, layout.address).ok_or_else(malformed)?;
        let storage = match class {
            Class::Storage(storage) => storage,
            Class::Unsupported(what) => {
                return Err(file.unsupported(format!("the dataset {name} in {what}")));
            }
        };
        Ok(Self { name: name.to_owned(), dimensions, datatype, storage, filters })
    }

    /// Its chunks' places in a grid; none where it is in one piece.
    pub fn grid(&self) -> Option<Grid> {
        match &self.storage {
            Storage::Whole { .. } => None,
            Storage::Chunks(chunking) => Some(Grid::new(&self.dimensions, chunking)),
        }
    }

    /// The bytes of a small one that is stored in one piece.
    pub fn small(&self, file: &File) -> Result<Option<Vec<u8>>, Error> {
        match self.storage {
            Storage::Whole { address, bytes } if bytes <= 4096 => {
                file.bytes(&format!("dataset {}", self.name), address, bytes as usize).map(Some)
            }
            _ => Ok(None),
        }
    }
}

/// Lengths of the dimensions that a dataspace has: none for a single element.
pub(super) fn dimensions(mut fields: Fields<'_>) -> Option<Vec<u64>> {
    let (version, rank, _flags) = (fields.u8()?, fields.u8()?, fields.u8()?);
    match version {
        1 => fields.skip(5)?,
        // Of nothing at all.
        2 if fields.u8()? == 2 => return Some(vec![0]),
        2 => {}
        _ => return None,
    }
    (0..rank).map(|_| fields.length()).collect()
}

/// What a layout message says.
enum Class {
    Storage(Storage),
    Unsupported(&'static str),
}

impl Class {
    fn parse(file: &File, body: &[u8], at: u64) -> Option<Self> {
        let mut fields = file.fields(body);
        let version = fields.u8()?;
        if !(3..=5).contains(&version) {
            return Some(Self::Unsupported("the layout of HDF5 before 1.6"));
        }
        let storage = match fields.u8()? {
            // In the header itself.
            0 => Storage::Whole { bytes: fields.u16()?.into(), address: at.checked_add(4)? },
            1 => Storage::Whole { address: fields.address()?, bytes: fields.length()? },
            2 => Storage::Chunks(chunks::Chunking::parse(fields, version)?),
            _ => return Some(Self::Unsupported("parts of other datasets (a virtual layout)")),
        };
        Some(Self::Storage(storage))
    }
}

/// The filters, in the order of writing; `None` where the message is damaged.
fn pipeline(file: &File, name: &str, mut fields: Fields<'_>) -> Result<Option<Vec<Filter>>, Error> {
    let mut filters = Vec::new();
    let Some((version, count)) = fields.u8().zip(fields.u8()) else { return Ok(None) };
    if version == 1 && fields.skip(6).is_none() {
        return Ok(None);
    }
    for _ in 0..count {
        let Some((id, values)) = filter(&mut fields, version) else { return Ok(None) };
        let filter = Filter::new(id, &values);
        filters.push(
            filter.map_err(|what| file.unsupported(format!("the dataset {name} compressed by {what}")))?,
        );
    }
    Ok(Some(filters))
}

/// The number of a filter and its settings.
fn filter(fields: &mut Fields<'_>, version: u8) -> Option<(u16, Vec<u32>)> {
    let id = fields.u16()?;
    let name_bytes = if version == 1 || id >= 256 { fields.u16()? } else { 0 };
    fields.skip(2)?;
    let count = usize::from(fields.u16()?);
    let pad = if version == 1 { 8 } else { 1 };
    fields.skip(usize::from(name_bytes).next_multiple_of(pad))?;
    let values = (0..count).map(|_| fields.u32()).collect::<Option<_>>()?;
    fields.skip(if version == 1 && count % 2 == 1 { 4 } else { 0 })?;
    Some((id, values))
}
