//! Steady stretches by 16 words at a time, on 64-bit ARM CPUs: a word is a lane of 16 bits, and what is asked of its type
//! a lane of 8. Vectors are taken as by the [`portable`] kernel: a branch on them is mispredicted by either.
//!
//! 1. A set of lanes for each type of word. The first word that is not for this loop ends it; it and those after it are
//!    in no set.
//! 2. Each lane learns the row and the low time that hold there: a table has, for a set of lanes, the last of it up to
//!    each lane.
//! 3. Lanes of ADDR_X are events. Another table squeezes them together.
#![allow(unsafe_code)] // one call, of code for this CPU: see `Kernel` for what it gains

use super::kernel::Steady;
use super::portable::{self, Vectors, limits, pack, y_of};
use super::{ADDR_X, ADDR_Y, CONTINUED_4, CONTINUED_12, COORDINATE, OTHERS, POLARITY_SHIFT, TIME_LOW, word};
use crate::wire::kernel::Done;
use crate::wire::neon::{Cpu, NOWHERE, interleave, last_of};
use crate::{Event, Polarity};
use bytemuck::cast;
use core::arch::aarch64::*;
use core::hint::black_box;

/// Words of a block: two vectors of them, one of their types.
const BLOCK: usize = 2 * LANES;
const LANES: usize = 8;
const SETS: usize = 1 << LANES;

/// For each set of lanes, for each lane the place of the last in the set up to it.
static LAST: [[u8; 16]; SETS] = last_of(2);

/// For each set of lanes, those of two tables in turn, moved to the front: in two vectors.
static IN_TURN: [[[u8; 16]; 2]; SETS] = {
    let mut table = [[[NOWHERE; 16]; 2]; SETS];
    let mut set = 0;
    while set < SETS {
        let (mut lane, mut to) = (0, 0);
        while lane < LANES {
            if set >> lane & 1 == 1 {
                let mut byte = 0;
                while byte < 4 {
                    table[set][to / 4][to % 4 * 4 + byte] = (byte / 2 * 16 + 2 * lane + byte % 2) as u8;
                    byte += 1;
                }
                to += 1;
            }
            lane += 1;
        }
        set += 1;
    }
    table
};

/// For each type all bits set if a word of it is not for this loop.
const OTHER_TYPES: [u8; 16] = {
    let mut table = [u8::MAX; 16];
    let taken = [ADDR_Y, ADDR_X, TIME_LOW, OTHERS, CONTINUED_4, CONTINUED_12];
    let mut i = 0;
    while i < taken.len() {
        table[taken[i] as usize] = 0;
        i += 1;
    }
    table
};

/// See [`run`](super::kernel::run).
pub fn run(_: Cpu, state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
    // SAFETY: `stretch` is safe code for a CPU with NEON, of which there being a `Cpu` is the proof.
    unsafe { stretch(state, words, out) }
}

#[target_feature(enable = "neon")]
fn stretch(state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
    let bounds = Bounds::new(state);
    let limits = limits(state.geometry);
    portable::stretch(state, words, out, |words, event, vectors, out| {
        let done = blocks(words, &bounds, event, vectors, out);
        let words = words.get(done.words..).unwrap_or_default();
        let out = out.get_mut(done.events..).unwrap_or_default();
        done + portable::scalars(words, &limits, event, out) // up to the end of either
    })
}

/// What a stretch is compared with.
struct Bounds {
    width: uint16x8_t,
    height: uint16x8_t,
    /// The TIME_HIGH word that changes nothing.
    repeated: uint16x8_t,
    /// A bit of its own for each of eight lanes.
    bits: uint8x16_t,
}

impl Bounds {
    #[inline]
    #[target_feature(enable = "neon")]
    fn new(state: &Steady) -> Self {
        let [width, height, repeated] =
            [state.geometry.width, state.geometry.height, state.repeated].map(|value| splat(value));
        // Not to be seen by the compiler: of sums of numbers without a bit in common it makes three instructions each.
        let bits = black_box([1u8, 2, 4, 8, 16, 32, 64, 128]);
        Self { width, height, repeated, bits: cast([bits; 2]) }
    }

    /// Four sets of lanes, each of which has all bits set or none, as 16 bits each from the lowest on.
    #[inline]
    #[target_feature(enable = "neon")]
    fn sets(&self, sets: [uint8x16_t; 4]) -> u64 {
        let [a, b, c, d] = sets.map(|set| vandq_u8(set, self.bits));
        let sums = vpaddq_u8(vpaddq_u8(a, b), vpaddq_u8(c, d));
        vget_lane_u64::<0>(cast(vpadd_u8(vget_low_u8(sums), vget_high_u8(sums))))
    }
}

/// Takes blocks, and whole vectors between them, up to any other word, or as many as `out` has room for.
#[inline]
#[target_feature(enable = "neon")]
fn blocks(
    words: &[[u8; 2]],
    bounds: &Bounds,
    event: &mut u64,
    vectors: &mut Vectors,
    out: &mut [Event],
) -> Done {
    let mut carry = Carry::new(*event);
    let mut events = 0;
    let mut rest = words;
    while let Some(block) = rest.first_chunk() {
        let Some(slots) = out.get_mut(events..).and_then(<[Event]>::first_chunk_mut) else { break };
        let done = singles(block, bounds, &mut carry, slots);
        events += done.events;
        rest = rest.get(done.words..).unwrap_or_default();
        if done.words == BLOCK {
            continue;
        }
        let spare = out.get_mut(events..).unwrap_or_default();
        let Some((n, left)) = vectors.take_whole(rest, carry.event(), spare) else { break };
        events += n;
        rest = left;
    }
    *event = carry.event();
    Done { words: words.len() - rest.len(), events }
}

/// Takes the words of a block up to the first that is not for this loop.
#[inline]
#[target_feature(enable = "neon")]
fn singles(block: &[[u8; 2]; BLOCK], bounds: &Bounds, carry: &mut Carry, slots: &mut [Event; BLOCK]) -> Done {
    let block: [uint16x8_t; 2] = cast(*block);
    let coordinates = block.map(|words| vandq_u16(words, splat(COORDINATE)));
    let sets = Sets::new(block, coordinates, bounds);
    let mut events = 0;
    for (i, (words, x)) in block.into_iter().zip(coordinates).enumerate() {
        let Some(slots) = slots.get_mut(events..).and_then(<[Event]>::first_chunk_mut) else { break };
        let slots: &mut [Event; LANES] = slots;
        let [singles, rows, times] = sets.of_half(i);
        carry.row = fill(x, rows, carry.row);
        carry.low = fill(words, times, carry.low);
        let y_on = vsliq_n_u16::<15>(carry.row, vshrq_n_u16::<{ POLARITY_SHIFT as i32 }>(words));
        let pixel = uint8x16x2_t(cast(x), cast(y_on));
        let time = uint8x16x2_t(cast(carry.time()), cast(carry.upper));
        for (places, slots) in IN_TURN[usize::from(singles)].iter().zip(slots.as_chunks_mut().0) {
            let squeezed = |table| cast(vqtbl2q_u8(table, cast(*places)));
            *slots = interleave(squeezed(time), squeezed(pixel));
        }
        events += singles.count_ones() as usize;
    }
    Done { words: sets.taken, events }
}

/// What the words before have left behind: in the last lane of each.
struct Carry {
    row: uint16x8_t,
    /// As TIME_LOW words.
    low: uint16x8_t,
    /// What makes of these the lower half of the time: the type of the word stands over the low bits.
    type_to_time: uint16x8_t,
    /// The upper half.
    upper: uint16x8_t,
}

impl Carry {
    #[inline]
    #[target_feature(enable = "neon")]
    fn new(event: u64) -> Self {
        let [lower, upper] = [event as u16, (event >> 16) as u16];
        let low = word(TIME_LOW, lower);
        Self {
            row: splat(y_of(event)),
            low: splat(low),
            type_to_time: splat(low ^ lower),
            upper: splat(upper),
        }
    }

    #[inline]
    #[target_feature(enable = "neon")]
    fn time(&self) -> uint16x8_t {
        veorq_u16(self.low, self.type_to_time)
    }

    /// The event that is next, but for its column.
    #[inline]
    #[target_feature(enable = "neon")]
    fn event(&self) -> u64 {
        let last = |lanes| vgetq_lane_u16::<{ LANES as i32 - 1 }>(lanes);
        let time = u32::from(last(self.upper)) << 16 | u32::from(last(self.time()));
        pack(time, 0, last(self.row), Polarity::Off)
    }
}

/// A block's words by type.
struct Sets {
    /// ADDR_X, ADDR_Y, TIME_LOW, 16 bits each from the lowest on.
    sets: u64,
    /// How many words are for this loop.
    taken: usize,
}

impl Sets {
    #[inline]
    #[target_feature(enable = "neon")]
    fn new([a, b]: [uint16x8_t; 2], [x_a, x_b]: [uint16x8_t; 2], bounds: &Bounds) -> Self {
        let kind = vshrq_n_u8::<4>(vuzp2q_u8(cast(a), cast(b)));
        let of = |which: u16| vceqq_u8(kind, cast([which as u8; 16]));
        let narrow = |a, b| vuzp1q_u8(cast::<uint16x8_t, _>(a), cast::<uint16x8_t, _>(b));
        let (singles, rows, times) = (of(ADDR_X), of(ADDR_Y), of(TIME_LOW));
        let repeated = narrow(vceqq_u16(a, bounds.repeated), vceqq_u16(b, bounds.repeated));
        let right = narrow(vcgeq_u16(x_a, bounds.width), vcgeq_u16(x_b, bounds.width));
        let below = narrow(vcgeq_u16(x_a, bounds.height), vcgeq_u16(x_b, bounds.height));
        let off = vorrq_u8(vandq_u8(singles, right), vandq_u8(rows, below));
        let other = vbicq_u8(vqtbl1q_u8(cast(OTHER_TYPES), kind), repeated);
        let sets = bounds.sets([singles, rows, times, vorrq_u8(other, off)]);
        let taken = (sets >> 48 | 1 << BLOCK).trailing_zeros();
        let before = (1u64 << taken) - 1;
        Self { sets: sets & (before | before << 16 | before << 32), taken: taken as usize }
    }

    /// Those of the first eight words or of the second.
    #[inline]
    #[target_feature(enable = "neon")]
    fn of_half(&self, half: usize) -> [u8; 3] {
        [0, 16, 32].map(|set| (self.sets >> (set + LANES * half)) as u8)
    }
}

/// For each lane what `table` holds in the last lane of `lanes` up to it; where there is none, what `before` holds in
/// its last lane.
#[inline]
#[target_feature(enable = "neon")]
fn fill(table: uint16x8_t, lanes: u8, before: uint16x8_t) -> uint16x8_t {
    let before = vdupq_laneq_u16::<{ LANES as i32 - 1 }>(before);
    cast(vqtbx1q_u8(cast(before), cast(table), cast(LAST[usize::from(lanes)])))
}

#[inline]
#[target_feature(enable = "neon")]
fn splat(value: u16) -> uint16x8_t {
    cast([value; LANES])
}
