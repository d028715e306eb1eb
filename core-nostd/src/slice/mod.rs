//! Operations that need a whole slice, in one block in the caller's memory: the last event can change the first.
//!
//! | type | what becomes of a slice |
//! |---|---|
//! | [`SliceSort`] | its events in order of time; those of one time stay in theirs |
//! | [`SliceReverse`] | its film backwards: time mirrored within its span, ON for OFF, order reversed |
//! | [`SliceNormalize`] | its earliest event at time 0 |
//!
//! A slice is a block, so it spans less than 2^31 µs (36 minutes). Nothing here allocates.

mod normalize;
mod reverse;
mod sort;

pub use normalize::SliceNormalize;
pub use reverse::SliceReverse;
pub use sort::SliceSort;

use crate::{Block, Event};

/// Time of an event from the block's anchor in µs, as a number that grows with it: 2^31 is the anchor.
#[inline(always)]
pub(crate) const fn key(anchor: u64, event: Event) -> u32 {
    event.t().wrapping_sub(anchor as u32) ^ 1 << 31
}

/// The keys of the earliest and the latest event; `None` for no event.
fn key_range(block: &Block<'_>) -> Option<(u32, u32)> {
    let (anchor, events) = (block.t_first, block.span().events);
    let first = key(anchor, *events.first()?);
    let range = |(low, high): (u32, u32), event: &Event| {
        let key = key(anchor, *event);
        (if key < low { key } else { low }, if key > high { key } else { high })
    };
    Some(events.iter().fold((first, first), range))
}

/// The full time of a key.
const fn time_of(anchor: u64, key: u32) -> u64 {
    crate::full_time(anchor, (key ^ 1 << 31).wrapping_add(anchor as u32))
}
