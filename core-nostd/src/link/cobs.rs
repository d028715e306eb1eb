//! Consistent Overhead Byte Stuffing: bytes without a zero, so that a zero ends a frame.
//!
//! Source: Cheshire and Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on Networking, 1999. A code
//! byte n stands for n - 1 bytes that follow it and then a zero; 0xFF for 254 bytes and no zero. The last zero is not
//! part of the frame.

/// The code of a block without a zero after it.
const WHOLE: u8 = 0xFF;

/// Most bytes that a frame of `len` bytes takes, its end included.
pub(super) const fn len_max(len: usize) -> usize {
    len.saturating_add(len / 254).saturating_add(2)
}

/// Stuffs bytes into a slice as they come.
#[derive(Debug)]
pub(super) struct Writer<'o> {
    out: &'o mut [u8],
    at: usize,
    /// Where the code of the open block goes.
    code_at: usize,
    code: u8,
}

/// The slice is too short.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Full;

impl<'o> Writer<'o> {
    pub(super) fn new(out: &'o mut [u8]) -> Self {
        Self { out, at: 1, code_at: 0, code: 1 }
    }

    fn put(&mut self, at: usize, byte: u8) -> Result<(), Full> {
        *self.out.get_mut(at).ok_or(Full)? = byte;
        Ok(())
    }

    fn close(&mut self) -> Result<(), Full> {
        self.put(self.code_at, self.code)?;
        self.code_at = self.at;
        self.at = self.at.saturating_add(1);
        self.code = 1;
        Ok(())
    }

    pub(super) fn push(&mut self, byte: u8) -> Result<(), Full> {
        // A full block is closed by the byte after it, so that none is left empty at the end.
        if self.code == WHOLE {
            self.close()?;
        }
        if byte == 0 {
            return self.close();
        }
        self.put(self.at, byte)?;
        self.at = self.at.saturating_add(1);
        self.code = self.code.wrapping_add(1);
        Ok(())
    }

    /// Ends the frame; how many bytes of the slice it has.
    pub(super) fn finish(mut self) -> Result<usize, Full> {
        self.put(self.code_at, self.code)?;
        self.put(self.at, 0)?;
        Ok(self.at.saturating_add(1))
    }
}

/// What a byte of a stuffed frame means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unstuffed {
    /// Nothing yet.
    Nothing,
    /// The next byte of the frame.
    Byte(u8),
    /// The frame ends here; false: it was cut short.
    End(bool),
}

/// Takes the stuffing out, a byte at a time.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Reader {
    /// Bytes until the next code.
    left: u8,
    /// Whether a zero comes before the next block.
    zero: bool,
}

impl Reader {
    pub(super) fn push(&mut self, byte: u8) -> Unstuffed {
        if byte == 0 {
            let whole = self.left == 0;
            *self = Self::default();
            return Unstuffed::End(whole);
        }
        if let Some(left) = self.left.checked_sub(1) {
            self.left = left;
            return Unstuffed::Byte(byte);
        }
        let zero = core::mem::replace(&mut self.zero, byte != WHOLE);
        self.left = byte - 1;
        if zero { Unstuffed::Byte(0) } else { Unstuffed::Nothing }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stuffed(bytes: &[u8]) -> Vec<u8> {
        let mut out = vec![0xEE; len_max(bytes.len())];
        let mut writer = Writer::new(&mut out);
        bytes.iter().for_each(|byte| writer.push(*byte).unwrap());
        let len = writer.finish().unwrap();
        out.truncate(len);
        out
    }

    fn unstuffed(bytes: &[u8]) -> Option<Vec<u8>> {
        let (mut reader, mut out) = (Reader::default(), vec![]);
        for byte in bytes {
            match reader.push(*byte) {
                Unstuffed::Nothing => {}
                Unstuffed::Byte(byte) => out.push(byte),
                Unstuffed::End(whole) => return whole.then_some(out),
            }
        }
        None
    }

    /// The examples of Wikipedia's page on COBS (2024), which are those of the paper and more.
    #[test]
    fn stuffs_as_the_examples() {
        let to = |first: u8, last: u8| (first..=last).collect::<Vec<u8>>();
        for (bytes, expected) in [
            (vec![], vec![1, 0]),
            (vec![0], vec![1, 1, 0]),
            (vec![0, 0], vec![1, 1, 1, 0]),
            (vec![0, 0x11, 0], vec![1, 2, 0x11, 1, 0]),
            (vec![0x11, 0x22, 0, 0x33], vec![3, 0x11, 0x22, 2, 0x33, 0]),
            (vec![0x11, 0, 0, 0], vec![2, 0x11, 1, 1, 1, 0]),
            (to(1, 254), [vec![0xFF], to(1, 254), vec![0]].concat()),
            ([vec![0], to(1, 254)].concat(), [vec![1, 0xFF], to(1, 254), vec![0]].concat()),
            (to(1, 255), [vec![0xFF], to(1, 254), vec![2, 0xFF, 0]].concat()),
            ([to(2, 255), vec![0]].concat(), [vec![0xFF], to(2, 255), vec![1, 1, 0]].concat()),
            ([to(3, 255), vec![0, 1]].concat(), [vec![0xFE], to(3, 255), vec![2, 1, 0]].concat()),
        ] {
            assert_eq!(stuffed(&bytes), expected);
            assert_eq!(unstuffed(&expected), Some(bytes));
        }
    }

    #[test]
    fn says_when_the_slice_is_short() {
        for len in 0..=300 {
            let bytes = vec![7; len];
            let needed = stuffed(&bytes).len();
            for room in 0..needed {
                let mut out = vec![0; room];
                let mut writer = Writer::new(&mut out);
                let pushed = bytes.iter().try_for_each(|byte| writer.push(*byte));
                assert_eq!(pushed.and_then(|()| writer.finish()), Err(Full));
            }
        }
    }

    #[test]
    fn a_frame_cut_short_is_none() {
        let whole = stuffed(&[1, 2, 3, 0, 4]);
        assert_eq!(unstuffed(&[&whole[..3], &[0]].concat()), None);
    }
}
