//! Steady stretches of 8 words at a time, on 64-bit ARM CPUs: the two halves of a word are lanes of 32 bits. Where none
//! makes three events, the lanes of first and last events are squeezed together, in turn; else word by word, as the portable kernel does.
#![allow(unsafe_code)] // one call, of code for this CPU: see `Kernel` for what it gains

use super::{LEGACY, Steady, VECTOR_LEN, WORD_BYTES, expand};
use crate::Event;
use crate::event::packed::pack;
use crate::wire::kernel::Done;
use crate::wire::neon::{Bounds, Cpu, Heads, LANES, NOWHERE, PAIR, interleave, sets, splat};
use bytemuck::cast;
use core::arch::aarch64::*;

/// Events of a block none of whose words makes more than two.
const FEW: usize = 2 * PAIR;

/// For each set of lanes that make one event, in the lower four bits, and of those that make a second: the places of the
/// events in two vectors, of first events and of last.
static FEW_PLACES: [[[u8; 16]; 2]; 1 << PAIR] = {
    let mut table = [[[NOWHERE; 16]; 2]; 1 << PAIR];
    let mut set = 0;
    while set < table.len() {
        let (mut i, mut to) = (0, 0);
        while i < PAIR {
            let (lane, second) = (i / 2, i % 2);
            if set >> (lane + LANES * second) & 1 == 1 {
                let mut byte = 0;
                while byte < 4 {
                    table[set][to / LANES][to % LANES * 4 + byte] = (16 * second + 4 * lane + byte) as u8;
                    byte += 1;
                }
                to += 1;
            }
            i += 1;
        }
        set += 1;
    }
    table
};

/// Takes words from the start of `words` as long as they are steady and come in whole blocks that `out` has room for.
pub fn run<const ORDER: u8>(
    _: Cpu,
    steady: &mut Steady,
    words: &[[u8; WORD_BYTES]],
    out: &mut [Event],
) -> Done {
    // SAFETY: `stretch` is safe code for a CPU with NEON, of which there being a `Cpu` is the proof.
    unsafe { stretch::<ORDER>(steady, words, out) }
}

#[target_feature(enable = "neon")]
fn stretch<const ORDER: u8>(steady: &mut Steady, words: &[[u8; WORD_BYTES]], out: &mut [Event]) -> Done {
    let bounds = Bounds::new(steady);
    let mut base = splat(steady.base);
    let mut done = Done::default();
    for block in words.as_chunks::<PAIR>().0 {
        let [a, b, c, d]: [uint32x4_t; 4] = cast(*block);
        let lower = [vuzp1q_u32(a, b), vuzp1q_u32(c, d)];
        let upper = [vuzp2q_u32(a, b), vuzp2q_u32(c, d)];
        let (masks, heads) = match ORDER {
            LEGACY => (upper, lower),
            _ => (lower, upper),
        };
        let heads = Heads::new(heads, masks.map(|masks| vtstq_u32(masks, masks)), base, &bounds);
        let Some(events) = store(&heads, masks, out.get_mut(done.events..).unwrap_or_default()) else {
            break;
        };
        base = heads.base;
        done = done + Done { words: heads.steady, events };
        if heads.steady < PAIR {
            break;
        }
    }
    steady.base = vgetq_lane_u32::<0>(base);
    done
}

/// Writes the events of a block and returns how many; none when `out` has not the room.
#[inline]
#[target_feature(enable = "neon")]
fn store(heads: &Heads, masks: [uint32x4_t; 2], out: &mut [Event]) -> Option<usize> {
    let less_one = |masks| vaddq_u32(masks, splat(u32::MAX));
    let beyond_first = masks.map(|masks| vandq_u32(masks, less_one(masks)));
    let makes_two = beyond_first.map(|beyond| vtstq_u32(beyond, beyond));
    let makes_three = beyond_first.map(|beyond| vtstq_u32(beyond, less_one(beyond)));
    let [two, three] = sets(makes_two, makes_three);
    if three & heads.events != 0 {
        return store_many(heads.time, heads.pixel, masks, heads.events, out);
    }
    let out: &mut [Event; FEW] = out.first_chunk_mut()?;
    let low = |set: u8| set % (1 << LANES);
    let one = heads.events;
    let two = two & one;
    let makes = [low(one) | low(two) << LANES, one >> LANES | two >> LANES << LANES];
    let mut n = 0;
    for i in 0..2 {
        let column_31 = vaddq_u32(heads.pixel[i], splat(VECTOR_LEN as u32 - 1));
        let at_top = |mask| vsubq_u32(column_31, vclzq_u32(mask));
        let (first, last) = (at_top(veorq_u32(masks[i], beyond_first[i])), at_top(masks[i]));
        let upper = uint8x16x2_t(cast(first), cast(last));
        let time = uint8x16x2_t(cast(heads.time[i]), cast(heads.time[i]));
        let slots: &mut [Event; 2 * LANES] = out.get_mut(n..)?.first_chunk_mut()?;
        for (places, slots) in FEW_PLACES[usize::from(makes[i])].iter().zip(slots.as_chunks_mut().0) {
            let squeezed = |table| cast(vqtbl2q_u8(table, cast(*places)));
            *slots = interleave(squeezed(time), squeezed(upper));
        }
        n += makes[i].count_ones() as usize;
    }
    Some(n)
}

/// Where words make any number of events. By value, since a block that is lent would live in memory.
#[inline(never)]
#[target_feature(enable = "neon")]
fn store_many(
    time: [uint32x4_t; 2],
    pixel: [uint32x4_t; 2],
    masks: [uint32x4_t; 2],
    events: u8,
    out: &mut [Event],
) -> Option<usize> {
    let [time, pixel, masks]: [[u32; PAIR]; 3] = [time, pixel, masks].map(|halves| cast(halves));
    let mut n = 0;
    for (lane, ((time, pixel), mask)) in time.into_iter().zip(pixel).zip(masks).enumerate() {
        if events >> lane & 1 == 1 {
            n += expand(mask, pack(time, pixel), out.get_mut(n..)?.first_chunk_mut()?);
        }
    }
    Some(n)
}
