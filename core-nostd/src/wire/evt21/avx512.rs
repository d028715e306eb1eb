//! Steady stretches of 16 words at a time, on x86-64 CPUs with AVX-512: the two halves of a word are lanes of 32 bits.
//! Where no word of a block makes two events, the lanes that make one are squeezed together and stored at once; where
//! none makes three, the lanes of first and last events, in turn; else the masks themselves are squeezed to a list of
//! columns, two words at a time.
#![allow(unsafe_code)] // one call, of code for this CPU: 6 times as fast as the portable kernel

use super::{LEGACY, Steady, VECTOR_LEN, WORD_BYTES};
use crate::Event;
use crate::wire::avx512::{Cpu, Heads, LANES, interleave, splat, store_few};
use crate::wire::kernel::Done;
use bytemuck::cast;
use core::arch::x86_64::*;

/// Of 16 words in two tables the 32-bit lanes of their lower halves, and of their upper.
const LOWER: [u32; LANES] = every_second(0);
const UPPER: [u32; LANES] = every_second(1);
/// For each bit of the masks of two words: which of them in the bit after the five of the column.
const LANE_AND_COLUMN: [u8; 2 * VECTOR_LEN] = {
    let mut list = [0; 2 * VECTOR_LEN];
    let mut i = 0;
    while i < list.len() {
        list[i] = i as u8;
        i += 1;
    }
    list
};

const fn every_second(first: u32) -> [u32; LANES] {
    let mut lanes = [0; LANES];
    let mut i = 0;
    while i < LANES {
        lanes[i] = first + 2 * i as u32;
        i += 1;
    }
    lanes
}

/// Takes words from the start of `words` as long as they are steady and come in whole blocks that `out` has room for.
pub fn run<const ORDER: u8>(
    _: Cpu,
    steady: &mut Steady,
    words: &[[u8; WORD_BYTES]],
    out: &mut [Event],
) -> Done {
    // SAFETY: `stretch` is safe code for a CPU with its features, of which there being a `Cpu` is the proof.
    unsafe { stretch::<ORDER>(steady, words, out) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512vl,avx512vbmi2,avx512vpopcntdq,bmi1,bmi2,popcnt")]
fn stretch<const ORDER: u8>(steady: &mut Steady, words: &[[u8; WORD_BYTES]], out: &mut [Event]) -> Done {
    let mut done = Done::default();
    let mut base = splat(steady.base);
    for block in words.as_chunks::<LANES>().0 {
        let [low, high]: [__m512i; 2] = cast(*block);
        let half = |lanes: [u32; LANES]| _mm512_permutex2var_epi32(low, cast(lanes), high);
        let (masks, heads) = match ORDER {
            LEGACY => (half(UPPER), half(LOWER)),
            _ => (half(LOWER), half(UPPER)),
        };
        let heads = Heads::new(heads, _mm512_test_epi32_mask(masks, masks), base, steady);
        let Some(events) = store(&heads, masks, out.get_mut(done.events..).unwrap_or_default()) else {
            break;
        };
        base = heads.base;
        done.events += events;
        done.words += heads.steady;
        if heads.steady < LANES {
            break;
        }
    }
    steady.base = cast::<__m512i, [u32; LANES]>(base)[LANES - 1];
    done
}

/// Writes the events of a block and returns how many; none when `out` has not the room.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512vl,avx512vbmi2,avx512vpopcntdq,bmi2,popcnt")]
fn store(heads: &Heads, masks: __m512i, out: &mut [Event]) -> Option<usize> {
    let masks = _mm512_maskz_mov_epi32(heads.events, masks);
    let less_one = |masks| _mm512_add_epi32(masks, splat(u32::MAX));
    let before_first = _mm512_andnot_si512(masks, less_one(masks));
    let beyond_first = _mm512_and_si512(masks, less_one(masks));
    let beyond_second = _mm512_and_si512(beyond_first, less_one(beyond_first));
    let some = |masks| _mm512_test_epi32_mask(masks, masks);

    let first = _mm512_add_epi32(heads.pixel, _mm512_popcnt_epi32(before_first));
    let two = some(beyond_first);
    if two == 0 {
        let squeezed = |lanes| _mm512_maskz_compress_epi32(heads.events, lanes);
        *out.first_chunk_mut()? = interleave(squeezed(heads.time()), squeezed(first));
        return Some(heads.events.count_ones() as usize);
    }
    if some(beyond_second) != 0 {
        return store_many(masks, heads.time(), heads.pixel, out);
    }
    let column_31 = _mm512_add_epi32(heads.pixel, splat(VECTOR_LEN as u32 - 1));
    let last = _mm512_sub_epi32(column_31, _mm512_lzcnt_epi32(masks));
    Some(store_few(heads.time(), [first, last], [heads.events, two], out.first_chunk_mut()?))
}

/// Where words make any number of events. By value, since a block that is lent would live in memory.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi2,avx512vpopcntdq,popcnt")]
fn store_many(masks: __m512i, time: __m512i, pixel: __m512i, out: &mut [Event]) -> Option<usize> {
    let events = _mm512_reduce_add_epi32(_mm512_popcnt_epi32(masks)) as usize;
    let out = out.get_mut(..events + LANES)?; // what the last store writes beyond
    let pairs: [u64; LANES / 2] = cast(masks);
    let mut n = 0;
    for (pair, columns) in pairs.into_iter().enumerate() {
        let list: [__m128i; 4] = cast(_mm512_maskz_compress_epi8(columns, cast(LANE_AND_COLUMN)));
        let first_lane = splat(2 * pair as u32);
        let end = n + columns.count_ones() as usize;
        for places in list {
            if n >= end {
                break;
            }
            let slots = out.get_mut(n..)?.first_chunk_mut()?;
            let places = _mm512_cvtepu8_epi32(places);
            let lanes = _mm512_add_epi32(first_lane, _mm512_srli_epi32::<5>(places));
            let column = _mm512_and_si512(places, splat(VECTOR_LEN as u32 - 1));
            let upper = _mm512_add_epi32(_mm512_permutexvar_epi32(lanes, pixel), column);
            *slots = interleave(_mm512_permutexvar_epi32(lanes, time), upper);
            n += LANES;
        }
        n = end;
    }
    Some(n)
}
