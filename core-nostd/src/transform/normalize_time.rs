//! Time that starts at 0, for streams; for a whole slice see [`SliceNormalize`](crate::slice::SliceNormalize).

use super::time_shift::shift;
use crate::{Block, Geometry, Transform, Unfit};

/// Moves t to t - t0, t0 the time of the first event that it is ever given. Later events that are older than that one, as
/// clocks step back now and then, would come before time 0 and are dropped.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::NormalizeTime};
/// let mut normalize = NormalizeTime::new(Geometry::new(640, 480));
/// for (t, after) in [(5_000_000_000u64, 0), (5_000_000_030, 30)] {
///     let mut events = [Event::new(t as u32, 1, 2, Polarity::On)];
///     let mut block = Block::new(t, t, Geometry::new(640, 480), &mut events);
///     normalize.apply(&mut block)?;
///     assert_eq!(block.span().time(block.span().events[0]), after);
/// }
/// # Ok::<(), lobula_core::Unfit>(())
/// ```
#[derive(Clone, Debug)]
pub struct NormalizeTime {
    geometry: Geometry,
    origin: Option<u64>,
}

impl NormalizeTime {
    /// For a sensor's events.
    pub const fn new(geometry: Geometry) -> Self {
        Self { geometry, origin: None }
    }

    /// What is taken from every time, in µs, once an event was seen.
    pub const fn origin(&self) -> Option<u64> {
        self.origin
    }
}

impl Transform for NormalizeTime {
    fn output_geometry(&self) -> Geometry {
        self.geometry
    }

    fn time(&self, t: u64) -> Option<u64> {
        t.checked_sub(self.origin?)
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        self.geometry.check(block.geometry)?;
        let span = block.span();
        let Some(first) = span.events.first() else { return Ok(0) };
        let origin = *self.origin.get_or_insert(span.time(*first));
        // Beyond 2^63 µs, which is 292 000 years, the shift would not fit.
        Ok(shift(block, self.geometry, 0i64.saturating_sub_unsigned(origin))?)
    }
}
