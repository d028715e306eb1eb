//! Steady stretches of 16 words at a time, on 64-bit ARM CPUs: a word is a lane of 32 bits. Where all are events, all are
//! stored; else four at a time, with TIME_HIGH words squeezed out and their times filled in after them.
#![allow(unsafe_code)] // one call, of code for this CPU: see `Kernel` for what it gains

use super::{Steady, WORD_BYTES};
use crate::Event;
use crate::wire::kernel::Done;
use crate::wire::neon::{
    Bounds, Cpu, Heads, LANES, PAIR, are_events, coordinates, interleave, pixel, splat, squeeze, time,
};
use bytemuck::cast;
use core::arch::aarch64::*;

/// Words of a block.
const BLOCK: usize = 4 * LANES;

/// Takes words from the start of `words` as long as they are steady and come in whole blocks that `out` has room for.
pub fn run(_: Cpu, steady: &mut Steady, words: &[[u8; WORD_BYTES]], out: &mut [Event]) -> Done {
    // SAFETY: `stretch` is safe code for a CPU with NEON, of which there being a `Cpu` is the proof.
    unsafe { stretch(steady, words, out) }
}

#[target_feature(enable = "neon")]
fn stretch(steady: &mut Steady, words: &[[u8; WORD_BYTES]], out: &mut [Event]) -> Done {
    let bounds = Bounds::new(steady);
    let mut base = splat(steady.base);
    let mut done = Done::default();
    for block in words.as_chunks::<BLOCK>().0 {
        let Some(slots) = out.get_mut(done.events..).and_then(<[Event]>::first_chunk_mut) else { break };
        if events(block, base, &bounds, slots) {
            done = done + Done { words: BLOCK, events: BLOCK };
            continue;
        }
        let (part, after) = mixed(block, base, &bounds, slots);
        base = after;
        done = done + part;
        if part.words < BLOCK {
            break;
        }
    }
    steady.base = vgetq_lane_u32::<0>(base);
    done
}

/// Writes the event of every word; false if any is none on the sensor.
#[inline]
#[target_feature(enable = "neon")]
fn events(
    block: &[[u8; WORD_BYTES]; BLOCK],
    base: uint32x4_t,
    bounds: &Bounds,
    slots: &mut [Event; BLOCK],
) -> bool {
    let (mut kinds, mut on_sensor) = (splat(0), splat(u32::MAX));
    for (words, slots) in block.as_chunks::<LANES>().0.iter().zip(slots.as_chunks_mut().0) {
        let words = cast(*words);
        let coordinates = coordinates(words);
        kinds = vorrq_u32(kinds, words);
        on_sensor = vandq_u32(on_sensor, bounds.contain(coordinates));
        *slots = interleave(time(words, base), pixel(words, coordinates));
    }
    vminvq_u32(vandq_u32(are_events(kinds), on_sensor)) == u32::MAX
}

/// Writes the events of a block with other words among them, up to the first that is not steady. Also the base after it.
#[inline(never)] // rare: away from the registers of the others
#[target_feature(enable = "neon")]
fn mixed(
    block: &[[u8; WORD_BYTES]; BLOCK],
    mut base: uint32x4_t,
    bounds: &Bounds,
    slots: &mut [Event; BLOCK],
) -> (Done, uint32x4_t) {
    let mut done = Done::default();
    for words in block.as_chunks::<PAIR>().0 {
        let heads = Heads::new(cast(*words), [splat(u32::MAX); 2], base, bounds);
        for (half, (time, pixel)) in heads.time.into_iter().zip(heads.pixel).enumerate() {
            let set = heads.events >> (LANES * half) & ((1 << LANES) - 1);
            let Some(slots) = slots.get_mut(done.events..).and_then(<[Event]>::first_chunk_mut) else {
                break;
            };
            *slots = interleave(squeeze(time, set), squeeze(pixel, set));
            done.events += set.count_ones() as usize;
        }
        base = heads.base;
        done.words += heads.steady;
        if heads.steady < PAIR {
            break;
        }
    }
    (done, base)
}
