//! Steady stretches of one word after another. Only what is rare is left to a branch: a word of more than two events,
//! and the end of the stretch.

use super::{EVT_POS, Limits, Steady, WORD_BYTES, Word, WordOrder, expand};
use crate::Event;
use crate::wire::kernel::Done;

/// Bits of the upper half that no event has.
const NO_EVENT: u32 = !(EVT_POS << 28 | 0xFFF_FFFF);

/// Takes words from the start of `words` as long as they are steady and `out` has room.
pub fn run<const ORDER: u8>(steady: &mut Steady, words: &[[u8; WORD_BYTES]], out: &mut [Event]) -> Done {
    let mut done = Done::default();
    let mut now = *steady;
    for bytes in words {
        let word = Word::from_bytes(*bytes, WordOrder::from_const(ORDER));
        let Some(slots) = out.get_mut(done.events..).and_then(<[Event]>::first_chunk_mut) else { break };
        let is_time = now.take_time(word.head);
        if (no_vector(word, now.limits) & !is_time) != 0 {
            break;
        }
        done.events += expand(word.mask & !is_time, word.first(now.base), slots);
        done.words += 1;
    }
    steady.base = now.base;
    done
}

/// 0 for a vector on the sensor. A number and not a truth, which would become a branch for each of its parts.
#[inline(always)]
const fn no_vector(word: Word, limits: Limits) -> u32 {
    let no_event = word.head & NO_EVENT;
    let off_sensor = limits.guards(word.head) & Limits::GUARDS ^ Limits::GUARDS;
    let empty = (word.mask | word.mask.wrapping_neg()) >> 31 ^ 1;
    no_event | off_sensor | empty
}
