//! The header of an array: a dictionary of Python in text.

use super::dtype::Dtype;
use super::refuse;
use crate::{Error, ErrorKind};
use std::path::Path;

/// First bytes of an array.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// What the header of an array tells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub elements: Elements,
    pub fortran_order: bool,
    pub shape: Vec<u64>,
    /// Text of the comment after the dictionary.
    pub comment: String,
    /// Bytes from the magic to the first element.
    pub len: u64,
}

/// What an element is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Elements {
    Number(Dtype),
    /// Fields with their names and offsets, and bytes of an element.
    Record(Vec<Field>, u64),
}

/// A field of a structured array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Field {
    pub name: String,
    /// None for what we do not read.
    pub dtype: Option<Dtype>,
    pub offset: u64,
}

/// Bytes needed to tell how long a header is.
pub(super) const PREFIX_BYTES: usize = 12;

/// Length in bytes of the header that begins so, with its prefix; `None` where this is no array.
pub(super) fn len(prefix: &[u8]) -> Option<usize> {
    let rest = prefix.strip_prefix(MAGIC)?;
    match *rest {
        [1, _, a, b, ..] => Some(10 + usize::from(u16::from_le_bytes([a, b]))),
        [2 | 3, _, a, b, c, d, ..] => usize::try_from(u32::from_le_bytes([a, b, c, d])).ok()?.checked_add(12),
        _ => None,
    }
}

impl Header {
    /// Reads a whole header.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, Error> {
        let start = if bytes.get(6) == Some(&1) { 10 } else { 12 };
        let malformed = || {
            let what = "has an array header that is no dictionary of NumPy,";
            Error::new(ErrorKind::Malformed, path, what, "save it again with numpy.save")
        };
        let text = bytes.get(start..).ok_or_else(malformed)?;
        let mut parser = Parser { rest: text, depth: 0 };
        let Some(Value::Dict(entries)) = parser.value() else { return Err(malformed()) };
        let comment = parser.rest.trim_ascii().strip_prefix(b"#").unwrap_or_default();
        let get = |key: &str| entries.iter().find(|(name, _)| name == key).map(|(_, value)| value);
        let shape = match get("shape") {
            Some(Value::Sequence(sides)) => sides.iter().map(Value::int).collect::<Option<Vec<_>>>(),
            _ => None,
        };
        Ok(Self {
            elements: elements(get("descr").ok_or_else(malformed)?, path)?,
            fortran_order: matches!(get("fortran_order"), Some(Value::Bool(true))),
            shape: shape.ok_or_else(malformed)?,
            comment: String::from_utf8_lossy(comment).trim().to_owned(),
            len: bytes.len() as u64,
        })
    }
}

fn elements(descr: &Value, path: &Path) -> Result<Elements, Error> {
    let fields = match descr {
        Value::Text(code) => {
            return Dtype::parse(code).map(Elements::Number).ok_or_else(|| unread(code, path));
        }
        Value::Sequence(fields) => fields,
        _ => return Err(refuse(path, "has elements of an unknown kind", "save it as numbers")),
    };
    let (mut offset, mut found) = (0u64, Vec::new());
    for field in fields {
        let (field, bytes) = Field::parse(field, offset).ok_or_else(|| {
            let remedy = "save t, x, y and p as fields of one number each";
            refuse(path, "has fields that are neither numbers nor bytes,", remedy)
        })?;
        found.push(field);
        offset = offset.saturating_add(bytes);
    }
    Ok(Elements::Record(found, offset))
}

fn unread(code: &str, path: &Path) -> Error {
    match code.ends_with('O') {
        true => refuse(
            path,
            "holds Python objects (a pickle), which can run code and are not read;",
            "save the columns as numbers, as numpy.save does with allow_pickle=False",
        ),
        false => {
            refuse(path, format!("has elements of type `{code}`, which is not read"), "save it as integers")
        }
    }
}

impl Field {
    /// A field of a record, and its bytes: `(name, type)` or `((title, name), type)`; with a shape it is not read.
    fn parse(field: &Value, offset: u64) -> Option<(Self, u64)> {
        let Value::Sequence(parts) = field else { return None };
        let (name, code, shape) = match parts.as_slice() {
            [name, Value::Text(code)] => (name, code, None),
            [name, Value::Text(code), Value::Sequence(shape)] => (name, code, Some(shape)),
            _ => return None,
        };
        let name = match name {
            Value::Text(name) => name.clone(),
            Value::Sequence(names) => match names.as_slice() {
                [_, Value::Text(name)] => name.clone(),
                _ => return None,
            },
            _ => return None,
        };
        let bytes = super::dtype::bytes_of(code)?;
        let count =
            shape.into_iter().flatten().map(Value::int).try_fold(1u64, |n, side| n.checked_mul(side?))?;
        let dtype = if shape.is_some() { None } else { Dtype::parse(code) };
        Some((Self { name, dtype, offset }, bytes.checked_mul(count)?))
    }
}

/// A value of Python, as far as headers have them.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Value {
    Text(String),
    Int(u64),
    Bool(bool),
    Sequence(Vec<Value>),
    Dict(Vec<(String, Value)>),
}

impl Value {
    fn int(&self) -> Option<u64> {
        match self {
            Self::Int(int) => Some(*int),
            _ => None,
        }
    }
}

/// Deepest nesting of values.
const DEPTH_MAX: usize = 8;

struct Parser<'a> {
    rest: &'a [u8],
    depth: usize,
}

impl Parser<'_> {
    /// The next byte that is no space, if it is this one.
    fn take(&mut self, byte: u8) -> bool {
        self.rest = self.rest.trim_ascii_start();
        let rest = self.rest.strip_prefix(&[byte]);
        self.rest = rest.unwrap_or(self.rest);
        rest.is_some()
    }

    fn value(&mut self) -> Option<Value> {
        self.rest = self.rest.trim_ascii_start();
        match self.rest.first()? {
            b'\'' | b'"' => self.text().map(Value::Text),
            b'0'..=b'9' => self.int().map(Value::Int),
            b'(' | b'[' | b'{' if self.depth == DEPTH_MAX => None,
            b'(' => self.nested(Self::sequence, b')'),
            b'[' => self.nested(Self::sequence, b']'),
            b'{' => self.nested(Self::dict, b'}'),
            _ => self.word(),
        }
    }

    fn nested(&mut self, read: fn(&mut Self, u8) -> Option<Value>, end: u8) -> Option<Value> {
        self.rest = self.rest.get(1..)?;
        self.depth += 1;
        let value = read(self, end);
        self.depth -= 1;
        value
    }

    fn sequence(&mut self, end: u8) -> Option<Value> {
        let mut values = Vec::new();
        while !self.take(end) {
            values.push(self.value()?);
            if !self.take(b',') {
                return self.take(end).then_some(Value::Sequence(values));
            }
        }
        Some(Value::Sequence(values))
    }

    fn dict(&mut self, end: u8) -> Option<Value> {
        let mut entries = Vec::new();
        while !self.take(end) {
            self.rest = self.rest.trim_ascii_start();
            let key = self.text()?;
            if !self.take(b':') {
                return None;
            }
            entries.push((key, self.value()?));
            if !self.take(b',') {
                return self.take(end).then_some(Value::Dict(entries));
            }
        }
        Some(Value::Dict(entries))
    }

    fn text(&mut self) -> Option<String> {
        let (quote, rest) = self.rest.split_first()?;
        let end = rest.iter().position(|byte| byte == quote)?;
        let text = rest.get(..end)?;
        self.rest = rest.get(end + 1..)?;
        matches!(quote, b'\'' | b'"').then(|| String::from_utf8_lossy(text).into_owned())
    }

    fn int(&mut self) -> Option<u64> {
        let digits = self.rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
        let (text, rest) = self.rest.split_at(digits);
        // Python 2 wrote an L after long ones.
        self.rest = rest.strip_prefix(b"L").unwrap_or(rest);
        std::str::from_utf8(text).ok()?.parse().ok()
    }

    fn word(&mut self) -> Option<Value> {
        for (word, value) in [(b"True".as_slice(), true), (b"False", false)] {
            if let Some(rest) = self.rest.strip_prefix(word) {
                self.rest = rest;
                return Some(Value::Bool(value));
            }
        }
        None
    }
}
