//! Numbers of any width, one by one: the slow and plain way.

use super::datatype::{Number, NumberKind};

/// A number that was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value {
    Int(i64),
    Float(f64),
    /// Beyond 63 bits, or cut short.
    None,
}

impl Value {
    /// As a whole number, if it is one.
    pub fn whole(self) -> Option<i64> {
        match self {
            Self::Int(int) => Some(int),
            // Both bounds are exact.
            Self::Float(float) if float.trunc() == float && float.abs() < 9.2e18 => Some(float as i64),
            _ => None,
        }
    }

    pub fn as_f64(self) -> f64 {
        match self {
            Self::Int(int) => int as f64,
            Self::Float(float) => float,
            Self::None => f64::NAN,
        }
    }
}

/// The number in the first of these bytes.
pub(super) fn value(number: Number, bytes: &[u8]) -> Value {
    let len = number.kind.bytes();
    let mut raw = [0; 8];
    let (Some(bytes), Some(low)) = (bytes.get(..len), raw.get_mut(..len)) else { return Value::None };
    low.copy_from_slice(bytes);
    if number.big_endian {
        low.reverse();
    }
    let raw = u64::from_le_bytes(raw);
    match number.kind {
        NumberKind::U8 | NumberKind::U16 | NumberKind::U32 => Value::Int(raw as i64),
        NumberKind::U64 => i64::try_from(raw).map_or(Value::None, Value::Int),
        NumberKind::I8 => Value::Int((raw as i8).into()),
        NumberKind::I16 => Value::Int((raw as i16).into()),
        NumberKind::I32 => Value::Int((raw as i32).into()),
        NumberKind::I64 => Value::Int(raw as i64),
        NumberKind::F32 => Value::Float(f32::from_bits(raw as u32).into()),
        NumberKind::F64 => Value::Float(f64::from_bits(raw)),
    }
}
