//! A tile's gaps closed, by what the CPU has for it: the words that have a place, one after the other.
#![allow(unsafe_code)] // two calls, of code for this CPU: see [`select_tiles`] for what they gain

use super::{TILE, each_tile};
use crate::Event;

/// As [`select`](super::select), where `judge` changes a tile of words and says 1 of those that have a place and 0 of the
/// others. What follows the last event in its tile is anything.
///
/// All of it is compiled for this CPU as one piece: between judging and closing gaps, words stay in registers. Selecting by
/// a mask of pixels takes 0.7 of the time that it takes where gaps are closed by a function of their own.
#[inline(always)]
pub(crate) fn select_tiles(
    events: &mut [Event],
    judge: impl Fn(&mut [u64; TILE], &mut [u64; TILE], usize),
) -> usize {
    #[cfg(all(target_arch = "x86_64", feature = "std"))]
    {
        use crate::vector::{has_avx2, has_avx512};
        if has_avx512() {
            // SAFETY: the CPU has all that it is compiled for.
            return unsafe { x86::select_by_eights(events, judge) };
        }
        if has_avx2() {
            // SAFETY: the CPU has all that it is compiled for.
            return unsafe { x86::select_by_fours(events, judge) };
        }
    }
    each_tile(events, judge, one_by_one)
}

/// What every CPU can do.
#[inline(always)]
fn one_by_one(words: &[u64; TILE], places: &[u64; TILE], out: &mut [Event; TILE]) -> usize {
    let all = places.iter().sum::<u64>() as usize;
    if all == TILE {
        for (slot, word) in out.iter_mut().zip(words) {
            *slot = Event::from_word(*word);
        }
    } else if all > 0 {
        let mut n = 0;
        for (word, place) in words.iter().zip(places) {
            // The mask changes nothing: it tells the compiler that no check is needed.
            if let Some(slot) = out.get_mut(n % TILE) {
                *slot = Event::from_word(*word);
            }
            n += *place as usize;
        }
    }
    all
}

#[cfg(all(target_arch = "x86_64", feature = "std"))]
mod x86 {
    use super::{Event, TILE, each_tile};
    use bytemuck::cast;
    use core::arch::x86_64::*;

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,popcnt")]
    pub(super) fn select_by_eights(
        events: &mut [Event],
        judge: impl Fn(&mut [u64; TILE], &mut [u64; TILE], usize),
    ) -> usize {
        each_tile(events, judge, |words, places, out| by_eights(words, places, out))
    }

    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    pub(super) fn select_by_fours(
        events: &mut [Event],
        judge: impl Fn(&mut [u64; TILE], &mut [u64; TILE], usize),
    ) -> usize {
        each_tile(events, judge, |words, places, out| by_fours(words, places, out))
    }

    /// One instruction squeezes out of 8 words those without a place.
    #[target_feature(enable = "avx512f,popcnt")]
    #[inline]
    pub(super) fn by_eights(words: &[u64; TILE], places: &[u64; TILE], out: &mut [Event; TILE]) -> usize {
        let mut n = 0;
        for (words, places) in words.as_chunks::<8>().0.iter().zip(places.as_chunks::<8>().0) {
            let places: __m512i = cast(*places);
            let places = _mm512_test_epi64_mask(places, places);
            if let Some(slots) = out.get_mut(n..).and_then(|out| out.first_chunk_mut::<8>()) {
                *slots = cast(_mm512_maskz_compress_epi64(places, cast(*words)));
            }
            n += places.count_ones() as usize;
        }
        n
    }

    /// Halves of 4 words, in the order that brings to the front those with a place: bit i of the row's number is word i's.
    const ORDERS: [[u32; 8]; 16] = orders();

    const fn orders() -> [[u32; 8]; 16] {
        let mut orders = [[0; 8]; 16];
        let mut places = 0;
        while places < orders.len() {
            let (mut word, mut n) = (0, 0);
            while word < 4 {
                if places >> word & 1 == 1 {
                    orders[places][n] = 2 * word;
                    orders[places][n + 1] = 2 * word + 1;
                    n += 2;
                }
                word += 1;
            }
            places += 1;
        }
        orders
    }

    /// The same of 4 words, by a table.
    #[target_feature(enable = "avx2,popcnt")]
    #[inline]
    pub(super) fn by_fours(words: &[u64; TILE], places: &[u64; TILE], out: &mut [Event; TILE]) -> usize {
        let mut n = 0;
        for (words, places) in words.as_chunks::<4>().0.iter().zip(places.as_chunks::<4>().0) {
            let signs = _mm256_slli_epi64::<63>(cast(*places));
            let places = _mm256_movemask_pd(_mm256_castsi256_pd(signs)) as usize;
            let order = cast(ORDERS[places % ORDERS.len()]);
            if let Some(slots) = out.get_mut(n..).and_then(|out| out.first_chunk_mut::<4>()) {
                *slots = cast(_mm256_permutevar8x32_epi32(cast(*words), order));
            }
            n += places.count_ones() as usize;
        }
        n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A way to close a tile's gaps.
    type Closes = fn(&[u64; TILE], &[u64; TILE], &mut [Event; TILE]) -> usize;

    fn check(closes: Closes) {
        let words: [u64; TILE] = core::array::from_fn(|i| (i as u64) << 40 | (TILE - i) as u64);
        let mut random = crate::random::Random::new(1, 0);
        for n in 0..1000 {
            // All, then ever fewer, and none.
            let bits = if n == 999 { 0 } else { (0..n % 8).fold(!0, |bits, _| bits & random.next()) };
            let places: [u64; TILE] = core::array::from_fn(|i| bits >> i & 1);
            let expected: Vec<u64> = (0..TILE).filter(|i| bits >> i & 1 == 1).map(|i| words[i]).collect();
            let mut out = [Event::default(); TILE];
            let kept = closes(&words, &places, &mut out);
            let found: Vec<u64> = out[..kept].iter().map(|event| event.word()).collect();
            assert_eq!(found, expected, "{bits:b}");
        }
    }

    #[test]
    fn words_with_a_place_stay_in_order() {
        check(one_by_one);
        #[cfg(all(target_arch = "x86_64", feature = "std"))]
        {
            use crate::vector::{has_avx2, has_avx512};
            if has_avx2() {
                // SAFETY: the CPU has all that it is compiled for.
                check(|words, places, out| unsafe { x86::by_fours(words, places, out) });
            }
            if has_avx512() {
                // SAFETY: the CPU has all that it is compiled for.
                check(|words, places, out| unsafe { x86::by_eights(words, places, out) });
            }
        }
    }
}
