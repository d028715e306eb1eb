//! Plain loops, compiled twice: for the target, and for the wider vectors that most x86-64 CPUs of today have. And the
//! one thing that no loop becomes: [`outside`].
//!
//! [`widest`] has no code of its own for any CPU: the compiler vectorises the one loop there is, so both give the same
//! bits (fused multiply-add is not switched on). Counting by polarity takes 2.1 ms per 1.22 million events with AVX2 and 3.0 without
//! (Sapphire Rapids, one busy core, 2026-11). In no_std, and on other CPUs, what the target is compiled for is all.

/// Does `work`, compiled for AVX2 where the CPU has it. Give it a closure with `#[inline(always)]` that calls nothing
/// which is not: what is not inlined stays as it was compiled.
///
/// ```
/// let numbers = [3u16, 1, 2];
/// let most = lobula_core::vector::widest(
///     #[inline(always)]
///     || numbers.iter().fold(0, |most, number| most.max(*number)),
/// );
/// assert_eq!(most, 3);
/// ```
#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[allow(unsafe_code)] // one call, of code for this CPU: see the module for what it gains
#[inline(always)]
pub fn widest<R>(work: impl FnOnce() -> R) -> R {
    use std::arch::is_x86_feature_detected as has;
    if has!("avx2") && has!("bmi1") && has!("bmi2") {
        // SAFETY: the CPU has all that it is compiled for.
        return unsafe { avx2(work) };
    }
    work()
}

#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn avx2<R>(work: impl FnOnce() -> R) -> R {
    work()
}

/// Does `work`, as it was compiled for the target.
#[cfg(not(all(target_arch = "x86_64", feature = "std")))]
#[inline(always)]
pub fn widest<R>(work: impl FnOnce() -> R) -> R {
    work()
}

/// As [`widest`], compiled for AVX-512 where the CPU has it: for loops that pass over numbers in order and do little with
/// each. Those that go through tables gain nothing by it.
///
/// ```
/// let (from, mut to) = ([1u64 << 40 | 7; 3], [0; 3]);
/// lobula_core::vector::in_order(
///     #[inline(always)]
///     || from.iter().zip(&mut to).for_each(|(from, to)| *to = from & 0xFFFF),
/// );
/// assert_eq!(to, [7; 3]);
/// ```
#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[allow(unsafe_code)] // one call, of code for this CPU: see the module for what it gains
#[inline(always)]
pub fn in_order<R>(work: impl FnOnce() -> R) -> R {
    use std::arch::is_x86_feature_detected as has;
    if has!("avx512f") && has!("avx512bw") && has!("avx512dq") && has!("avx512vl") && has!("avx512vbmi") {
        // SAFETY: the CPU has all that it is compiled for.
        return unsafe { avx512(work) };
    }
    widest(work)
}

#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi")]
fn avx512<R>(work: impl FnOnce() -> R) -> R {
    work()
}

/// Does `work`, as it was compiled for the target.
#[cfg(not(all(target_arch = "x86_64", feature = "std")))]
#[inline(always)]
pub fn in_order<R>(work: impl FnOnce() -> R) -> R {
    work()
}

/// A bit for each byte that is outside of `low..=high`, which is how separators are found among digits.
///
/// ```
/// let text = b"1792,3,4,1\n67890,4,5,0\n67899,4,5";
/// assert_eq!(lobula_core::vector::outside(text, b'0', b'9').trailing_zeros(), 4);
/// ```
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)] // one call, of code for any CPU of this kind: compilers have no other way to one bit a byte
#[inline(always)]
pub fn outside(bytes: &[u8; 32], low: u8, high: u8) -> u32 {
    // SAFETY: every x86-64 CPU has SSE2.
    unsafe { outside_sse2(bytes, low, high) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "sse2")]
#[inline]
fn outside_sse2(bytes: &[u8; 32], low: u8, high: u8) -> u32 {
    use core::arch::x86_64::{_mm_cmpeq_epi8, _mm_min_epu8, _mm_movemask_epi8, _mm_set1_epi8, _mm_sub_epi8};
    let halves: &[[u8; 16]; 2] = bytemuck::cast_ref(bytes);
    let [first, second] = halves.map(|half| {
        let above = _mm_sub_epi8(bytemuck::cast(half), _mm_set1_epi8(low as i8));
        let inside = _mm_min_epu8(above, _mm_set1_epi8(high.wrapping_sub(low) as i8));
        _mm_movemask_epi8(_mm_cmpeq_epi8(inside, above)) as u32
    });
    !(first | second << 16)
}

/// A bit for each byte that is outside of `low..=high`.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub fn outside(bytes: &[u8; 32], low: u8, high: u8) -> u32 {
    outside_each(bytes, low, high)
}

#[cfg(any(test, not(target_arch = "x86_64")))]
#[inline(always)]
fn outside_each(bytes: &[u8; 32], low: u8, high: u8) -> u32 {
    bytes.iter().rev().fold(0, |bits, byte| bits << 1 | u32::from(!(low..=high).contains(byte)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_outside_of_a_range() {
        for byte in 0..=u8::MAX {
            for at in 0..32 {
                let mut bytes = [b'7'; 32];
                bytes[at] = byte;
                let expected = u32::from(!byte.is_ascii_digit()) << at;
                assert_eq!(outside(&bytes, b'0', b'9'), expected, "{byte} at {at}");
                assert_eq!(outside_each(&bytes, b'0', b'9'), expected, "{byte} at {at}");
            }
        }
    }
}
