//! Steady stretches of one word after another. Only what is rare is left to a branch: a word of more than two events,
//! and the end of the stretch.

use super::{EVT_POS, Steady, WORD_BYTES, Word, WordOrder, expand};
use crate::Event;
use crate::wire::kernel::Done;

/// Takes words from the start of `words` as long as they are steady and `out` has room.
pub fn run<const ORDER: u8>(steady: &mut Steady, words: &[[u8; WORD_BYTES]], out: &mut [Event]) -> Done {
    let mut done = Done::default();
    for bytes in words {
        let word = Word::from_bytes(*bytes, WordOrder::from_const(ORDER));
        let Some(slots) = out.get_mut(done.events..).and_then(<[Event]>::first_chunk_mut) else { break };
        let is_vector = (word.kind() <= EVT_POS) & steady.limits.contain(word.head) & (word.mask != 0);
        let is_time = steady.take_time(word.head);
        if !is_vector & (is_time == 0) {
            break;
        }
        done.events += expand(word.mask & !is_time, word.first(steady.base), slots);
        done.words += 1;
    }
    done
}
