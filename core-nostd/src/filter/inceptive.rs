//! Inceptive and trailing events: the first event of an edge, and those that tell how high it is (Baldwin, Almatrafi,
//! Kaufman, Asari and Hirakawa, "Inceptive Event Time-Surfaces for Object Classification Using Neuromorphic Cameras",
//! ICIAR 2019).
//!
//! Rule. An event is trailing if the last event of its pixel has the same polarity and is at most `dt` ago, and
//! inceptive otherwise, as in the authors' program. It is confirming if it is the first trailing event after an inceptive
//! one. An inceptive event that none confirms is mostly noise; to know would be to look ahead, which no filter of a live
//! stream can, so [`InceptiveKeep::Confirming`] gives the same edges once each without the lone events, at most `dt`
//! later. Every event counts as its pixel's last. Where time stepped back, an event of the same polarity is trailing.

use super::FilterError;
use super::burst::{Bursts, Place};
use crate::time_map::Stamp;
use crate::{Block, Event, Filter, Geometry, WrongGeometry};

/// Which events are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum InceptiveKeep {
    /// Inceptive ones.
    #[default]
    Inceptive,
    /// The first trailing event after each inceptive one.
    Confirming,
    /// All trailing ones.
    Trailing,
}

/// Parameters of [`Inceptive`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default)
)]
pub struct InceptiveParams {
    /// The longest that a trailing event follows the one before, in µs; below 2^30 (`u32` map) or 2^14 ticks (`u16`),
    /// rounded down to ticks. By default 10000, as in the authors' program.
    pub dt_us: u32,
    /// Which events are kept; by default inceptive ones.
    pub keep: InceptiveKeep,
    /// Ticks of 2^shift µs; 0 for a `u32` map.
    pub shift: u8,
}

impl Default for InceptiveParams {
    fn default() -> Self {
        Self { dt_us: 10_000, keep: InceptiveKeep::Inceptive, shift: 0 }
    }
}

/// Keeps inceptive events, or those that confirm them, or trailing ones.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{Inceptive, InceptiveParams}};
/// let geometry = Geometry::new(640, 480);
/// let memory = vec![0u32; Inceptive::<u32, ()>::required_len(geometry)];
/// let params = InceptiveParams { dt_us: 1000, ..InceptiveParams::default() };
/// let mut filter = Inceptive::<u32, _>::try_new(geometry, params, memory)?;
/// let mut keep = |t| filter.keep(Event::new(t, 3, 4, Polarity::On));
/// assert_eq!([0, 1000, 2000, 3001].map(|t| keep(t)), [true, false, false, true]);
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Inceptive<T, S> {
    bursts: Bursts<T, S>,
    keep: InceptiveKeep,
}

impl<T: Stamp, S> Inceptive<T, S> {
    /// Entries of memory it needs: a time map and two bits for each of its entries.
    pub const fn required_len(geometry: Geometry) -> usize {
        Bursts::<T, S>::required_len(geometry)
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Inceptive<T, S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) entries.
    pub fn try_new(geometry: Geometry, params: InceptiveParams, memory: S) -> Result<Self, FilterError> {
        let bursts = Bursts::try_new(geometry, (params.dt_us, true), params.shift, memory)?;
        Ok(Self { bursts, keep: params.keep })
    }
}

impl InceptiveKeep {
    #[inline(always)]
    fn keeps(self, place: Place) -> bool {
        match self {
            Self::Inceptive => place == Place::First,
            Self::Confirming => place == Place::Second,
            Self::Trailing => place != Place::First,
        }
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Filter for Inceptive<T, S> {
    fn advance(&mut self, now: u64) {
        self.bursts.advance(now);
    }

    fn keep(&mut self, event: Event) -> bool {
        let keep = self.keep;
        self.bursts.keep(event, |place| keep.keeps(place))
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        let keep = self.keep;
        self.bursts.retain(block, |place| keep.keeps(place))
    }
}
