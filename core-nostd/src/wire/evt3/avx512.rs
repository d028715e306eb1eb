//! Steady stretches by 16 words at a time, on x86-64 CPUs with AVX-512 (Ice Lake, Zen 4 and later).
//!
//! A word is a lane of 32 bits.
//!
//! 1. A mask for each type of word.
//! 2. Each lane learns the row, the low time and the base that hold there: the leading zeros of the mask up to the
//!    lane name the last word of the type, a permute fetches it, from the block before where this one has none. The
//!    columns that vectors have moved the base on by are a count of the mask's bits.
//! 3. Every word that makes events is now a first column and a mask of the columns from there: 1 for ADDR_X.
//! 4. The lanes that make one event and those that make a second are compressed to a list in stream order; by it time
//!    and column and row are fetched, interleaved and stored. Where a word makes three events or more, the masks
//!    themselves are compressed to such a list, four words at a time.
//!
//! Words that are not steady end the stretch: the block is understood again with them and those after them blanked.
#![allow(unsafe_code)] // one call, of code for this CPU: 1.8 times as fast as the portable kernel, see `Kernel`

use super::kernel::Steady;
use super::{
    ADDR_X, COORDINATE, OTHERS, PAYLOAD, POLARITY_SHIFT, TIME_LOW, VECT_8, VECT_12, VECT_BASE_X, word,
};
use crate::wire::avx512::{BEFORE, Cpu, LANES, fill, interleave, splat, store_few};
use crate::wire::kernel::Done;
use crate::{Event, Polarity};
use bytemuck::cast;
use core::arch::x86_64::*;

/// Room for what a block stores at most: all the events, and what the last store writes beyond them.
const MANY: usize = 12 * LANES + LANES;
/// Words of a stretch at most, and the base at its start: so bases stay below 2^16.
const STRETCH: usize = 4096;
const BASE_MAX: u16 = 4095;

/// Added to the base in its field, which so is positive also before a block's moves are subtracted.
const BIAS: u32 = 1 << 16;
/// Added to the first column where a count of leading zeros is to be subtracted.
const TOP: u32 = 31;
/// Fields of the upper half of an event.
const ROW_SHIFT: u32 = 16;
const ON: u32 = 1 << 31;

/// The types that can be steady: bit `i` for type `i`. TIME_HIGH is looked at by itself.
const STEADY_TYPES: u32 = 0b1100_0000_1111_1101;

/// For each bit of four masks of 16 bits: the lane in the upper four bits, the column in the lower.
const LANE_AND_COLUMN: [u8; 64] = {
    let mut list = [0; 64];
    let mut i = 0;
    while i < list.len() {
        list[i] = i as u8;
        i += 1;
    }
    list
};

/// See [`run`](super::kernel::run).
pub fn run(_: Cpu, state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
    let mut done = Done::default();
    loop {
        let rest = words.get(done.words..).unwrap_or_default();
        let spare = out.get_mut(done.events..).unwrap_or_default();
        // SAFETY: `stretch` is safe code for a CPU with its features, of which there being a `Cpu` is the proof.
        let part = unsafe { stretch(state, rest.get(..STRETCH).unwrap_or(rest), spare) };
        done.words += part.words;
        done.events += part.events;
        if part.words < STRETCH {
            return done;
        }
    }
}

/// Goes through at most [`STRETCH`] words.
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512vl,avx512vbmi2,avx512vpopcntdq,bmi1,bmi2,popcnt")]
fn stretch(state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
    let sensor = Sensor::new(state);
    let mut carry = Carry::new(state);
    let mut done = Done::default();
    let mut rest = words;
    while !rest.is_empty() {
        let (mut words, mut count) = load(rest);
        let mut block = understand(words, &carry, &sensor);
        if block.unsteady != 0 {
            count = count.min(block.unsteady.trailing_zeros() as usize);
            words = blank_from(count, words);
            block = understand(words, &carry, &sensor);
        }
        let Some(stored) = store(&block, out.get_mut(done.events..).unwrap_or_default()) else { break };
        done.events += stored;
        done.words += count;
        carry = block.carry;
        if count < LANES {
            break;
        }
        rest = rest.get(LANES..).unwrap_or_default();
    }
    carry.leave(state);
    done
}

/// What a stretch is compared with.
struct Sensor {
    time_high: __m512i,
    repeated: __m512i,
    /// Width and height, in the fields of column and row.
    size: __m512i,
}

/// What the words before have left behind: in the last lane, as tables for [`fill`].
struct Carry {
    time: __m512i,
    row: __m512i,
    base: __m512i,
    base_known: bool,
}

/// A block of words, understood.
struct Block {
    /// Lanes that end the stretch.
    unsteady: u16,
    /// For each lane a bit for each column from the first that has an event.
    columns: __m512i,
    time: __m512i,
    /// Upper halves of the events: of column [`TOP`], of the first and of the last of `columns`.
    top: __m512i,
    first: __m512i,
    last: __m512i,
    /// Lanes that make at least one event, two, three.
    makes: [u16; 3],
    carry: Carry,
}

impl Sensor {
    #[inline]
    #[target_feature(enable = "avx512f")]
    fn new(state: &Steady) -> Self {
        let size = u32::from(state.geometry.width) | u32::from(state.geometry.height) << ROW_SHIFT;
        Self {
            time_high: splat(state.time & !u32::from(PAYLOAD)),
            repeated: splat(state.repeated.into()),
            size: splat(size),
        }
    }
}

impl Carry {
    #[inline]
    #[target_feature(enable = "avx512f")]
    fn new(state: &Steady) -> Self {
        let (x, polarity) = state.base.unwrap_or((0, Polarity::Off));
        Self {
            time: splat(state.time),
            row: splat(u32::from(state.row) << ROW_SHIFT | TOP),
            base: splat((polarity as u32) << 31 | (u32::from(x) + BIAS)),
            base_known: state.base.is_some_and(|(x, _)| x <= BASE_MAX),
        }
    }

    #[inline]
    #[target_feature(enable = "avx512f")]
    fn leave(&self, state: &mut Steady) {
        let last = |table| -> u32 {
            let [.., last]: [u32; LANES] = cast::<__m512i, _>(table);
            last
        };
        state.time = last(self.time);
        state.row = (last(self.row) >> ROW_SHIFT) as u16;
        if self.base_known {
            let base = last(self.base);
            state.base = Some(((base - BIAS) as u16, Polarity::from_bit((base >> 31) as u16)));
        }
    }
}

/// The next words, as lanes, and how many; lanes without a word are blank.
#[inline]
#[target_feature(enable = "avx512f,avx512vl")]
fn load(words: &[[u8; 2]]) -> (__m512i, usize) {
    let (block, count) = match words.first_chunk::<LANES>() {
        Some(block) => (*block, LANES),
        None => {
            let mut block = [word(OTHERS, 0).to_le_bytes(); LANES];
            block.iter_mut().zip(words).for_each(|(to, from)| *to = *from);
            (block, words.len())
        }
    };
    (_mm512_cvtepu16_epi32(cast(block)), count)
}

/// The words with the lanes from `count` on replaced by words without meaning.
#[inline]
#[target_feature(enable = "avx512f")]
fn blank_from(count: usize, words: __m512i) -> __m512i {
    let kept = ((1u32 << count) - 1) as u16;
    _mm512_mask_mov_epi32(splat(word(OTHERS, 0).into()), kept, words)
}

/// For each lane the number of `lanes` before it.
#[inline]
#[target_feature(enable = "avx512f,avx512cd,avx512vpopcntdq")]
fn count_before(lanes: u16) -> __m512i {
    _mm512_popcnt_epi32(_mm512_and_si512(_mm512_broadcastmw_epi32(lanes), cast(BEFORE)))
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512vl,avx512vpopcntdq,bmi1,bmi2,popcnt")]
fn understand(words: __m512i, before: &Carry, sensor: &Sensor) -> Block {
    let kind = _mm512_srli_epi32::<12>(words);
    let of = |which: u16| _mm512_cmpeq_epi32_mask(kind, splat(which.into()));
    let rows = _mm512_testn_epi32_mask(kind, kind);
    let (singles, bases, times) = (of(ADDR_X), of(VECT_BASE_X), of(TIME_LOW));
    let (vectors_12, vectors_8) = (of(VECT_12), of(VECT_8));
    let vectors = vectors_12 | vectors_8;

    let coordinate = _mm512_and_si512(words, splat(COORDINATE.into()));
    let shifted = _mm512_slli_epi32::<{ 31 - POLARITY_SHIFT }>(words);
    let with_polarity = |field| _mm512_ternarylogic_epi32::<SELECT>(splat(ON), shifted, field);

    let time = fill(
        _mm512_ternarylogic_epi32::<SELECT>(splat(PAYLOAD.into()), words, sensor.time_high),
        times,
        before.time,
    );
    let row_field = splat(u32::from(COORDINATE) << ROW_SHIFT);
    let row = fill(
        _mm512_ternarylogic_epi32::<SELECT>(row_field, _mm512_slli_epi32::<ROW_SHIFT>(words), splat(TOP)),
        rows,
        before.row,
    );

    // Vectors move a base by 12 or 8 columns: a base is told less the moves before it in the block, which are added
    // again where it is used.
    let vectors_twice = _mm512_slli_epi32::<1>(count_before(vectors));
    let moved = _mm512_slli_epi32::<2>(_mm512_add_epi32(count_before(vectors_12), vectors_twice));
    let told = with_polarity(_mm512_sub_epi32(_mm512_add_epi32(coordinate, splat(BIAS)), moved));
    let base = _mm512_add_epi32(fill(told, bases, before.base), moved);
    let base_after = _mm512_mask_add_epi32(base, vectors_12, base, splat(12));
    let base_after = _mm512_mask_add_epi32(base_after, vectors_8, base, splat(8));

    let column = _mm512_mask_sub_epi32(with_polarity(coordinate), vectors, base, splat(BIAS));
    let columns = _mm512_maskz_and_epi32(vectors_12, words, splat(0xFFF));
    let columns = _mm512_mask_and_epi32(columns, vectors_8, words, splat(0xFF));
    let columns = _mm512_mask_mov_epi32(columns, singles, splat(1));

    let top = _mm512_add_epi32(column, row);
    let less = |columns| _mm512_add_epi32(columns, splat(u32::MAX));
    let beyond_first = _mm512_and_si512(columns, less(columns));
    let first = _mm512_sub_epi32(top, _mm512_lzcnt_epi32(_mm512_xor_si512(columns, beyond_first)));
    let last = _mm512_sub_epi32(top, _mm512_lzcnt_epi32(columns));
    let makes_one = _mm512_test_epi32_mask(columns, columns);
    let makes_two = _mm512_test_epi32_mask(beyond_first, beyond_first);
    let makes_three = _mm512_test_epi32_mask(beyond_first, less(beyond_first));

    let steady_types = _mm512_srlv_epi32(splat(STEADY_TYPES), kind);
    let other = _mm512_testn_epi32_mask(steady_types, splat(1));
    let other = _mm512_mask_cmpneq_epi32_mask(other, words, sensor.repeated);
    let place = _mm512_maskz_and_epi32(makes_one, last, splat(!(1 << 31)));
    let off = _mm512_cmpge_epu16_mask(place, sensor.size);
    let baseless = if before.base_known { 0 } else { vectors };
    let unsteady = other | off_lanes(off) | baseless;

    let base_known = before.base_known || bases != 0;
    Block {
        unsteady,
        columns,
        time,
        top,
        first,
        last,
        makes: [makes_one, makes_two, makes_three],
        carry: Carry { time, row, base: base_after, base_known },
    }
}

/// Truth table of `a ? b : c`.
const SELECT: i32 = 0xCA;

/// Lanes of which the column or the row is off the sensor.
#[inline]
#[target_feature(enable = "bmi2")]
fn off_lanes(halves: u32) -> u16 {
    if halves == 0 { 0 } else { _pext_u32(halves | halves >> 1, 0x5555_5555) as u16 }
}

/// Writes the events of a block and returns how many; none when `out` has not the room.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi2,bmi2,popcnt")]
fn store(block: &Block, out: &mut [Event]) -> Option<usize> {
    match block.makes {
        [one, two, 0] => {
            Some(store_few(block.time, [block.first, block.last], [one, two], out.first_chunk_mut()?))
        }
        _ => Some(store_many(block.columns, block.top, block.time, out.first_chunk_mut()?)),
    }
}

/// Where words make any number of events. By value, since a block that is lent would live in memory.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi2,popcnt")]
fn store_many(columns: __m512i, top: __m512i, time: __m512i, out: &mut [Event; MANY]) -> usize {
    let column_0 = _mm512_sub_epi32(top, splat(TOP));
    let quarters: [u64; 4] = cast(_mm512_cvtepi32_epi16(columns));
    let mut n = 0;
    for (columns, lane) in quarters.into_iter().zip([0x00, 0x40, 0x80, 0xC0u8]) {
        let places = _mm512_or_si512(cast(LANE_AND_COLUMN), _mm512_set1_epi8(lane as i8));
        let list: [__m128i; 4] = cast(_mm512_maskz_compress_epi8(columns, places));
        let end = n + columns.count_ones() as usize;
        for places in list {
            if n >= end {
                break;
            }
            let Some(slots) = out.get_mut(n..).and_then(|out| out.first_chunk_mut()) else { break };
            let places = _mm512_cvtepu8_epi32(places);
            let lanes = _mm512_srli_epi32::<4>(places);
            let column = _mm512_and_si512(places, splat(15));
            let upper = _mm512_add_epi32(_mm512_permutexvar_epi32(lanes, column_0), column);
            *slots = interleave(_mm512_permutexvar_epi32(lanes, time), upper);
            n += LANES;
        }
        n = end;
    }
    n
}
