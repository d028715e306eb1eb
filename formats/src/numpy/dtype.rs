//! The type of a number, and how it is read.

use crate::TimeUnit;

/// Type of a number in an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Dtype {
    pub kind: Kind,
    /// 1, 2, 4 or 8.
    pub bytes: usize,
    pub big_endian: bool,
    /// What one is, where the type says it (`timedelta64[us]`).
    pub unit: Option<TimeUnit>,
}

/// Kind of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Signed,
    Unsigned,
    Bool,
    Float,
}

/// Bytes of a type by its code, such as `<i8`; also of types that are not read.
pub(super) fn bytes_of(code: &str) -> Option<u64> {
    let code = code.trim_start_matches(['<', '>', '|', '=']);
    let (kind, digits) = code.split_at_checked(1)?;
    let digits = digits.split('[').next()?;
    let number: u64 = digits.parse().ok().filter(|bytes| *bytes <= 1 << 20)?;
    Some(if kind == "U" { number * 4 } else { number })
}

impl Dtype {
    /// A number's type by its code; `None` for what is not read.
    pub fn parse(code: &str) -> Option<Self> {
        let big_endian = code.starts_with('>');
        let (kind, unit) = match code.trim_start_matches(['<', '>', '|', '=']).split_at_checked(1)? {
            ("i", _) => (Kind::Signed, None),
            ("u", _) => (Kind::Unsigned, None),
            ("b", _) => (Kind::Bool, None),
            ("f", _) => (Kind::Float, None),
            ("m" | "M", rest) => {
                let (_, unit) = rest.split_once('[')?;
                (Kind::Signed, Some(unit.strip_suffix(']')?.parse().ok()?))
            }
            _ => return None,
        };
        let bytes = usize::try_from(bytes_of(code)?).ok()?;
        let is_read = match kind {
            Kind::Signed | Kind::Unsigned => matches!(bytes, 1 | 2 | 4 | 8),
            Kind::Bool => bytes == 1,
            Kind::Float => matches!(bytes, 4 | 8),
        };
        is_read.then_some(Self { kind, bytes, big_endian, unit })
    }

    /// The number in these bytes.
    pub fn number(self, bytes: &[u8]) -> Option<Number> {
        let mut wide = [0; 8];
        wide.get_mut(..self.bytes)?.copy_from_slice(bytes.get(..self.bytes)?);
        if self.big_endian {
            wide.get_mut(..self.bytes)?.reverse();
        }
        let raw = u64::from_le_bytes(wide);
        let unused = 64 - 8 * self.bytes as u32;
        Some(match self.kind {
            Kind::Signed => Number::Int(i128::from(((raw << unused) as i64) >> unused)),
            Kind::Unsigned => Number::Int(i128::from(raw)),
            Kind::Bool => Number::Int(i128::from(raw != 0)),
            Kind::Float if self.bytes == 4 => Number::Float(f32::from_bits(raw as u32).into()),
            Kind::Float => Number::Float(f64::from_bits(raw)),
        })
    }
}

/// A number of an array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Number {
    Int(i128),
    Float(f64),
}

impl Number {
    /// The number, where it is an integer of 64 bits.
    pub fn integer(self) -> Option<i64> {
        match self {
            Self::Int(int) => i64::try_from(int).ok(),
            Self::Float(float) => (float.fract() == 0.0).then(|| nearest(float))?,
        }
    }

    /// A time of this unit, as the nearest µs.
    pub fn micros(self, unit: TimeUnit) -> Option<i64> {
        match (self, unit) {
            (Self::Int(int), TimeUnit::Nanoseconds) => {
                // Half a µs is rounded away from 0, as elsewhere.
                i64::try_from((int.abs() + 500) / 1_000 * int.signum()).ok()
            }
            (Self::Int(int), _) => i64::try_from(int.checked_mul(per_unit(unit) as i128)?).ok(),
            (Self::Float(float), TimeUnit::Nanoseconds) => nearest(float / 1e3),
            (Self::Float(float), _) => nearest(float * per_unit(unit) as f64),
        }
    }
}

/// µs in a unit that is not shorter.
fn per_unit(unit: TimeUnit) -> u64 {
    match unit {
        TimeUnit::Seconds => 1_000_000,
        TimeUnit::Milliseconds => 1_000,
        TimeUnit::Microseconds | TimeUnit::Nanoseconds => 1,
    }
}

/// The nearest integer; `None` for what is none (NaN) or beyond 64 bits.
fn nearest(float: f64) -> Option<i64> {
    let rounded = float.round();
    (rounded.abs() < 9.2e18).then_some(rounded as i64)
}
