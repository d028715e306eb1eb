//! Zip archives, as far as NumPy uses them: members stored or deflated, of any size (zip64).
//!
//! Spec: <https://pkware.cachefly.net/webdocs/casestudies/APPNOTE.TXT>

use super::refuse;
use crate::byte_cursor::Bytes as _;
use crate::input::Input;
use crate::output::Output;
use crate::packed::{Packing, Source, Unpack};
use crate::{Error, ErrorKind};
use std::path::Path;
use std::sync::Arc;

/// First bytes of an archive.
pub(super) const MAGIC: &[u8] = b"PK\x03\x04";

/// A member.
#[derive(Clone, Debug)]
pub(super) struct Member {
    pub name: String,
    method: u16,
    encrypted: bool,
    /// Checksum and length of what it holds.
    pub crc: u32,
    pub bytes: u64,
    /// Bytes in the archive.
    packed: u64,
    /// Offset of its local header.
    header: u64,
}

/// Largest table of contents.
const CONTENTS_BYTES_MAX: u64 = 1 << 20;
const END_BYTES: usize = 22;
const END64_BYTES: usize = 56;
const LOCATOR_BYTES: usize = 20;
const ENTRY_BYTES: usize = 46;
const LOCAL_BYTES: u64 = 30;

fn malformed(path: &Path, what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Malformed, path, what, "copy it again, or save it again with numpy.savez")
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..)?.first_chunk().map(|bytes| u16::from_le_bytes(*bytes))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|bytes| u32::from_le_bytes(*bytes))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    bytes.get(at..)?.first_chunk().map(|bytes| u64::from_le_bytes(*bytes))
}

/// The members, in order.
pub(super) fn members(input: &Input) -> Result<Vec<Member>, Error> {
    let path = input.path();
    let end = || malformed(path, "ends before the table of contents that a zip archive has at its end");
    let (offset, bytes) = contents(input)?.ok_or_else(end)?;
    if bytes > CONTENTS_BYTES_MAX {
        let what = format!("has a table of contents of {bytes} bytes");
        return Err(Error::new(
            ErrorKind::TooLarge,
            path,
            what,
            "save the events in an archive of their own",
        ));
    }
    let mut table = vec![0; bytes as usize];
    if input.read_at(offset, &mut table)? < table.len() {
        return Err(end());
    }
    let (mut rest, mut members) = (table.as_slice(), Vec::new());
    while rest.len() >= ENTRY_BYTES {
        let (member, len) = Member::parse(rest)
            .ok_or_else(|| malformed(path, "has a damaged table of contents").at(offset))?;
        members.push(member);
        rest = rest.get(len..).unwrap_or_default();
    }
    Ok(members)
}

/// Offset and length of the table of contents.
fn contents(input: &Input) -> Result<Option<(u64, u64)>, Error> {
    let len = usize::try_from(input.len()).unwrap_or(usize::MAX).min(END_BYTES + usize::from(u16::MAX));
    let start = input.len() - len as u64;
    let mut tail = vec![0; len];
    input.read_at(start, &mut tail)?;
    let Some(at) = tail.windows(END_BYTES).rposition(|end| end.starts_with(b"PK\x05\x06")) else {
        return Ok(None);
    };
    let end = tail.get(at..).unwrap_or_default();
    let (Some(bytes), Some(offset)) = (u32_at(end, 12), u32_at(end, 16)) else { return Ok(None) };
    if bytes != u32::MAX && offset != u32::MAX && u16_at(end, 10) != Some(u16::MAX) {
        return Ok(Some((offset.into(), bytes.into())));
    }
    let locator = at.checked_sub(LOCATOR_BYTES).and_then(|at| tail.get(at..));
    let locator = locator.filter(|locator| locator.starts_with(b"PK\x06\x07"));
    let Some(end64) = locator.and_then(|locator| u64_at(locator, 8)) else { return Ok(None) };
    let mut end = [0; END64_BYTES];
    let len = input.read_at(end64, &mut end)?;
    let is_one = len == END64_BYTES && end.starts_with(b"PK\x06\x06");
    Ok(u64_at(&end, 48).zip(u64_at(&end, 40)).filter(|_| is_one))
}

impl Member {
    /// An entry of the table of contents, and its length.
    fn parse(entry: &[u8]) -> Option<(Self, usize)> {
        entry.strip_prefix(b"PK\x01\x02")?;
        let lens = [28, 30, 32].map(|at| u16_at(entry, at).map(usize::from));
        let [name_len, extra_len, comment_len] = [lens[0]?, lens[1]?, lens[2]?];
        let name = entry.get(ENTRY_BYTES..ENTRY_BYTES + name_len)?;
        let extra = entry.get(ENTRY_BYTES + name_len..ENTRY_BYTES + name_len + extra_len)?;
        let (packed, unpacked, header) = (u32_at(entry, 20)?, u32_at(entry, 24)?, u32_at(entry, 42)?);
        // What does not fit 32 bits is in the extra field, in this order.
        let mut wide =
            zip64(extra).unwrap_or_default().as_chunks::<8>().0.iter().map(|one| u64::from_le_bytes(*one));
        let mut full = |short: u32| if short == u32::MAX { wide.next() } else { Some(short.into()) };
        let (bytes, packed, header) = (full(unpacked)?, full(packed)?, full(header)?);
        let name = String::from_utf8_lossy(name);
        let name = name.strip_suffix(".npy").unwrap_or(&name).to_owned();
        let encrypted = u16_at(entry, 8)? & 1 == 1;
        let (method, crc) = (u16_at(entry, 10)?, u32_at(entry, 16)?);
        let member = Self { name, method, encrypted, crc, bytes, packed, header };
        Some((member, ENTRY_BYTES + name_len + extra_len + comment_len))
    }

    /// Its bytes, unpacked: where they begin in the source and, if that is known, end.
    pub fn open(&self, input: &Arc<Input>) -> Result<(Source, u64, Option<u64>), Error> {
        let path = input.path();
        let mut local = [0; LOCAL_BYTES as usize];
        let len = Input::read_at(input, self.header, &mut local)?;
        let lens = u16_at(&local, 26).zip(u16_at(&local, 28));
        let Some((name, extra)) = lens.filter(|_| len == local.len() && local.starts_with(MAGIC)) else {
            return Err(
                malformed(path, format!("has no member {} where it says,", self.name)).at(self.header)
            );
        };
        let start = self.header.saturating_add(LOCAL_BYTES + u64::from(name) + u64::from(extra));
        let end = start.saturating_add(self.packed);
        if end > input.len() {
            let what = format!("ends inside its member {}", self.name);
            return Err(malformed(path, what).at(input.len()));
        }
        let remedy = "save it again with numpy.savez or numpy.savez_compressed";
        match self.method {
            _ if self.encrypted => {
                Err(refuse(path, format!("has an encrypted member {}", self.name), remedy))
            }
            0 => Ok((Source::Plain(input.clone()), start, Some(end))),
            8 => {
                let unpack = Unpack::new(input.clone(), Packing::Deflate, start..end);
                Ok((Source::Packed(unpack), 0, None))
            }
            method => {
                let what = format!("has a member {} that is compressed by method {method}", self.name);
                Err(refuse(path, what, remedy))
            }
        }
    }

    /// Its first bytes, unpacked, at most this many.
    pub fn head(&self, input: &Arc<Input>, bytes_max: usize) -> Result<Vec<u8>, Error> {
        let (mut source, start, end) = self.open(input)?;
        let left = end.map_or(usize::MAX, |end| usize::try_from(end - start).unwrap_or(usize::MAX));
        let mut head = vec![0; bytes_max.min(left)];
        let len = source.read_at(start, &mut head)?;
        head.truncate(len);
        Ok(head)
    }
}

/// The extra field of zip64 among others.
fn zip64(mut extra: &[u8]) -> Option<&[u8]> {
    loop {
        let (id, len) = (u16_at(extra, 0)?, usize::from(u16_at(extra, 2)?));
        let field = extra.get(4..4 + len)?;
        if id == 1 {
            return Some(field);
        }
        extra = extra.get(4 + len..)?;
    }
}

/// Writes an archive, members stored, each with the fields of zip64 so that its length may be any.
#[derive(Debug, Default)]
pub(super) struct Writer {
    done: Vec<Written>,
    /// The member being written.
    open: Option<Written>,
}

#[derive(Debug)]
struct Written {
    name: String,
    /// Offset of its local header.
    header: u64,
    crc: crc32fast::Hasher,
    bytes: u64,
}

/// 1 January 1980: archives have no other date for none.
const DATE: u16 = 1 << 5 | 1;
/// Version of the format that has zip64.
const VERSION: u16 = 45;
/// What stands in 32 bits for a number in the fields of zip64.
const ELSEWHERE: u32 = u32::MAX;

impl Written {
    /// The local header: sizes only in the fields of zip64.
    fn local(&self) -> Vec<u8> {
        let mut local = MAGIC.to_vec();
        local.extend([VERSION, 0, 0, 0, DATE].map(u16::to_le_bytes).as_flattened());
        local
            .extend([self.crc.clone().finalize(), ELSEWHERE, ELSEWHERE].map(u32::to_le_bytes).as_flattened());
        local.extend([self.name.len() as u16, 20].map(u16::to_le_bytes).as_flattened());
        local.extend(self.name.as_bytes());
        local.extend([1u16, 16].map(u16::to_le_bytes).as_flattened());
        local.extend([self.bytes, self.bytes].map(u64::to_le_bytes).as_flattened());
        local
    }

    /// The entry in the table of contents.
    fn entry(&self) -> Vec<u8> {
        let mut entry = b"PK\x01\x02".to_vec();
        entry.extend([VERSION, VERSION, 0, 0, 0, DATE].map(u16::to_le_bytes).as_flattened());
        entry
            .extend([self.crc.clone().finalize(), ELSEWHERE, ELSEWHERE].map(u32::to_le_bytes).as_flattened());
        entry.extend([self.name.len() as u16, 28, 0, 0, 0].map(u16::to_le_bytes).as_flattened());
        entry.extend([0, ELSEWHERE].map(u32::to_le_bytes).as_flattened());
        entry.extend(self.name.as_bytes());
        entry.extend([1u16, 24].map(u16::to_le_bytes).as_flattened());
        entry.extend([self.bytes, self.bytes, self.header].map(u64::to_le_bytes).as_flattened());
        entry
    }
}

impl Writer {
    /// Adds a whole member.
    pub fn add(&mut self, name: &str, bytes: &[u8], output: &mut Output) -> Result<(), Error> {
        self.begin(name, output)?;
        self.write(bytes, output)?;
        self.end(output)
    }

    /// Begins a member.
    pub fn begin(&mut self, name: &str, output: &mut Output) -> Result<(), Error> {
        let member =
            Written { name: format!("{name}.npy"), header: output.len(), crc: Default::default(), bytes: 0 };
        output.write(&member.local())?;
        self.open = Some(member);
        Ok(())
    }

    /// Adds bytes to the member.
    pub fn write(&mut self, bytes: &[u8], output: &mut Output) -> Result<(), Error> {
        if let Some(member) = &mut self.open {
            member.crc.update(bytes);
            member.bytes += bytes.len() as u64;
        }
        output.write(bytes)
    }

    /// Replaces the first bytes of the member by others, as many.
    pub fn rewrite_start(&mut self, old: &[u8], new: &[u8], output: &mut Output) -> Result<(), Error> {
        let Some(member) = &mut self.open else { return Ok(()) };
        output.write_at(member.header + member.local().len() as u64, new)?;
        // A checksum is linear: what changed in the first bytes changes it whatever comes after.
        let rest = crc32fast::Hasher::new_with_initial_len(0, member.bytes - old.len() as u64);
        let (mut from, mut to) = (checksum(old), checksum(new));
        from.combine(&rest);
        to.combine(&rest);
        let crc = member.crc.clone().finalize() ^ from.finalize() ^ to.finalize();
        member.crc = crc32fast::Hasher::new_with_initial_len(crc, member.bytes);
        Ok(())
    }

    /// Ends the member: its header is written again, now that its length is known.
    pub fn end(&mut self, output: &mut Output) -> Result<(), Error> {
        let Some(member) = self.open.take() else { return Ok(()) };
        output.write_at(member.header, &member.local())?;
        self.done.push(member);
        Ok(())
    }

    /// Writes the table of contents.
    pub fn finish(self, output: &mut Output) -> Result<(), Error> {
        let start = output.len();
        let contents = self.done.iter().flat_map(Written::entry).collect::<Vec<_>>();
        let (count, bytes) = (self.done.len() as u64, contents.len() as u64);
        let mut end = contents;
        end.extend(b"PK\x06\x06");
        end.extend((END64_BYTES as u64 - 12).to_le_bytes());
        end.extend([VERSION, VERSION].map(u16::to_le_bytes).as_flattened());
        end.extend([0u32, 0].map(u32::to_le_bytes).as_flattened());
        end.extend([count, count, bytes, start].map(u64::to_le_bytes).as_flattened());
        end.extend(b"PK\x06\x07\0\0\0\0");
        end.extend((start + bytes).to_le_bytes());
        end.extend(1u32.to_le_bytes());
        end.extend(b"PK\x05\x06");
        end.extend([0, 0, u16::MAX, u16::MAX].map(u16::to_le_bytes).as_flattened());
        end.extend([ELSEWHERE, ELSEWHERE].map(u32::to_le_bytes).as_flattened());
        end.extend([0, 0]);
        output.write(&end)
    }
}

fn checksum(bytes: &[u8]) -> crc32fast::Hasher {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(bytes);
    hasher
}
