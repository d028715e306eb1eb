//! Order of time, stable.
//!
//! Three ways, each tried before the next: a slice in order is left alone (one pass); one that is nearly in order, as
//! cameras' are, is put right by insertion, as long as events move 4 places on average at most; else digits of 8
//! bits are sorted from the lowest to the highest that differs, through scratch memory of the slice's length. So sorting
//! takes O(n) time, at most 4 passes, and 1 KiB of stack. All are stable, and the way taken cannot be told from the result.

use super::{key, key_range};
use crate::transform::TransformError;
use crate::{Block, Event};

/// Sorts slices by time; events of one time stay in their order.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, slice::SliceSort};
/// let mut events = [(30, 0), (10, 1), (30, 2), (20, 3)].map(|(t, x)| Event::new(t, x, 0, Polarity::On));
/// let mut block = Block::new(30, 20, Geometry::new(4, 1), &mut events);
/// SliceSort::new([Event::default(); 4]).apply(&mut block)?;
/// assert_eq!(block.span().events.iter().map(|event| event.x()).collect::<Vec<_>>(), [1, 3, 0, 2]);
/// # Ok::<(), lobula_core::transform::TransformError>(())
/// ```
#[derive(Clone, Debug)]
pub struct SliceSort<S> {
    scratch: S,
}

/// Places that insertion may move events by, per event.
const MOVES_PER_EVENT: usize = 4;

impl<S: AsMut<[Event]>> SliceSort<S> {
    /// With scratch memory for slices of at most its length.
    pub const fn new(scratch: S) -> Self {
        Self { scratch }
    }

    /// Sorts a slice; its `t_last` becomes the time of the latest event. With less scratch memory than events nothing is
    /// done, even where none would be needed: it must not depend on the events whether it works.
    pub fn apply(&mut self, slice: &mut Block<'_>) -> Result<(), TransformError> {
        let needed = slice.len();
        let found = self.scratch.as_mut().len();
        let scratch = self.scratch.as_mut().get_mut(..needed);
        let scratch = scratch.ok_or(TransformError::MemoryTooShort { needed, found })?;
        let anchor = slice.t_first;
        if !insert(slice.events_mut(), anchor)
            && let Some((low, high)) = key_range(slice)
        {
            by_digits(slice.events_mut(), scratch, anchor, low, high);
        }
        if let Some(last) = slice.span().events.last() {
            slice.t_last = slice.span().time(*last);
        }
        Ok(())
    }
}

/// Insertion; false where it gave up, which leaves all events and the order of those of one time.
fn insert(events: &mut [Event], anchor: u64) -> bool {
    let mut moves = events.len().saturating_mul(MOVES_PER_EVENT);
    let mut newest = 0;
    for i in 0..events.len() {
        let Some(&event) = events.get(i) else { break };
        let own = key(anchor, event);
        if own >= newest {
            newest = own;
            continue;
        }
        let sorted = events.get(..i).unwrap_or_default();
        let behind = sorted.iter().rev().take(moves).take_while(|other| key(anchor, **other) > own).count();
        moves -= behind;
        if moves == 0 {
            return false;
        }
        for place in (i - behind..i).rev() {
            let Some(&other) = events.get(place) else { break };
            if let Some(slot) = events.get_mut(place + 1) {
                *slot = other;
            }
        }
        if let Some(slot) = events.get_mut(i - behind) {
            *slot = event;
        }
    }
    true
}

/// By digits of 8 bits of `key - low`, lowest first; `scratch` is as long as `events`.
fn by_digits(events: &mut [Event], scratch: &mut [Event], anchor: u64, low: u32, high: u32) {
    let digits = (u32::BITS - (high - low).leading_zeros()).div_ceil(8);
    let (mut from, mut to) = (events, scratch);
    for digit in 0..digits {
        let of = |event: Event| (key(anchor, event).wrapping_sub(low) >> (8 * digit)) as u8;
        let mut places = [0u32; 256];
        for event in from.iter() {
            if let Some(count) = places.get_mut(usize::from(of(*event))) {
                *count = count.wrapping_add(1);
            }
        }
        let mut sum = 0u32;
        for place in &mut places {
            sum = sum.wrapping_add(core::mem::replace(place, sum));
        }
        for event in from.iter() {
            if let Some(place) = places.get_mut(usize::from(of(*event))) {
                if let Some(slot) = to.get_mut(*place as usize) {
                    *slot = *event;
                }
                *place = place.wrapping_add(1);
            }
        }
        (from, to) = (to, from);
    }
    if digits % 2 == 1 {
        // As far as both go, which is all the way, and so without a panic.
        for (slot, event) in to.iter_mut().zip(from) {
            *slot = *event;
        }
    }
}
