//! Datatypes: what an element is.
//!
//! Spec: section IV.A.2.d of the file format

use super::fields::Fields;

/// The types that events and what belongs to them are stored in.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Datatype {
    Number(Number),
    /// Text of this many bytes.
    Text(usize),
    /// Text of any length, kept elsewhere in the file.
    TextElsewhere,
    Compound {
        bytes: usize,
        members: Vec<Member>,
    },
    /// A type that no events are in.
    Other {
        bytes: usize,
        name: &'static str,
    },
}

/// A number, as it is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Number {
    pub kind: NumberKind,
    pub big_endian: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NumberKind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl NumberKind {
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    pub const fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}

/// A member of a compound.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Member {
    pub name: String,
    pub offset: usize,
    pub datatype: Datatype,
}

/// How deep types may be nested.
const DEPTH_MAX: usize = 4;

impl Datatype {
    pub fn parse(fields: &mut Fields<'_>) -> Option<Self> {
        Self::nested(fields, 0)
    }

    /// Bytes of an element.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Number(number) => number.kind.bytes(),
            Self::Text(bytes) | Self::Compound { bytes, .. } | Self::Other { bytes, .. } => *bytes,
            Self::TextElsewhere => 16,
        }
    }

    fn nested(fields: &mut Fields<'_>, depth: usize) -> Option<Self> {
        if depth > DEPTH_MAX {
            return None;
        }
        let class_and_version = fields.u8()?;
        let version = class_and_version >> 4;
        let bits = fields.number(3)? as u32;
        let bytes = fields.u32()? as usize;
        let other = |name| Some(Self::Other { bytes, name });
        match class_and_version & 15 {
            0 => Self::integer(fields, bits, bytes),
            1 => Self::float(fields, bits, bytes),
            2 => fields.skip(2).and(other("times of HDF5")),
            3 => Some(Self::Text(bytes)),
            4 => fields.skip(4).and(other("bit fields")),
            5 => fields.skip((bits & 0xFF) as usize).and(other("opaque bytes")),
            6 => Self::compound(fields, version, bits, bytes, depth),
            7 => other("references"),
            8 => Self::enumeration(fields, version, bits, depth),
            9 => {
                let base = Self::nested(fields, depth + 1)?;
                let is_text = bits & 15 == 1 || matches!(base, Self::Text(_));
                if is_text { Some(Self::TextElsewhere) } else { other("lists of any length") }
            }
            10 => Self::array(fields, version, bytes, depth),
            _ => None,
        }
    }

    fn integer(fields: &mut Fields<'_>, bits: u32, bytes: usize) -> Option<Self> {
        let (offset, precision) = (fields.u16()?, fields.u16()?);
        let is_signed = bits & 8 != 0;
        let kind = match (bytes, is_signed) {
            (1, false) => NumberKind::U8,
            (1, true) => NumberKind::I8,
            (2, false) => NumberKind::U16,
            (2, true) => NumberKind::I16,
            (4, false) => NumberKind::U32,
            (4, true) => NumberKind::I32,
            (8, false) => NumberKind::U64,
            (8, true) => NumberKind::I64,
            _ => return Some(Self::Other { bytes, name: "integers of an odd width" }),
        };
        if offset != 0 || usize::from(precision) != 8 * bytes {
            return Some(Self::Other { bytes, name: "integers of an odd precision" });
        }
        Some(Self::Number(Number { kind, big_endian: bits & 1 != 0 }))
    }

    fn float(fields: &mut Fields<'_>, bits: u32, bytes: usize) -> Option<Self> {
        let (offset, precision) = (fields.u16()?, fields.u16()?);
        let (exponent_at, exponent) = (fields.u8()?, fields.u8()?);
        let (mantissa_at, mantissa, bias) = (fields.u8()?, fields.u8()?, fields.u32()?);
        let kind = match (precision, exponent_at, exponent, mantissa, bias) {
            (32, 23, 8, 23, 127) => NumberKind::F32,
            (64, 52, 11, 52, 1023) => NumberKind::F64,
            _ => return Some(Self::Other { bytes, name: "floating point numbers of an odd width" }),
        };
        let is_ieee = (offset, mantissa_at, bytes) == (0, 0, kind.bytes()) && bits & 0x40 == 0;
        is_ieee.then_some(Self::Number(Number { kind, big_endian: bits & 1 != 0 }))
    }

    fn compound(fields: &mut Fields<'_>, version: u8, bits: u32, bytes: usize, depth: usize) -> Option<Self> {
        let mut members = Vec::new();
        for _ in 0..bits & 0xFFFF {
            let name = fields.text_to_zero(if version < 3 { 8 } else { 1 })?;
            let width = if version < 3 { 4 } else { super::fields::bytes_for(bytes as u64) };
            let offset = usize::try_from(fields.number(width)?).ok()?;
            let is_array = version == 1 && fields.u8()? != 0;
            if version == 1 {
                fields.skip(3 + 4 + 4 + 16)?;
            }
            let mut datatype = Self::nested(fields, depth + 1)?;
            if is_array {
                datatype = Self::Other { bytes: datatype.bytes(), name: "arrays" };
            }
            if offset.checked_add(datatype.bytes())? > bytes {
                return None;
            }
            members.push(Member { name, offset, datatype });
        }
        Some(Self::Compound { bytes, members })
    }

    /// Names for numbers, as h5py stores bool: the numbers are what counts.
    fn enumeration(fields: &mut Fields<'_>, version: u8, bits: u32, depth: usize) -> Option<Self> {
        let base = Self::nested(fields, depth + 1)?;
        let names = bits & 0xFFFF;
        for _ in 0..names {
            fields.text_to_zero(if version < 3 { 8 } else { 1 })?;
        }
        fields.skip((names as usize).checked_mul(base.bytes())?)?;
        Some(base)
    }

    fn array(fields: &mut Fields<'_>, version: u8, bytes: usize, depth: usize) -> Option<Self> {
        let dimensions = usize::from(fields.u8()?);
        fields.skip(if version < 3 { 3 + 8 * dimensions } else { 4 * dimensions })?;
        Self::nested(fields, depth + 1)?;
        Some(Self::Other { bytes, name: "arrays" })
    }
}
