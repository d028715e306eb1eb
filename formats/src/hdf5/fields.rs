//! Reads the fields of HDF5's structures one after the other; `None` where the bytes end before.

/// The address of nothing.
pub(super) const UNDEFINED: u64 = u64::MAX;

/// Bytes of an address and of a length in this file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Widths {
    pub address: usize,
    pub length: usize,
}

/// Bytes of a structure, from its next field on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fields<'a> {
    bytes: &'a [u8],
    widths: Widths,
}

impl<'a> Fields<'a> {
    pub fn new(bytes: &'a [u8], widths: Widths) -> Self {
        Self { bytes, widths }
    }

    /// What is left.
    pub fn rest(&self) -> &'a [u8] {
        self.bytes
    }

    pub fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.bytes.split_at_checked(len)?;
        self.bytes = rest;
        Some(taken)
    }

    pub fn skip(&mut self, len: usize) -> Option<()> {
        self.take(len).map(drop)
    }

    /// The four letters that structures begin with.
    pub fn signature(&mut self, letters: &[u8; 4]) -> Option<()> {
        (self.take(4)? == letters).then_some(())
    }

    /// A little-endian number of up to eight bytes.
    pub fn number(&mut self, len: usize) -> Option<u64> {
        let mut bytes = [0; 8];
        bytes.get_mut(..len)?.copy_from_slice(self.take(len)?);
        Some(u64::from_le_bytes(bytes))
    }

    pub fn u8(&mut self) -> Option<u8> {
        Some(self.number(1)? as u8)
    }

    pub fn u16(&mut self) -> Option<u16> {
        Some(self.number(2)? as u16)
    }

    pub fn u32(&mut self) -> Option<u32> {
        Some(self.number(4)? as u32)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.number(8)
    }

    /// An address; all ones are [`UNDEFINED`] in every width.
    pub fn address(&mut self) -> Option<u64> {
        let len = self.widths.address;
        let address = self.number(len)?;
        Some(if address == UNDEFINED >> (64 - 8 * len) { UNDEFINED } else { address })
    }

    pub fn length(&mut self) -> Option<u64> {
        self.number(self.widths.length)
    }

    /// Text up to a zero, in a field of `len` bytes.
    pub fn text(&mut self, len: usize) -> Option<String> {
        let bytes = self.take(len)?;
        let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(len);
        Some(String::from_utf8_lossy(bytes.get(..end)?).into_owned())
    }

    /// Text up to a zero, which is taken too, in a field padded to a multiple of `pad` bytes.
    pub fn text_to_zero(&mut self, pad: usize) -> Option<String> {
        let len = self.bytes.iter().position(|byte| *byte == 0)? + 1;
        self.text(len.next_multiple_of(pad))
    }
}

/// Bytes that a number up to `max` takes, where a structure leaves out leading zeroes.
pub(super) fn bytes_for(max: u64) -> usize {
    max.checked_ilog2().unwrap_or(0) as usize / 8 + 1
}
