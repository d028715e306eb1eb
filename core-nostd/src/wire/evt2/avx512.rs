//! Steady stretches of 16 words at a time, on x86-64 CPUs with AVX-512: a word is a lane of 32 bits. TIME_HIGH words
//! among the events are squeezed out; the lanes after one take its time by the last set bit of the mask before them.
#![allow(unsafe_code)] // one call, of code for this CPU: 2 times as fast as the portable kernel

use super::{Steady, WORD_BYTES};
use crate::Event;
use crate::wire::avx512::{Cpu, Heads, LANES, interleave, splat};
use crate::wire::kernel::Done;
use bytemuck::cast;
use core::arch::x86_64::*;

/// Takes words from the start of `words` as long as they are steady and come in whole blocks that `out` has room for.
pub fn run(_: Cpu, steady: &mut Steady, words: &[[u8; WORD_BYTES]], out: &mut [Event]) -> Done {
    // SAFETY: `stretch` is safe code for a CPU with its features, of which there being a `Cpu` is the proof.
    unsafe { stretch(steady, words, out) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512vl,avx512vbmi2,avx512vpopcntdq,bmi1,bmi2,popcnt")]
fn stretch(steady: &mut Steady, words: &[[u8; WORD_BYTES]], out: &mut [Event]) -> Done {
    let mut done = Done::default();
    let mut base = splat(steady.base);
    for block in words.as_chunks::<LANES>().0 {
        let Some(slots) = out.get_mut(done.events..).and_then(|out| out.first_chunk_mut()) else { break };
        let block: __m512i = cast(*block);
        let heads = Heads::new(block, u16::MAX, base, steady);
        base = heads.base;
        let (time, pixel) = (heads.time(), heads.pixel);
        *slots = if heads.events == u16::MAX {
            interleave(time, pixel)
        } else {
            let squeezed = |lanes| _mm512_maskz_compress_epi32(heads.events, lanes);
            interleave(squeezed(time), squeezed(pixel))
        };
        done.events += heads.events.count_ones() as usize;
        done.words += heads.steady;
        if heads.steady < LANES {
            break;
        }
    }
    steady.base = cast::<__m512i, [u32; LANES]>(base)[LANES - 1];
    done
}
