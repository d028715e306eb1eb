//! A stretch of time: what lies outside it is dropped.

use super::TransformError;
use super::pixels::select;
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
        let is_within = is_within(window, block.t_first);
        Ok(select(
            block,
            self.geometry,
            self.geometry,
            #[inline(always)]
            move |word, _| (word, is_within(word)),
        )?)
    }
}

/// Whether an event's word, of a block with this anchor, is of the window.
#[inline(always)]
pub(crate) fn is_within(window: Window, anchor: u64) -> impl Fn(u64) -> bool {
    let offset = |t: u64| (i128::from(t) - i128::from(anchor)).clamp(-(1 << 40), 1 << 40) as i64;
    let (low, high) = (offset(window.t0), offset(window.t1));
    #[inline(always)]
    move |word| {
        let t = i64::from((word as u32).wrapping_sub(anchor as u32) as i32);
        (t >= low) & (t < high)
    }
}
