//! A shift in time.

use super::pixels::{at_time, move_all, select};
use crate::{Block, Geometry, Transform, Unfit, WrongGeometry};

/// Parameters of [`TimeShift`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct TimeShiftParams {
    /// What is added to every time, in µs.
    pub dt_us: i64,
}

/// Moves t to t + dt. Events that would come before time 0 are dropped. A block's own times move with its events', to 0
/// at the least.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::{TimeShift, TimeShiftParams}};
/// let mut events = [Event::new(50, 1, 2, Polarity::On), Event::new(120, 1, 2, Polarity::On)];
/// let mut block = Block::new(50, 120, Geometry::new(640, 480), &mut events);
/// assert_eq!(TimeShift::new(block.geometry, TimeShiftParams { dt_us: -100 }).apply(&mut block)?, 1);
/// assert_eq!(block.span().time(block.span().events[0]), 20);
/// assert_eq!((block.t_first, block.t_last), (0, 20));
/// # Ok::<(), lobula_core::Unfit>(())
/// ```
#[derive(Clone, Debug)]
pub struct TimeShift {
    geometry: Geometry,
    dt: i64,
}

impl TimeShift {
    /// A shift of a sensor's events.
    pub const fn new(geometry: Geometry, params: TimeShiftParams) -> Self {
        Self { geometry, dt: params.dt_us }
    }
}

impl Transform for TimeShift {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn time(&self, t: u64) -> Option<u64> {
        t.checked_add_signed(self.dt)
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        Ok(shift(block, self.geometry, self.dt)?)
    }
}

/// Moves a block's events and its own times by `dt`.
pub(super) fn shift(block: &mut Block<'_>, geometry: Geometry, dt: i64) -> Result<usize, WrongGeometry> {
    let anchor = block.t_first;
    // How far before the anchor time 0 (or after it the end of time) lies after the shift: blocks reach 2^31 µs at most.
    let after = i128::from(anchor) + i128::from(dt);
    let (low, high) = (-after, i128::from(u64::MAX) - after);
    let whole = low <= i128::from(i32::MIN) && high >= i128::from(i32::MAX);
    let left = if whole {
        move_all(
            block,
            geometry,
            geometry,
            #[inline(always)]
            move |word| at_time(word, (word as u32).wrapping_add(dt as u32)),
        )
    } else {
        let clamped = |bound: i128| bound.clamp(i128::from(i64::MIN), i128::from(i64::MAX)) as i64;
        let (low, high) = (clamped(low), clamped(high));
        select(
            block,
            geometry,
            geometry,
            #[inline(always)]
            move |word, _| {
                let offset = i64::from((word as u32).wrapping_sub(anchor as u32) as i32);
                let moved = at_time(word, (word as u32).wrapping_add(dt as u32));
                (moved, (offset >= low) & (offset <= high))
            },
        )
    }?;
    block.t_first = anchor.saturating_add_signed(dt);
    block.t_last = block.t_last.saturating_add_signed(dt);
    Ok(left)
}
