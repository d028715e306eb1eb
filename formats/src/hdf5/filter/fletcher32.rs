//! Fletcher's checksum (filter 3): four bytes after the chunk.

/// Checks and drops the checksum.
pub(super) fn undo(input: &[u8], output: &mut Vec<u8>) -> Option<usize> {
    let (bytes, stored) = input.split_last_chunk()?;
    let sum = checksum(bytes);
    // Versions before 1.6.3 swapped the bytes of each half, and are still read.
    let swapped = (sum & 0x00FF_00FF) << 8 | (sum >> 8) & 0x00FF_00FF;
    let stored = u32::from_le_bytes(*stored);
    output.clear();
    output.extend_from_slice(bytes);
    (stored == sum || stored == swapped).then_some(bytes.len())
}

/// Of big-endian words; a last odd byte is the high one of a word.
fn checksum(bytes: &[u8]) -> u32 {
    let (mut low, mut high) = (0u64, 0u64);
    // No sum overflows in this many words.
    for words in bytes.chunks(2 << 20) {
        for word in words.chunks(2) {
            let word = match word {
                [first, second] => u16::from_be_bytes([*first, *second]),
                [first] => u16::from(*first) << 8,
                _ => 0,
            };
            low += u64::from(word);
            high += low;
        }
        (low, high) = (folded(low), folded(high));
    }
    (folded(high) << 16 | folded(low)) as u32
}

/// Into 16 bits: modulo 65535, and never 0 but for 0.
fn folded(mut sum: u64) -> u64 {
    while sum >> 16 != 0 {
        sum = (sum & 0xFFFF) + (sum >> 16);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_words() {
        // 0x0102 + 0x0304 = 0x0406; 0x0102 + 0x0406 = 0x0508.
        assert_eq!(checksum(&[1, 2, 3, 4]), 0x0508_0406);
        assert_eq!(checksum(&[0xFF; 4]), 0xFFFF_FFFF);
        let mut output = Vec::new();
        assert_eq!(undo(&[1, 2, 3, 4, 6, 4, 8, 5], &mut output), Some(4));
        assert_eq!(output, [1, 2, 3, 4]);
        assert_eq!(undo(&[1, 2, 3, 5, 6, 4, 8, 5], &mut Vec::new()), None);
        assert_eq!(undo(&[1], &mut Vec::new()), None);
    }
}
