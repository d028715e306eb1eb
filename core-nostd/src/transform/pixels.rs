//! The two loops under every transform: one moves all events, one drops those that have no place any more.
//!
//! Both work on events that are one word ([`Event::word`]), which compilers vectorise well. The second computes a tile
//! of words and verdicts first, in vectors, and then closes the gaps, without a branch on the verdict.

use crate::vector::widest;
use crate::{Block, Event, Geometry, WrongGeometry};

/// Events of a tile.
const TILE: usize = 64;

/// Time and polarity of a word.
const REST: u64 = 0x8000_0000_FFFF_FFFF;

/// Largest row and column that a word holds.
pub(super) const X_MAX: u64 = 0xFFFF;
pub(super) const Y_MAX: u64 = 0x7FFF;

#[inline(always)]
pub(super) const fn x_of(word: u64) -> u64 {
    word >> 32 & X_MAX
}

#[inline(always)]
pub(super) const fn y_of(word: u64) -> u64 {
    word >> 48 & Y_MAX
}

/// The event at another pixel, at most ([`X_MAX`], [`Y_MAX`]).
#[inline(always)]
pub(super) const fn at(word: u64, x: u64, y: u64) -> u64 {
    word & REST | x << 32 | y << 48
}

/// The event at another time modulo 2^32.
#[inline(always)]
pub(crate) const fn at_time(word: u64, t: u32) -> u64 {
    word & !0xFFFF_FFFF | t as u64
}

/// Moves every event of a block of sensor `from`, which becomes one of sensor `to`.
#[inline(always)]
pub(crate) fn move_all(
    block: &mut Block<'_>,
    from: Geometry,
    to: Geometry,
    moved: impl Fn(u64) -> u64,
) -> Result<usize, WrongGeometry> {
    from.check(block.geometry)?;
    let events = block.events_mut();
    widest(
        #[inline(always)]
        || {
            for event in events {
                *event = Event::from_word(moved(event.word()));
            }
        },
    );
    block.geometry = to;
    Ok(block.len())
}

/// Moves the events of a block of sensor `from`, which becomes one of sensor `to`, and keeps those that `moved` says
/// have a place; with each comes the number of events of the block before it.
#[inline(always)]
pub(crate) fn select(
    block: &mut Block<'_>,
    from: Geometry,
    to: Geometry,
    mut moved: impl FnMut(u64, usize) -> (u64, bool),
) -> Result<usize, WrongGeometry> {
    from.check(block.geometry)?;
    let events = block.events_mut();
    let kept = widest(
        #[inline(always)]
        || {
            let (mut kept, mut from) = (0, 0);
            while let Some(tile) = events.get(from..).and_then(|rest| rest.first_chunk::<TILE>()) {
                let (mut words, mut places) = ([0; TILE], [0; TILE]);
                for (i, ((event, word), place)) in tile.iter().zip(&mut words).zip(&mut places).enumerate() {
                    let (to, has_place) = moved(event.word(), from + i);
                    (*word, *place) = (to, u64::from(has_place));
                }
                if let Some(out) = events.get_mut(kept..).and_then(|rest| rest.first_chunk_mut::<TILE>()) {
                    kept += close_gaps(&words, &places, out);
                }
                from += TILE;
            }
            for i in from..events.len() {
                let Some(event) = events.get(i) else { break };
                let (word, has_place) = moved(event.word(), i);
                if let Some(slot) = events.get_mut(kept) {
                    *slot = Event::from_word(word);
                }
                kept += has_place as usize;
            }
            kept
        },
    );
    block.truncate(kept);
    block.geometry = to;
    Ok(kept)
}

/// Writes the words that have a place, in order; returns how many.
#[inline(always)]
fn close_gaps(words: &[u64; TILE], places: &[u64; TILE], out: &mut [Event; TILE]) -> usize {
    let all = places.iter().sum::<u64>() as usize;
    if all == TILE {
        for (slot, word) in out.iter_mut().zip(words) {
            *slot = Event::from_word(*word);
        }
    } else if all > 0 {
        let mut n = 0;
        for (word, place) in words.iter().zip(places) {
            // The mask changes nothing: it tells the compiler that no check is needed.
            if let Some(slot) = out.get_mut(n % TILE) {
                *slot = Event::from_word(*word);
            }
            n += *place as usize;
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polarity;

    #[test]
    fn selection_keeps_order_at_any_length() {
        let geometry = Geometry::new(8, 8);
        for len in [0, 1, 5, 63, 64, 65, 127, 128, 129, 300] {
            for every in [1, 2, 3, 7, 64, 1000] {
                let event = |i: usize| Event::new(i as u32, 1, 2, Polarity::from_bit(i as u16));
                let mut events: Vec<Event> = (0..len).map(event).collect();
                let mut block = Block::new(0, 0, geometry, &mut events);
                let kept = select(&mut block, geometry, geometry, |word, i| {
                    assert_eq!(word, event(i).word());
                    (at(word, 3, 4), i % every == 0)
                });
                assert_eq!(kept, Ok(len.div_ceil(every)));
                let expected: Vec<Event> = (0..len)
                    .step_by(every)
                    .map(|i| Event::new(i as u32, 3, 4, Polarity::from_bit(i as u16)))
                    .collect();
                assert_eq!(block.span().events, expected, "{len} {every}");
            }
        }
    }
}
