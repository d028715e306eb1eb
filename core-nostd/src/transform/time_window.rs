//! A stretch of time: what lies outside it is dropped.

use super::TransformError;
use super::pixels::select;
use crate::vector::in_order;
use crate::{Block, Geometry, Transform, Unfit, Window};

/// Parameters of [`TimeWindow`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct TimeWindowParams {
    /// Start in µs, inclusive.
    pub t0_us: u64,
    /// End in µs, exclusive.
    pub t1_us: u64,
}

/// Keeps the events with t0 <= t < t1.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::{TimeWindow, TimeWindowParams}};
/// let mut events = [99, 100, 199, 200].map(|t| Event::new(t, 1, 2, Polarity::On));
/// let mut block = Block::new(99, 200, Geometry::new(640, 480), &mut events);
/// let mut window = TimeWindow::try_new(block.geometry, TimeWindowParams { t0_us: 100, t1_us: 200 })?;
/// assert_eq!(window.apply(&mut block)?, 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct TimeWindow {
    geometry: Geometry,
    params: TimeWindowParams,
}

impl TimeWindow {
    /// A window on a sensor's events.
    pub const fn try_new(geometry: Geometry, params: TimeWindowParams) -> Result<Self, TransformError> {
        if params.t0_us <= params.t1_us {
            Ok(Self { geometry, params })
        } else {
            Err(TransformError::OutOfRange { key: "t1_us", range: "no less than t0_us" })
        }
    }
}

impl Transform for TimeWindow {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn time(&self, t: u64) -> Option<u64> {
        (self.params.t0_us..self.params.t1_us).contains(&t).then_some(t)
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let window = Window { t0: self.params.t0_us, t1: self.params.t1_us };
        keep_by_time(block, self.geometry, window, true)
    }
}

/// Keeps the events of a sensor's block that are of the window, or those that are not; returns how many.
///
/// Nearly every block lies on one side of a window's borders. Whether this one does is counted first, which reads and does
/// not write.
#[inline(always)]
pub(crate) fn keep_by_time(
    block: &mut Block<'_>,
    geometry: Geometry,
    window: Window,
    within: bool,
) -> Result<usize, Unfit> {
    geometry.check(block.geometry)?;
    let is_within = is_within(window, block.t_first);
    let events = block.span().events;
    let inside = in_order(
        #[inline(always)]
        || events.iter().filter(|event| is_within(event.word())).count(),
    );
    let kept = if within { inside } else { block.len() - inside };
    match kept {
        0 => block.truncate(0),
        kept if kept == block.len() => {}
        _ => {
            select(
                block,
                geometry,
                geometry,
                #[inline(always)]
                move |word, _| (word, is_within(word) == within),
            )?;
        }
    }
    Ok(kept)
}

/// Whether an event's word, of a block with this anchor, is of the window.
#[inline(always)]
fn is_within(window: Window, anchor: u64) -> impl Fn(u64) -> bool {
    // Where the window begins and ends among the times that such an event can have.
    let offset = |t: u64| (i128::from(t) - i128::from(anchor)).clamp(-(1 << 31), 1 << 31) as i64;
    let (low, high) = (offset(window.t0), offset(window.t1));
    let (first, is_empty) = ((anchor as u32).wrapping_add(low as u32), low >= high);
    let length = (high - low).wrapping_sub(1) as u32;
    #[inline(always)]
    move |word| ((word as u32).wrapping_sub(first) <= length) & !is_empty
}
