//! The one compaction under every filter: no branch on the verdict, which on noise no predictor can guess.

use crate::Event;
use core::cell::Cell;

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
}
