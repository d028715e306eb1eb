//! LZF (filter 32000, h5py's): runs of literal bytes and copies of what came before.
//!
//! ```text
//! 000lllll                    l + 1 literal bytes follow
//! lllddddd dddddddd           copy l + 2 bytes from d + 1 bytes back
//! 111ddddd llllllll dddddddd  copy l + 9
//! ```

use super::blosclz::copy;

pub(super) fn undo(input: &[u8], output: &mut Vec<u8>, max: usize) -> Option<usize> {
    output.clear();
    let mut rest = input;
    while let Some(control) = rest.split_off_first() {
        let control = usize::from(*control);
        let len = control >> 5;
        if len == 0 {
            output.extend_from_slice(rest.split_off(..control + 1)?);
        } else {
            let len = if len == 7 { 7 + usize::from(*rest.split_off_first()?) } else { len };
            let back = (control & 31) << 8 | usize::from(*rest.split_off_first()?);
            copy(output, back + 1, len + 2)?;
        }
        if output.len() > max {
            return None;
        }
    }
    Some(output.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_copies() {
        let mut output = Vec::new();
        // "ab", then 3 from 2 back, then 9 + 1 from 1 back.
        undo(&[1, b'a', b'b', 1 << 5, 1, 7 << 5, 1, 0], &mut output, 100).unwrap();
        assert_eq!(output, b"ababaaaaaaaaaaa");
        assert_eq!(undo(&[1 << 5, 0], &mut Vec::new(), 100), None, "before the start");
        assert_eq!(undo(&[3, 1], &mut Vec::new(), 100), None, "cut short");
        assert_eq!(undo(&[0, 1, 7 << 5, 255, 0], &mut Vec::new(), 100), None, "too long");
    }
}
