//! BloscLZ, Blosc's own compressor: runs of literal bytes and copies of what came before.
//!
//! ```text
//! 000lllll                                l + 1 literal bytes follow
//! lllddddd dddddddd                       copy l + 2 bytes from d + 1 bytes back, l < 7
//! 111ddddd (11111111)* llllllll dddddddd  copy all these l + 9
//! d = 31 * 256 + 255                      two more bytes, the high one first, tell d - 8191
//! ```
//!
//! The first byte is always of literals, whatever its high bits say.

/// Distance from which two more bytes tell it.
const FAR: usize = 8191;

pub(super) fn undo(input: &[u8], output: &mut Vec<u8>, max: usize) -> Option<()> {
    output.clear();
    let mut rest = input;
    let mut mask = 31;
    while let Some(control) = rest.split_off_first() {
        let control = usize::from(*control) & mask;
        mask = 255;
        let mut len = control >> 5;
        if len == 0 {
            output.extend_from_slice(rest.split_off(..control + 1)?);
        } else {
            let mut back = (control & 31) << 8;
            if len == 7 {
                len += long(&mut rest)?;
            }
            back += usize::from(*rest.split_off_first()?);
            if back == FAR {
                back += usize::from(u16::from_be_bytes(*rest.split_off(..2)?.first_chunk()?));
            }
            copy(output, back + 1, len + 2)?;
        }
        if output.len() > max {
            return None;
        }
    }
    Some(())
}

/// The rest of a length: bytes up to the first that is not 255.
fn long(rest: &mut &[u8]) -> Option<usize> {
    let mut len = 0;
    loop {
        let byte = usize::from(*rest.split_off_first()?);
        len += byte;
        if byte < 255 {
            return Some(len);
        }
    }
}

/// Adds `len` bytes from `back` bytes before the end; they may overlap with what is added.
pub(super) fn copy(output: &mut Vec<u8>, back: usize, len: usize) -> Option<()> {
    let start = output.len().checked_sub(back)?;
    let mut left = len;
    while left > 0 {
        // As much as there is: it doubles with every turn.
        let run = left.min(output.len() - start);
        output.extend_from_within(start..start + run);
        left -= run;
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_copies() {
        let mut output = Vec::new();
        undo(&[0x20 | 1, b'a', b'b', 1 << 5, 1, 7 << 5, 1, 0], &mut output, 100).unwrap();
        assert_eq!(output, b"ababaaaaaaaaaaa");
        assert_eq!(undo(&[0, 1, 7 << 5, 255, 0, 0], &mut Vec::new(), 100), None, "too long");
        assert_eq!(undo(&[0, 1, 1 << 5, 1], &mut Vec::new(), 100), None, "before the start");
    }

    #[test]
    fn far_copies() {
        let mut output = Vec::new();
        let mut input: Vec<u8> = Vec::new();
        for i in 0..300u32 {
            input.push(31);
            input.extend((0..32).map(|j| (i * 7 + j) as u8));
        }
        // 3 bytes from 8192 + 258 back.
        input.extend([1 << 5 | 31, 255, 1, 2]);
        undo(&input, &mut output, 10_000).unwrap();
        assert_eq!(output.len(), 9603);
        let from = 9600 - (8192 + 258);
        assert_eq!(output[9600..], output[from..from + 3].to_vec());
    }
}
