//! An HDF5 file by addresses: superblock, bounded reads, errors.
//!
//! Spec: <https://support.hdfgroup.org/documentation/hdf5/latest/_f_m_t3.html>, section II
//!
//! What a file's structures may make us read is bounded by the length of the file, so that structures that refer to
//! each other in circles come to an end, and no length field is believed before the bytes are there.

use super::fields::{Fields, UNDEFINED, Widths};
use crate::input::Input;
use crate::{Error, ErrorKind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What every HDF5 file begins with, after a block of the user's of 0, 512, 1024, 2048 ... bytes.
pub(super) const SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";

/// Longest structure that is read at once.
const STRUCTURE_BYTES_MAX: usize = 16 << 20;

/// An open file whose superblock was read.
#[derive(Debug)]
pub(super) struct File {
    pub input: Arc<Input>,
    /// Offset that addresses count from.
    base: u64,
    pub widths: Widths,
    /// Address of the root group.
    pub root: u64,
    /// Bytes of structures that may still be read.
    budget: AtomicU64,
}

impl File {
    pub fn open(input: Arc<Input>) -> Result<Self, Error> {
        let widths = Widths { address: 8, length: 8 };
        let budget = AtomicU64::new(input.len().saturating_mul(4).saturating_add(1 << 20));
        let mut file = Self { input, base: 0, widths, root: 0, budget };
        file.base = file.find_signature()?;
        let bytes = file.bytes_up_to(0, 128)?;
        let superblock = Superblock::parse(&bytes);
        let Superblock { widths, root } = superblock.ok_or_else(|| file.malformed("superblock", 0))?;
        (file.widths, file.root) = (widths, root);
        Ok(file)
    }

    fn find_signature(&self) -> Result<u64, Error> {
        let mut offset = 0;
        while offset < self.input.len() {
            let mut head = [0; SIGNATURE.len()];
            if self.input.read_at(offset, &mut head)? == head.len() && head == SIGNATURE {
                return Ok(offset);
            }
            offset = (offset * 2).max(512);
        }
        Err(self.malformed("signature", 0))
    }

    /// Fields of the structure of `len` bytes at an address; `what` names it in errors.
    pub fn bytes(&self, what: &str, address: u64, len: usize) -> Result<Vec<u8>, Error> {
        let offset = self.offset(address);
        let there = offset.is_some_and(|offset| self.input.len().saturating_sub(offset) >= len as u64);
        if !there || len > STRUCTURE_BYTES_MAX {
            return Err(self.malformed(what, address));
        }
        self.bytes_up_to(address, len)
    }

    /// As [`bytes`](Self::bytes), but for what lies beyond the end.
    pub fn bytes_up_to(&self, address: u64, len: usize) -> Result<Vec<u8>, Error> {
        let offset = self.offset(address).unwrap_or(u64::MAX);
        let left = self.input.len().saturating_sub(offset);
        let len = usize::try_from(left).unwrap_or(usize::MAX).min(len).min(STRUCTURE_BYTES_MAX);
        let spent = |budget: u64| budget.checked_sub(len as u64 + 16);
        if self.budget.fetch_update(Ordering::Relaxed, Ordering::Relaxed, spent).is_err() {
            return Err(self.malformed("tree of objects, which is longer than the file,", address));
        }
        let mut bytes = vec![0; len];
        self.input.read_at(offset, &mut bytes)?;
        Ok(bytes)
    }

    pub fn fields<'a>(&self, bytes: &'a [u8]) -> Fields<'a> {
        Fields::new(bytes, self.widths)
    }

    /// Offset in the file of an address, if it is one.
    pub fn offset(&self, address: u64) -> Option<u64> {
        let offset = self.base.checked_add(address)?;
        (address != UNDEFINED && offset <= self.input.len()).then_some(offset)
    }

    /// The structure at this address breaks the format.
    pub fn malformed(&self, what: &str, address: u64) -> Error {
        let what = format!("has a damaged HDF5 {what}");
        let remedy = "copy it again from where it was recorded";
        let error = Error::new(ErrorKind::Malformed, self.input.path(), what, remedy);
        error.at(self.offset(address).unwrap_or(self.input.len()))
    }

    /// Something of HDF5 that we do not read.
    pub fn unsupported(&self, what: impl std::fmt::Display) -> Error {
        let what = format!("holds {what}, which is not read");
        let remedy = "write it again with h5repack -f SHUF -f GZIP=1 and chunked or contiguous layout";
        Error::new(ErrorKind::Unsupported, self.input.path(), what, remedy)
    }
}

struct Superblock {
    widths: Widths,
    root: u64,
}

impl Superblock {
    fn parse(bytes: &[u8]) -> Option<Self> {
        let mut fields = Fields::new(bytes, Widths { address: 8, length: 8 });
        fields.skip(SIGNATURE.len())?;
        let version = fields.u8()?;
        if version < 2 {
            fields.skip(4)?;
        }
        let widths = Widths { address: fields.u8()?.into(), length: fields.u8()?.into() };
        let known = |width| matches!(width, 2 | 4 | 8);
        if !known(widths.address) || !known(widths.length) {
            return None;
        }
        let mut fields = Fields::new(fields.rest(), widths);
        match version {
            // Sizes of nodes, flags; addresses of base, free space, end, driver; the name's offset of the root's entry.
            0 => fields.skip(1 + 4 + 4 + 5 * widths.address)?,
            1 => fields.skip(1 + 4 + 4 + 4 + 5 * widths.address)?,
            // Flags; addresses of base, extension, end.
            2 | 3 => fields.skip(1 + 3 * widths.address)?,
            _ => return None,
        }
        Some(Self { widths, root: fields.address()? })
    }
}
