//! The compaction under every filter and transform that drops events: no branch on the verdict, which on noise no
//! predictor can guess.
//!
//! Where a verdict depends on those before it, [`compact`] takes an event after the other. Where each event speaks for
//! itself, [`select`] first computes the verdicts of a tile, in vectors, and then closes its gaps at once.

mod gaps;

use crate::Event;
use core::cell::Cell;
pub(crate) use gaps::select_tiles;

/// Events of a tile.
const TILE: usize = 64;

/// Moves the events of `run` that `keep` keeps to `events[kept..]`, in order; returns `kept` after it. With each event
/// comes what is known of it already.
///
/// `run` reads, one after the other, events of `events` from place `kept` or later. Every event is stored, and only
/// the place of the next one depends on the verdict.
#[inline(always)]
pub(crate) fn compact<K>(
    events: &[Cell<Event>],
    mut kept: usize,
    run: impl Iterator<Item = (Event, K)>,
    mut keep: impl FnMut(Event, K) -> bool,
) -> usize {
    for (event, known) in run {
        if let Some(slot) = events.get(kept) {
            slot.set(event);
        }
        kept += keep(event, known) as usize;
    }
    kept
}

/// Thins all of `events`; returns how many are left at their start.
#[inline(always)]
pub(crate) fn compact_all(events: &mut [Event], mut keep: impl FnMut(Event) -> bool) -> usize {
    let events = Cell::from_mut(events).as_slice_of_cells();
    compact(events, 0, events.iter().map(|cell| (cell.get(), ())), |event, ()| keep(event))
}

/// Keeps the events that `keep` keeps, each by what it is itself; returns how many are left at the start. `keep` should
/// own what it compares with, which then is in registers and not looked up for each event.
#[inline(always)]
pub(crate) fn thin(events: &mut [Event], keep: impl Fn(Event) -> bool) -> usize {
    select(
        events,
        #[inline(always)]
        move |word, _| (word, keep(Event::from_word(word))),
    )
}

/// Changes the events, each a word ([`Event::word`]), and keeps those that `moved` says have a place; with each comes the
/// number of events before it. Returns how many are left at the start. As to what `moved` should own, see [`thin`].
#[inline(always)]
pub(crate) fn select(events: &mut [Event], moved: impl Fn(u64, usize) -> (u64, bool)) -> usize {
    select_tiles(
        events,
        #[inline(always)]
        move |words, places, from| {
            for (i, (word, place)) in words.iter_mut().zip(places).enumerate() {
                let (to, has_place) = moved(*word, from + i);
                (*word, *place) = (to, u64::from(has_place));
            }
        },
    )
}

/// Judges tile after tile. `close_gaps` writes the words whose place is 1 and not 0, in order, to the start of a tile of
/// events, and anything behind them; it returns how many.
#[inline(always)]
fn each_tile(
    events: &mut [Event],
    judge: impl Fn(&mut [u64; TILE], &mut [u64; TILE], usize),
    close_gaps: impl Fn(&[u64; TILE], &[u64; TILE], &mut [Event; TILE]) -> usize,
) -> usize {
    let (mut from, mut kept) = (0, 0);
    while let Some(tile) = events.get(from..).and_then(|rest| rest.first_chunk::<TILE>()) {
        let (mut words, mut places) = (tile.map(Event::word), [0; TILE]);
        judge(&mut words, &mut places, from);
        // What is kept is written over what was read before.
        let out = events.get_mut(kept..).and_then(|events| events.first_chunk_mut::<TILE>());
        kept += out.map_or(0, |out| close_gaps(&words, &places, out));
        from += TILE;
    }
    let rest = events.get(from..).unwrap_or_default();
    if rest.is_empty() {
        return kept;
    }
    let (mut words, mut places, mut tile) = ([0; TILE], [0; TILE], [Event::default(); TILE]);
    words.iter_mut().zip(rest).for_each(|(word, event)| *word = event.word());
    judge(&mut words, &mut places, from);
    places.iter_mut().skip(rest.len()).for_each(|place| *place = 0);
    let left = close_gaps(&words, &places, &mut tile);
    let out = events.get_mut(kept..).unwrap_or_default();
    out.iter_mut().zip(&tile).take(left).for_each(|(slot, event)| *slot = *event);
    kept + left
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polarity;

    #[test]
    fn keeps_order_and_closes_gaps() {
        for pattern in 0..1u32 << 6 {
            let mut events: [Event; 6] = core::array::from_fn(|i| Event::new(i as u32, 0, 0, Polarity::On));
            let kept = compact_all(&mut events, |event| pattern >> event.t() & 1 == 1);
            let times: Vec<u32> = events[..kept].iter().map(|event| event.t()).collect();
            let expected: Vec<u32> = (0..6).filter(|i| pattern >> i & 1 == 1).collect();
            assert_eq!(times, expected);
        }
    }

    #[test]
    fn selection_keeps_order_at_any_length() {
        for len in [0, 1, 5, 63, 64, 65, 127, 128, 129, 300] {
            for every in [1, 2, 3, 7, 64, 1000] {
                let event = |t: usize, x| Event::new(t as u32, x, 2, Polarity::from_bit(t as u16));
                let mut events: Vec<Event> = (0..len).map(|i| event(i, 1)).collect();
                let kept = select(&mut events, |word, i| {
                    assert!(i >= len || word == event(i, 1).word());
                    (event(i, 3).word(), i % every == 0)
                });
                let expected: Vec<Event> = (0..len).step_by(every).map(|i| event(i, 3)).collect();
                assert_eq!(events[..kept], expected, "{len} {every}");
            }
        }
    }
}
