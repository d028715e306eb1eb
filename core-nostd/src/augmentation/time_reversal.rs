//! A film backwards, or not.

use super::chance::Chance;
use super::{ChanceParams, Kind, Seed};
use crate::slice::SliceReverse;
use crate::transform::TransformError;
use crate::{Block, Event};

/// [`SliceReverse`] with probability p: of a whole slice, with scratch memory for its events.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity};
/// use lobula_core::augmentation::{ChanceParams, RandomTimeReversal, Seed};
/// let scratch = [Event::default(); 2];
/// let mut reversal = RandomTimeReversal::try_new(ChanceParams { p: 1.0 }, Seed { seed: 7, slice: 3 }, scratch)?;
/// let mut events = [Event::new(10, 1, 2, Polarity::On), Event::new(30, 3, 4, Polarity::On)];
/// reversal.apply(&mut Block::new(10, 30, Geometry::new(640, 480), &mut events))?;
/// assert_eq!(events, [Event::new(10, 3, 4, Polarity::Off), Event::new(30, 1, 2, Polarity::Off)]);
/// # Ok::<(), lobula_core::transform::TransformError>(())
/// ```
#[derive(Clone, Debug)]
pub struct RandomTimeReversal<S> {
    reverse: Option<SliceReverse<S>>,
}

impl<S: AsMut<[Event]>> RandomTimeReversal<S> {
    /// For a slice, with scratch memory for as many events.
    pub fn try_new(params: ChanceParams, seed: Seed, scratch: S) -> Result<Self, TransformError> {
        let fires = Chance::try_new(params)?.hits(seed.random(Kind::TimeReversal).next());
        Ok(Self { reverse: fires.then(|| SliceReverse::new(scratch)) })
    }

    /// Whether it is done to this slice.
    pub const fn fires(&self) -> bool {
        self.reverse.is_some()
    }

    /// Reverses the slice, or leaves it.
    pub fn apply(&mut self, slice: &mut Block<'_>) -> Result<(), TransformError> {
        self.reverse.as_mut().map_or(Ok(()), |reverse| reverse.apply(slice))
    }
}
