//! What the kernels for 64-bit ARM CPUs share: NEON, which each of them has, in lanes of 32 bits.
//!
//! Plain loads and stores are casts, so nothing here is unsafe: what this is compiled for has NEON, see `mod.rs`.

use super::steady::Steady;
use super::time_high::LOW_BITS;
use crate::Event;
use bytemuck::cast;
use core::arch::aarch64::*;

/// Words of a vector, and of the two that are understood together.
pub(super) const LANES: usize = 4;
pub(super) const PAIR: usize = 2 * LANES;
/// Both coordinates of an event's upper half.
const COORDINATES: u32 = 0x7FF_07FF;
/// A byte of a table of places that names none.
pub(super) const NOWHERE: u8 = u8::MAX;

/// That the CPU has NEON.
#[derive(Clone, Copy, Debug)]
pub struct Cpu(());

impl Cpu {
    /// This is compiled for CPUs that have it.
    pub const fn detect() -> Option<Self> {
        Some(Self(()))
    }
}

/// For each set of lanes of so many bytes, for each lane the place of the last in the set up to it, [`NOWHERE`] where
/// there is none.
pub(super) const fn last_of<const SETS: usize>(lane_bytes: usize) -> [[u8; 16]; SETS] {
    let mut table = [[NOWHERE; 16]; SETS];
    let mut set = 0;
    while set < SETS {
        let (mut byte, mut last) = (0, NOWHERE);
        while byte < 16 {
            let lane = byte / lane_bytes;
            if set >> lane & 1 == 1 {
                last = (lane * lane_bytes) as u8;
            }
            if last != NOWHERE {
                table[set][byte] = last + (byte % lane_bytes) as u8;
            }
            byte += 1;
        }
        set += 1;
    }
    table
}

/// [`last_of`] for four lanes.
static LAST: [[u8; 16]; 1 << LANES] = last_of(4);

/// For each set of four lanes their places, moved to the front.
static SQUEEZE: [[u8; 16]; 1 << LANES] = {
    let mut table = [[NOWHERE; 16]; 1 << LANES];
    let mut set = 0;
    while set < table.len() {
        let (mut lane, mut to) = (0, 0);
        while lane < LANES {
            if set >> lane & 1 == 1 {
                let mut byte = 0;
                while byte < 4 {
                    table[set][to + byte] = (4 * lane + byte) as u8;
                    byte += 1;
                }
                to += 4;
            }
            lane += 1;
        }
        set += 1;
    }
    table
};

/// All lanes of this value.
#[inline]
#[target_feature(enable = "neon")]
pub(super) fn splat(value: u32) -> uint32x4_t {
    cast([value; LANES])
}

/// The lanes of this set, moved to the front.
#[inline]
#[target_feature(enable = "neon")]
pub(super) fn squeeze(lanes: uint32x4_t, set: u8) -> uint32x4_t {
    let places = SQUEEZE[usize::from(set) % SQUEEZE.len()];
    cast(vqtbl1q_u8(cast(lanes), cast(places)))
}

/// Events of their times and upper halves.
#[inline]
#[target_feature(enable = "neon")]
pub(super) fn interleave(time: uint32x4_t, upper: uint32x4_t) -> [Event; LANES] {
    cast([vzip1q_u32(time, upper), vzip2q_u32(time, upper)])
}

/// Two sets of the lanes of two vectors, each of which has all bits set or none: the first in the lower byte.
#[inline]
#[target_feature(enable = "neon")]
pub(super) fn sets(first: [uint32x4_t; 2], second: [uint32x4_t; 2]) -> [u8; 2] {
    let narrow = |[a, b]: [uint32x4_t; 2]| vuzp1q_u16(cast(a), cast(b));
    let bits = [1u16, 2, 4, 8, 16, 32, 64, 128];
    let first = vandq_u16(narrow(first), cast(bits));
    let second = vandq_u16(narrow(second), cast(bits.map(|bit| bit << 8)));
    vaddvq_u16(vorrq_u16(first, second)).to_le_bytes()
}

/// The coordinates of EVT 2.0 words, or of the upper halves of EVT 2.1, as an event's upper half has them.
#[inline]
#[target_feature(enable = "neon")]
pub(super) fn coordinates(words: uint32x4_t) -> uint32x4_t {
    vandq_u32(vsliq_n_u32::<16>(vshrq_n_u32::<11>(words), words), splat(COORDINATES))
}

/// The upper halves of the events of such words.
#[inline]
#[target_feature(enable = "neon")]
pub(super) fn pixel(words: uint32x4_t, coordinates: uint32x4_t) -> uint32x4_t {
    vsliq_n_u32::<31>(coordinates, vshrq_n_u32::<28>(words))
}

/// The times of such words.
#[inline]
#[target_feature(enable = "neon")]
pub(super) fn time(words: uint32x4_t, base: uint32x4_t) -> uint32x4_t {
    vbslq_u32(splat((1 << LOW_BITS) - 1), vshrq_n_u32::<22>(words), base)
}

/// What a stretch of such words is compared with.
pub(super) struct Bounds {
    /// Pixels of a row and of a column: a coordinate is less.
    size: uint32x4_t,
    /// TIME_HIGH words that are steady: the first, and how many.
    first: uint32x4_t,
    count: uint32x4_t,
}

impl Bounds {
    #[inline]
    #[target_feature(enable = "neon")]
    pub fn new(steady: &Steady) -> Self {
        // The limits are the size less one, with guards over both.
        let size = splat(steady.limits.0.wrapping_sub(0x7FFF_7FFF));
        Self { size, first: splat(steady.reach.first), count: splat(steady.reach.count) }
    }

    /// All bits set for coordinates on the sensor: 16 for each of the two.
    #[inline]
    #[target_feature(enable = "neon")]
    pub fn contain(&self, coordinates: uint32x4_t) -> uint32x4_t {
        cast(vcgtq_u16(cast(self.size), cast(coordinates)))
    }
}

/// All bits set for words that are events by their type.
#[inline]
#[target_feature(enable = "neon")]
pub(super) fn are_events(words: uint32x4_t) -> uint32x4_t {
    vcltq_u32(words, splat(2 << 28))
}

/// Eight words, understood.
pub(super) struct Heads {
    /// How many come before the first that is not steady.
    pub steady: usize,
    /// Which of them are events.
    pub events: u8,
    /// In all lanes the time of low bits 0 that holds after the eight.
    pub base: uint32x4_t,
    /// For each lane the time of its event, and its upper half: for EVT 2.1 that of bit 0.
    pub time: [uint32x4_t; 2],
    pub pixel: [uint32x4_t; 2],
}

impl Heads {
    /// Of these words, of which the lanes that have all bits set in `events_may` can be events; all lanes of `before`
    /// hold the base before them.
    #[inline]
    #[target_feature(enable = "neon")]
    pub fn new(
        words: [uint32x4_t; 2],
        events_may: [uint32x4_t; 2],
        before: uint32x4_t,
        bounds: &Bounds,
    ) -> Self {
        let [a, b] = words;
        let coordinates = words.map(|words| coordinates(words));
        let on_sensor = coordinates.map(|at| vceqq_u32(bounds.contain(at), splat(u32::MAX)));
        let events = |i: usize| vandq_u32(vandq_u32(are_events(words[i]), on_sensor[i]), events_may[i]);
        let times = words.map(|words| vcltq_u32(vsubq_u32(words, bounds.first), bounds.count));
        let steady = [vorrq_u32(events(0), times[0]), vorrq_u32(events(1), times[1])];
        let [times, steady] = sets(times, steady);
        let count = steady.trailing_ones();
        let taken = ((1u32 << count) - 1) as u8;
        let times = times & taken;
        let told = words.map(|words| vshlq_n_u32::<{ LOW_BITS as i32 }>(words));
        let bases_a = fill(told[0], times % (1 << LANES), before);
        let bases_b = fill(told[1], times >> LANES, vdupq_laneq_u32::<3>(bases_a));
        Self {
            steady: count as usize,
            events: taken & !times,
            base: vdupq_laneq_u32::<3>(bases_b),
            time: [time(a, bases_a), time(b, bases_b)],
            pixel: [pixel(a, coordinates[0]), pixel(b, coordinates[1])],
        }
    }
}

/// For each lane what `table` holds in the last lane of `lanes` up to it; where there is none, what `before` holds.
#[inline]
#[target_feature(enable = "neon")]
fn fill(table: uint32x4_t, lanes: u8, before: uint32x4_t) -> uint32x4_t {
    let places = LAST[usize::from(lanes) % LAST.len()];
    cast(vqtbx1q_u8(cast(before), cast(table), cast(places)))
}
