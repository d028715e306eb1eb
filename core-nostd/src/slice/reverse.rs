//! A film backwards.

use super::{SliceSort, key, key_range, time_of};
use crate::transform::TransformError;
use crate::{Block, Event};

/// Plays slices backwards: t becomes t_min + t_max - t, ON becomes OFF (what brightened, darkens), and events come in the
/// order of their new times, those of one time in the order they had. A slice that is not in order of time is sorted
/// first, for which there is scratch memory of its length as for [`SliceSort`].
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, slice::SliceReverse};
/// let mut events = [(10, 0), (20, 1), (20, 2), (50, 3)].map(|(t, x)| Event::new(t, x, 0, Polarity::On));
/// let mut block = Block::new(10, 50, Geometry::new(4, 1), &mut events);
/// SliceReverse::new([Event::default(); 4]).apply(&mut block)?;
/// let expected = [(10, 3), (40, 1), (40, 2), (50, 0)].map(|(t, x)| Event::new(t, x, 0, Polarity::Off));
/// assert_eq!(block.span().events, expected);
/// # Ok::<(), lobula_core::transform::TransformError>(())
/// ```
#[derive(Clone, Debug)]
pub struct SliceReverse<S> {
    sort: SliceSort<S>,
}

impl<S: AsMut<[Event]>> SliceReverse<S> {
    /// With scratch memory for slices of at most its length.
    pub const fn new(scratch: S) -> Self {
        Self { sort: SliceSort::new(scratch) }
    }

    /// Reverses a slice; with less scratch memory than events nothing is done.
    pub fn apply(&mut self, slice: &mut Block<'_>) -> Result<(), TransformError> {
        self.sort.apply(slice)?;
        let Some((low, high)) = key_range(slice) else { return Ok(()) };
        let anchor = slice.t_first;
        let ends = (time_of(anchor, low) as u32).wrapping_add(time_of(anchor, high) as u32);
        let events = slice.events_mut();
        events.reverse();
        for event in events.iter_mut() {
            let mirrored = event.with_t(ends.wrapping_sub(event.t()));
            *event = Event::from_word(mirrored.word() ^ 1 << 63);
        }
        let mut rest = events;
        while let Some(t) = rest.first().map(|event| event.t()) {
            let same = rest.iter().take_while(|event| event.t() == t).count();
            let Some((of_one_time, later)) = rest.split_at_mut_checked(same) else { break };
            of_one_time.reverse();
            rest = later;
        }
        // The events lie between the same times, so the anchor serves as it is, and the latest time is the same.
        debug_assert!(slice.span().events.iter().all(|event| (low..=high).contains(&key(anchor, *event))));
        Ok(())
    }
}
