//! Polarity: keeps the events of one direction of change.

use crate::compact::thin;
use crate::{Block, Event, Filter, Geometry, Polarity, WrongGeometry};

/// Parameters of [`PolarityFilter`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct PolarityParams {
    /// The direction that stays.
    pub keep: Polarity,
}

/// Keeps the events of one polarity.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{PolarityFilter, PolarityParams}};
/// let mut filter = PolarityFilter::new(Geometry::new(640, 480), PolarityParams { keep: Polarity::On });
/// assert!(filter.keep(Event::new(0, 1, 2, Polarity::On)));
/// assert!(!filter.keep(Event::new(0, 1, 2, Polarity::Off)));
/// ```
#[derive(Clone, Debug)]
pub struct PolarityFilter {
    geometry: Geometry,
    params: PolarityParams,
}

impl PolarityFilter {
    /// A filter for events of this sensor.
    pub const fn new(geometry: Geometry, params: PolarityParams) -> Self {
        Self { geometry, params }
    }
}

impl Filter for PolarityFilter {
    #[inline]
    fn keep(&mut self, event: Event) -> bool {
        event.polarity() == self.params.keep
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        self.geometry.check(block.geometry)?;
        let keep = self.params.keep;
        let kept = thin(block.events_mut(), move |event| event.polarity() == keep);
        block.truncate(kept);
        Ok(kept)
    }
}
