//! Plain loops, compiled twice: for the target, and for the wider vectors that most x86-64 CPUs of today have. And the
//! two things that no loop becomes: [`outside`], and looking up in a table whose end is kept.
//!
//! [`widest`] has no code of its own for any CPU: the compiler vectorises the one loop there is, so both give the same
//! bits (fused multiply-add is not switched on). Counting by polarity takes 2.1 ms per 1.22 million events with AVX2 and 3.0 without
//! (Sapphire Rapids, one busy core, 2026-11). In no_std, and on other CPUs, what the target is compiled for is all.

/// Whether this is a small core, as of a microcontroller: no vectors, no cache to fetch into ahead, and cheap branches.
pub(crate) const SMALL_CORE: bool = cfg!(target_pointer_width = "32");

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
    if has_avx2() {
        // SAFETY: the CPU has all that it is compiled for.
        return unsafe { avx2(work) };
    }
    work()
}

/// Whether the CPU has all that loops are compiled for a second time.
#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[inline(always)]
pub(crate) fn has_avx2() -> bool {
    use std::arch::is_x86_feature_detected as has;
    has!("avx2") && has!("bmi1") && has!("bmi2") && has!("popcnt")
}

#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
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
    if has_avx512() {
        // SAFETY: the CPU has all that it is compiled for.
        return unsafe { avx512(work) };
    }
    widest(work)
}

/// Whether the CPU has all that some loops are compiled for a third time.
#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[inline(always)]
pub(crate) fn has_avx512() -> bool {
    use std::arch::is_x86_feature_detected as has;
    has!("avx512f")
        && has!("avx512bw")
        && has!("avx512dq")
        && has!("avx512vl")
        && has!("avx512vbmi")
        && has!("popcnt")
}

#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,popcnt")]
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

/// Puts in place of each number what the table has there, and `beyond` for what is beyond its end.
#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[allow(unsafe_code)] // one call, of code for this CPU: the mask of pixels takes 0.8 of the time with it
#[inline(always)]
pub(crate) fn gather(table: &[u32], places: &mut [u64], beyond: u32) {
    if std::arch::is_x86_feature_detected!("avx512f") {
        // SAFETY: the CPU has all that it is compiled for.
        return unsafe { gather_eights(table, places, beyond) };
    }
    gather_each(table, places, beyond);
}

/// Puts in place of each number what the table has there, and `beyond` for what is beyond its end.
#[cfg(not(all(target_arch = "x86_64", feature = "std")))]
#[inline(always)]
pub(crate) fn gather(table: &[u32], places: &mut [u64], beyond: u32) {
    gather_each(table, places, beyond);
}

#[inline(always)]
fn gather_each(table: &[u32], places: &mut [u64], beyond: u32) {
    for place in places {
        *place = table.get(*place as usize).copied().unwrap_or(beyond).into();
    }
}

/// One instruction looks up eight.
#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[allow(unsafe_code)] // the one instruction, which reads by pointers
#[target_feature(enable = "avx512f")]
#[inline]
fn gather_eights(table: &[u32], places: &mut [u64], beyond: u32) {
    use core::arch::x86_64::*;
    let (eights, rest) = places.as_chunks_mut::<8>();
    let (none, len) = (_mm256_set1_epi32(beyond as i32), _mm512_set1_epi64(table.len() as i64));
    for eight in eights {
        let at: __m512i = bytemuck::cast(*eight);
        let within = _mm512_cmplt_epu64_mask(at, len);
        // SAFETY: only what is within the table is read.
        let found = unsafe { _mm512_mask_i64gather_epi32::<4>(none, within, at, table.as_ptr().cast()) };
        *eight = bytemuck::cast(_mm512_cvtepu32_epi64(found));
    }
    gather_each(table, rest, beyond);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_looked_up_to_its_end() {
        let table: Vec<u32> = (0..1000).map(|i| i * 7 + (i << 31)).collect();
        for len in [0, 1, 31, 1000] {
            let table = &table[..len];
            let places: [u64; 67] = core::array::from_fn(|i| match i {
                0 => u64::MAX,
                1 => 1 << 63,
                2 => 1 << 32,
                3 => len as u64,
                _ => (i as u64 * 37) % 1100,
            });
            let expected = places.map(|at| table.get(at as usize).map_or(5, |found| u64::from(*found)));
            let (mut found, mut each) = (places, places);
            gather(table, &mut found, 5);
            gather_each(table, &mut each, 5);
            assert_eq!((found, each), (expected, expected));
        }
    }

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
