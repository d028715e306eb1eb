//! Steady stretches of 8 words at a time: nothing but shifts, masks and one subtraction per word, so that it vectorises.

use super::{Limits, Steady, WORD_BYTES, is_cd, pixel};
use crate::Event;
use crate::event::packed::pack;
use crate::wire::kernel::Done;
use crate::wire::time_high::time_low;

/// Words decoded at a time, without a branch between them.
const LANES: usize = 8;

/// Takes words from the start of `words` as long as they are steady and `out` has room.
pub fn run(steady: &mut Steady, words: &[[u8; WORD_BYTES]], out: &mut [Event]) -> Done {
    let mut done = Done::default();
    loop {
        let rest = words.get(done.words..).unwrap_or_default();
        let n = events(steady, rest, out.get_mut(done.events..).unwrap_or_default());
        done = done + Done { words: n, events: n };
        let Some(word) = rest.get(n) else { break };
        if steady.take_time(u32::from_le_bytes(*word)) == 0 {
            break;
        }
        done.words += 1;
    }
    done
}

/// Takes CD words as long as they follow each other, lie on the sensor and fit; how many.
#[inline]
fn events(steady: &Steady, words: &[[u8; WORD_BYTES]], out: &mut [Event]) -> usize {
    let mut n = 0;
    for (words, slots) in words.as_chunks().0.iter().zip(out.as_chunks_mut().0) {
        if !lanes(steady, words, slots) {
            break;
        }
        n += LANES;
    }
    for (word, slot) in words.iter().zip(out).skip(n) {
        if !lane(steady, word, slot) {
            break;
        }
        n += 1;
    }
    n
}

/// Writes the events of several words; false if any is not that of a CD word on the sensor.
#[inline]
fn lanes(steady: &Steady, words: &[[u8; WORD_BYTES]; LANES], slots: &mut [Event; LANES]) -> bool {
    let (mut kinds, mut guards) = (0, Limits::GUARDS);
    let mut packed = [0u64; LANES];
    for (slot, word) in packed.iter_mut().zip(words) {
        let word = u32::from_le_bytes(*word);
        kinds |= word;
        guards &= steady.limits.guards(word);
        *slot = pack(steady.base | time_low(word), pixel(word));
    }
    *slots = bytemuck::cast(packed);
    is_cd(kinds) && guards == Limits::GUARDS
}

/// Writes the event of a word; false if it is not that of a CD word on the sensor.
#[inline]
fn lane(steady: &Steady, word: &[u8; WORD_BYTES], slot: &mut Event) -> bool {
    let word = u32::from_le_bytes(*word);
    *slot = bytemuck::cast(pack(steady.base | time_low(word), pixel(word)));
    is_cd(word) && steady.limits.contain(word)
}
