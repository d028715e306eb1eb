//! Decimation: keeps every n-th event.
//!
//! Rule: of the events from the first on, numbered from 0, those whose number is a multiple of `n` are kept. It thins
//! noise and signal alike; where a rate is to be bounded, see [`RateLimit`](super::RateLimit).

use super::{FilterError, in_range};
use crate::{Block, Event, Filter, Geometry, WrongGeometry};

/// Parameters of [`Decimate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct DecimateParams {
    /// Of how many events one is kept, 1 (all) at least.
    pub n: u32,
}

/// Keeps the first of every `n` events.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{Decimate, DecimateParams}};
/// let mut filter = Decimate::try_new(Geometry::new(640, 480), DecimateParams { n: 3 })?;
/// let mut keep = |t| filter.keep(Event::new(t, 1, 2, Polarity::On));
/// assert_eq!([0, 1, 2, 3].map(|t| keep(t)), [true, false, false, true]);
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Decimate {
    geometry: Geometry,
    n: u32,
    /// Events to drop before the next that is kept.
    left: u32,
}

impl Decimate {
    /// A filter for events of this sensor.
    pub const fn try_new(geometry: Geometry, params: DecimateParams) -> Result<Self, FilterError> {
        match in_range("n", params.n, (1, u32::MAX)) {
            Ok(n) => Ok(Self { geometry, n, left: 0 }),
            Err(error) => Err(error),
        }
    }
}

impl Filter for Decimate {
    #[inline]
    fn keep(&mut self, _: Event) -> bool {
        let keep = self.left == 0;
        self.left = if keep { self.n } else { self.left }.wrapping_sub(1);
        keep
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        self.geometry.check(block.geometry)?;
        let (len, mut kept) = (block.len(), 0);
        let events = block.events_mut();
        for at in (self.left as usize..len).step_by(self.n.max(1) as usize) {
            if let (Some(event), Some(slot)) = (events.get(at).copied(), events.get_mut(kept)) {
                *slot = event;
            }
            kept += 1;
        }
        let next = u64::from(self.left) + u64::from(self.n) * kept as u64;
        self.left = next.saturating_sub(len as u64) as u32;
        block.truncate(kept);
        Ok(kept)
    }
}
