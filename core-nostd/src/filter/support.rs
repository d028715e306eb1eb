//! How many of a pixel's 8 neighbours support its event: what background activity filters with a count share.

use crate::time_map::Stamp;

/// Which neighbours' events support an event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum PolarityMatch {
    /// Those of either polarity.
    #[default]
    Any,
    /// Those of the same polarity.
    Same,
}

/// How many of the neighbours fired at most `dt` before `now`.
///
/// The sum is as wide as the stamps: then a compiler adds all eight at once.
#[inline(always)]
pub(super) fn recent<T: Stamp>(neighbours: [T; 8], now: T, dt: i32) -> u32 {
    let floor = now.less(dt);
    let old = neighbours.iter().fold(T::default(), |old, last| old.plus(last.is_before(floor)));
    8 - old.number()
}

/// Where among three rows of three each neighbour is, in the order of [`Pixels::neighbourhood`].
///
/// [`Pixels::neighbourhood`]: crate::time_map::Pixels::neighbourhood
const PLACES: [u32; 8] = [1, 3, 5, 7, 0, 2, 6, 8];

/// How many of those have a 1 in `alike`, three rows of three, the first the lowest.
#[inline(always)]
pub(super) fn recent_alike<T: Stamp>(neighbours: [T; 8], now: T, dt: i32, alike: u32) -> u32 {
    const OWN: u32 = 1 << 4;
    let floor = now.less(dt);
    let old = neighbours
        .iter()
        .zip(PLACES)
        .fold(OWN, |old, (last, place)| old | last.is_before(floor).number() << place);
    (alike & !old & 0x1FF).count_ones()
}
