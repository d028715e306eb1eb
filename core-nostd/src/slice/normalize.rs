//! Time that starts at 0.

use super::{key_range, time_of};
use crate::{Block, Event};

/// Moves t to t - t_min, t_min the time of the slice's earliest event, so that none is lost.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, slice::SliceNormalize};
/// let mut events = [130, 100, 150].map(|t| Event::new(t, 0, 0, Polarity::On));
/// let mut block = Block::new(130, 150, Geometry::new(4, 1), &mut events);
/// SliceNormalize.apply(&mut block);
/// assert_eq!(block.span().events.iter().map(|event| event.t()).collect::<Vec<_>>(), [30, 0, 50]);
/// assert_eq!((block.t_first, block.t_last), (30, 50));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SliceNormalize;

impl SliceNormalize {
    /// Normalizes a slice.
    pub fn apply(&mut self, slice: &mut Block<'_>) {
        let Some((low, _)) = key_range(slice) else { return };
        let earliest = time_of(slice.t_first, low);
        for event in slice.events_mut() {
            *event = Event::with_t(*event, event.t().wrapping_sub(earliest as u32));
        }
        // The anchor may itself be earlier than any event: then the earliest takes its place.
        slice.t_first = slice.t_first.saturating_sub(earliest);
        slice.t_last = slice.t_last.saturating_sub(earliest);
    }
}
