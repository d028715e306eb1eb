//! The one compaction under every filter: no branch on the verdict, which on noise no predictor can guess.

use crate::Event;
use core::cell::Cell;

/// Moves the events of `run` that `keep` keeps to `events[kept..]`, in order; returns `kept` after it.
///
/// `run` is a part of `events` that starts at `kept` or later. Every event is stored, and only the place of the next
/// one depends on the verdict.
#[inline(always)]
pub(crate) fn compact(
    events: &[Cell<Event>],
    mut kept: usize,
    run: &[Cell<Event>],
    mut keep: impl FnMut(Event) -> bool,
) -> usize {
    for cell in run {
        let event = cell.get();
        if let Some(slot) = events.get(kept) {
            slot.set(event);
        }
        kept += keep(event) as usize;
    }
    kept
}

/// Thins all of `events`; returns how many are left at their start.
#[inline(always)]
pub(crate) fn compact_all(events: &mut [Event], keep: impl FnMut(Event) -> bool) -> usize {
    let cells = Cell::from_mut(events).as_slice_of_cells();
    compact(cells, 0, cells, keep)
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
