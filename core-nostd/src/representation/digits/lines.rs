//! Many digits at once: functions of them by tables, and how often each is there.
//!
//! Nearly all digits are less than 16. Of 32 such, AVX2 looks up all by one instruction, and finds those that are one digit
//! by another: it takes a quarter off the time of a countmask (1280x720, Sapphire Rapids, 2026-11).
#![allow(unsafe_code)] // two calls, of code for this CPU: compilers find neither instruction

/// Writes `table[digit]` of each digit as far as `out` goes.
pub(super) fn look_up<T: Copy>(digits: &[u8], out: &mut [T], table: &[T; 256]) {
    let (words, rest) = digits.as_chunks::<8>();
    let (eights, last) = out.as_chunks_mut::<8>();
    let done = words.len().min(eights.len());
    for (out, word) in eights.iter_mut().zip(words) {
        // Most pixels have no event: eight at once are told by one comparison.
        if u64::from_ne_bytes(*word) == 0 {
            *out = [table[0]; 8];
        } else {
            *out = word.map(|digit| table[usize::from(digit)]);
        }
    }
    let after = eights.get_mut(done..).unwrap_or_default().as_flattened_mut().iter_mut().chain(last);
    let digits = words.get(done..).unwrap_or_default().as_flattened().iter().chain(rest);
    for (out, digit) in after.zip(digits) {
        *out = table[usize::from(*digit)];
    }
}

/// The same by a table of bytes.
#[cfg(all(target_arch = "x86_64", feature = "std"))]
pub(super) fn look_up_bytes(digits: &[u8], out: &mut [u8], table: &[u8; 256]) {
    if !std::arch::is_x86_feature_detected!("avx2") {
        return look_up(digits, out, table);
    }
    let (lines, rest) = out.as_chunks_mut::<{ avx2::LINE }>();
    let all = digits.len().min(lines.len() * avx2::LINE);
    let (digits, after) = digits.split_at_checked(all).unwrap_or_default();
    // SAFETY: the CPU has what it is compiled for.
    unsafe { avx2::look_up(digits.as_chunks().0, lines, table) };
    look_up(after, rest, table);
}

/// How often each digit is there.
#[cfg(all(target_arch = "x86_64", feature = "std"))]
pub(super) fn histogram(digits: &[u8]) -> [u32; 256] {
    if !std::arch::is_x86_feature_detected!("avx2") {
        return one_by_one(digits);
    }
    let (lines, rest) = digits.as_chunks();
    let mut counts = one_by_one(rest);
    // SAFETY: the CPU has what it is compiled for.
    unsafe { avx2::count(lines, &mut counts) };
    counts
}

#[cfg(not(all(target_arch = "x86_64", feature = "std")))]
pub(super) use {look_up as look_up_bytes, one_by_one as histogram};

/// Most bytes are 0: eight at once are skipped. Of the others most are 1, and to count two of a kind at one place is to
/// wait for the first: hence four of them.
pub(super) fn one_by_one(digits: &[u8]) -> [u32; 256] {
    let (mut all, mut parts) = ([0; 256], [[0u32; 256]; 4]);
    let (words, rest) = digits.as_chunks::<8>();
    for word in words {
        if u64::from_ne_bytes(*word) == 0 {
            all[0] += 8;
            continue;
        }
        for four in word.as_chunks::<4>().0 {
            parts.iter_mut().zip(four).for_each(|(part, digit)| part[usize::from(*digit)] += 1);
        }
    }
    rest.iter().for_each(|digit| all[usize::from(*digit)] += 1);
    for part in &parts {
        all.iter_mut().zip(part).for_each(|(sum, more)| *sum += more);
    }
    all
}

#[cfg(all(target_arch = "x86_64", feature = "std"))]
mod avx2 {
    use bytemuck::cast;
    use core::arch::x86_64::*;

    /// Digits of a vector.
    pub(super) const LINE: usize = 32;

    /// What the digits below 16 have not.
    const LARGE: i8 = !0xF;

    /// Digits below 16 that are counted at once: as many as leave their counters in registers.
    const AT_ONCE: usize = 8;

    #[target_feature(enable = "avx2")]
    pub(super) fn look_up(digits: &[[u8; LINE]], out: &mut [[u8; LINE]], table: &[u8; 256]) {
        let small: [[u8; 16]; 2] = [core::array::from_fn(|digit| table[digit]); 2];
        let (small, large) = (cast(small), _mm256_set1_epi8(LARGE));
        for (out, line) in out.iter_mut().zip(digits) {
            let digits: __m256i = cast(*line);
            *out = match _mm256_testz_si256(digits, large) {
                0 => line.map(|digit| table[usize::from(digit)]),
                _ => cast(_mm256_shuffle_epi8(small, digits)),
            };
        }
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn count(lines: &[[u8; LINE]], counts: &mut [u32; 256]) {
        let (zero, large) = (_mm256_setzero_si256(), _mm256_set1_epi8(LARGE));
        // So many that a byte holds how many at one place are one digit.
        for lines in lines.chunks(u8::MAX.into()) {
            for (first, counts) in (0..16).step_by(AT_ONCE).zip(counts.as_chunks_mut::<AT_ONCE>().0) {
                let mut at_places = [zero; AT_ONCE];
                for line in lines {
                    for (digit, found) in (first..).zip(&mut at_places) {
                        let same = _mm256_cmpeq_epi8(cast(*line), _mm256_set1_epi8(digit));
                        *found = _mm256_sub_epi8(*found, same);
                    }
                }
                for (count, found) in counts.iter_mut().zip(at_places) {
                    let sums: [u64; 4] = cast(_mm256_sad_epu8(found, zero));
                    *count += sums.iter().sum::<u64>() as u32;
                }
            }
            for line in lines {
                if _mm256_testz_si256(cast(*line), large) == 0 {
                    line.iter()
                        .filter(|digit| **digit > 15)
                        .for_each(|digit| counts[usize::from(*digit)] += 1);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_digits_looked_up_and_counted() {
        let mut random = crate::random::Random::new(1, 0);
        let table = core::array::from_fn(|_| random.next() as u8);
        for (len, below) in (0..20_000).step_by(397).zip([1, 2, 16, 17, 256].into_iter().cycle()) {
            let digits: Vec<u8> = (0..len).map(|_| random.below(below) as u8).collect();
            let expected: Vec<u8> = digits.iter().map(|digit| table[usize::from(*digit)]).collect();
            for look_up in [look_up, look_up_bytes] {
                for out_len in [len / 2, len] {
                    let mut out = vec![0xA5; out_len];
                    look_up(&digits, &mut out, &table);
                    assert_eq!(out, expected[..out_len]);
                }
            }
            let expected = core::array::from_fn(|of| {
                digits.iter().filter(|digit| usize::from(**digit) == of).count() as u32
            });
            assert_eq!(histogram(&digits), expected);
            assert_eq!(one_by_one(&digits), expected);
        }
    }
}
