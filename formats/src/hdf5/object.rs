//! Object headers: what a group or a dataset is, as a list of messages.
//!
//! Spec: section IV.A of the file format

use super::fields::Fields;
use super::file::File;
use crate::Error;

/// What a message is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Dataspace,
    LinkInfo,
    Datatype,
    Link,
    ExternalFiles,
    Layout,
    Filters,
    Attribute,
    Continuation,
    SymbolTable,
    AttributeInfo,
    Other,
}

impl Kind {
    fn from_number(number: u16) -> Self {
        match number {
            0x01 => Self::Dataspace,
            0x02 => Self::LinkInfo,
            0x03 => Self::Datatype,
            0x06 => Self::Link,
            0x07 => Self::ExternalFiles,
            0x08 => Self::Layout,
            0x0B => Self::Filters,
            0x0C => Self::Attribute,
            0x10 => Self::Continuation,
            0x11 => Self::SymbolTable,
            0x15 => Self::AttributeInfo,
            _ => Self::Other,
        }
    }
}

/// One message of an object's header.
#[derive(Clone, Debug)]
pub(super) struct Message {
    pub kind: Kind,
    pub body: Vec<u8>,
    /// Address of the body.
    pub address: u64,
    /// Whether the body only tells where the message is.
    shared: bool,
}

/// The messages of an object.
#[derive(Debug)]
pub(super) struct Object {
    pub address: u64,
    messages: Vec<Message>,
}

/// Most parts of a header.
const PARTS_MAX: usize = 1000;

impl Object {
    pub fn read(file: &File, address: u64) -> Result<Self, Error> {
        let mut object = Self { address, messages: Vec::new() };
        let head = file.bytes_up_to(address, 32)?;
        let version = Version::parse(file, &head).ok_or_else(|| file.malformed("object header", address))?;
        let mut parts = vec![(address, version.prefix, version.bytes)];
        for at in 0..PARTS_MAX {
            let Some(&(start, prefix, len)) = parts.get(at) else { break };
            let Some(len) = prefix.checked_add(len) else {
                return Err(file.malformed("object header", start));
            };
            let bytes = file.bytes("object header", start, len)?;
            let from = object.messages.len();
            let mut fields = file.fields(&bytes);
            let read = fields
                .skip(prefix)
                .and_then(|()| object.add(&version, fields, start.saturating_add(prefix as u64)));
            read.ok_or_else(|| file.malformed("object header", start))?;
            for message in object.messages.get(from..).unwrap_or_default() {
                if message.kind == Kind::Continuation {
                    let mut fields = file.fields(&message.body);
                    let part = fields.address().zip(fields.length());
                    let (next, len) = part.ok_or_else(|| file.malformed("object header", start))?;
                    let (prefix, end) = version.continued;
                    let len = usize::try_from(len).unwrap_or(usize::MAX).saturating_sub(prefix + end);
                    parts.push((next, prefix, len));
                }
            }
        }
        Ok(object)
    }

    /// Adds the messages of one part.
    fn add(&mut self, version: &Version, mut fields: Fields<'_>, address: u64) -> Option<()> {
        let whole = fields.rest().len();
        while fields.rest().len() >= version.message_prefix {
            let number = if version.is_first { fields.u16()? } else { fields.u8()?.into() };
            let len = fields.u16()?;
            let flags = fields.u8()?;
            fields.skip(version.message_prefix - if version.is_first { 5 } else { 4 })?;
            let address = address.saturating_add((whole - fields.rest().len()) as u64);
            let Some(body) = fields.take(len.into()) else {
                // A gap at the end of a part may be shorter than a message.
                return (!version.is_first).then_some(());
            };
            let (kind, shared) = (Kind::from_number(number), flags & 2 != 0);
            if kind != Kind::Other {
                self.messages.push(Message { kind, body: body.to_vec(), address, shared });
            }
        }
        Some(())
    }

    pub fn has(&self, kind: Kind) -> bool {
        self.messages.iter().any(|message| message.kind == kind)
    }

    /// Messages of a kind, in order.
    pub fn all(&self, kind: Kind) -> impl Iterator<Item = &Message> {
        self.messages.iter().filter(move |message| message.kind == kind)
    }

    /// The first message of a kind, if there is one: from the object it is shared with where that is so.
    pub fn get(&self, file: &File, kind: Kind) -> Result<Option<Message>, Error> {
        let Some(message) = self.all(kind).next() else { return Ok(None) };
        if !message.shared {
            return Ok(Some(message.clone()));
        }
        let address =
            shared_address(file, message).ok_or_else(|| file.unsupported("shared messages in a heap"))?;
        let other = Self::read(file, address)?;
        let found = other.all(kind).find(|message| !message.shared);
        found.cloned().map(Some).ok_or_else(|| file.malformed("shared message", message.address))
    }
}

/// Where the object is that a shared message is kept in, as a committed datatype is.
fn shared_address(file: &File, message: &Message) -> Option<u64> {
    let mut fields = file.fields(&message.body);
    match (fields.u8()?, fields.u8()?) {
        (1, _) => fields.skip(6)?,
        (2, _) | (3, 0 | 2) => {}
        _ => return None,
    }
    fields.address()
}

/// How a header of this version is laid out.
struct Version {
    is_first: bool,
    /// Bytes before the first message.
    prefix: usize,
    /// Bytes of messages in the first part.
    bytes: usize,
    message_prefix: usize,
    /// Bytes before and after the messages of a further part.
    continued: (usize, usize),
}

impl Version {
    fn parse(file: &File, head: &[u8]) -> Option<Self> {
        let mut fields = file.fields(head);
        if fields.signature(b"OHDR").is_some() {
            return Self::second(fields);
        }
        let mut fields = file.fields(head);
        if fields.u8()? != 1 {
            return None;
        }
        fields.skip(1 + 2 + 4)?;
        let bytes = fields.u32()? as usize;
        Some(Self { is_first: true, prefix: 16, bytes, message_prefix: 8, continued: (0, 0) })
    }

    fn second(mut fields: Fields<'_>) -> Option<Self> {
        if fields.u8()? != 2 {
            return None;
        }
        let flags = fields.u8()?;
        let before = 16 * usize::from(flags >> 5 & 1) + 4 * usize::from(flags >> 4 & 1);
        fields.skip(before)?;
        let width = 1 << (flags & 3);
        let bytes = usize::try_from(fields.number(width)?).ok()?;
        let message_prefix = 4 + 2 * usize::from(flags >> 2 & 1);
        Some(Self { is_first: false, prefix: 6 + before + width, bytes, message_prefix, continued: (4, 4) })
    }
}
