//! Region of interest: keeps the events of a rectangle of pixels. The sensor's size stays (a crop is a transform).

use super::FilterError;
use crate::compact::thin;
use crate::{Block, Event, Filter, Geometry, WrongGeometry};

/// Parameters of [`RegionOfInterest`]: a rectangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct RegionParams {
    /// First column.
    pub x: u16,
    /// First row.
    pub y: u16,
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
}

impl RegionParams {
    #[inline(always)]
    fn contains(self, event: Event) -> bool {
        let (across, down) = (event.x().wrapping_sub(self.x), event.y().wrapping_sub(self.y));
        (across < self.width) & (down < self.height)
    }
}

/// Keeps the events with `x <= event.x < x + width` and `y <= event.y < y + height`.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{RegionOfInterest, RegionParams}};
/// let middle = RegionParams { x: 160, y: 120, width: 320, height: 240 };
/// let mut filter = RegionOfInterest::try_new(Geometry::new(640, 480), middle)?;
/// assert!(filter.keep(Event::new(0, 160, 120, Polarity::On)));
/// assert!(!filter.keep(Event::new(0, 480, 120, Polarity::On)));
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct RegionOfInterest {
    geometry: Geometry,
    params: RegionParams,
}

impl RegionOfInterest {
    /// A filter for events of this sensor; the rectangle must lie on it.
    pub const fn try_new(geometry: Geometry, params: RegionParams) -> Result<Self, FilterError> {
        let on_sensor = params.x as u32 + params.width as u32 <= geometry.width as u32
            && params.y as u32 + params.height as u32 <= geometry.height as u32;
        if on_sensor { Ok(Self { geometry, params }) } else { Err(FilterError::RegionOffSensor { geometry }) }
    }
}

impl Filter for RegionOfInterest {
    #[inline]
    fn keep(&mut self, event: Event) -> bool {
        self.params.contains(event)
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        self.geometry.check(block.geometry)?;
        let region = self.params;
        let kept = thin(block.events_mut(), move |event| region.contains(event));
        block.truncate(kept);
        Ok(kept)
    }
}
