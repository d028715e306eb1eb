//! Bursts: events of one polarity in quick succession at a pixel, as one edge makes them. What filters that keep a part
//! of each share.

use super::plane::{self, Plane};
use super::{FilterError, cleared};
use crate::time_map::{Pixels, Reach, Stamp, TimeMap};
use crate::{Block, Event, Geometry, WrongGeometry};

/// Where in its burst an event is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    First,
    Second,
    Later,
}

/// What tells it: of each pixel the time of its last event, its polarity and whether it was its burst's first.
#[derive(Clone, Debug)]
pub(super) struct Bursts<T, S> {
    map: TimeMap<T, S>,
    gap: i32,
}

impl<T: Stamp, S> Bursts<T, S> {
    /// Entries of memory it needs: a time map and two bits for each of its entries.
    pub(super) const fn required_len(geometry: Geometry) -> usize {
        TimeMap::<T, S>::required_len(geometry).saturating_add(2 * plane::words::<T>(geometry))
    }
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> Bursts<T, S> {
    /// Bursts whose events follow each other by less than `dt_us`, and by just that if `or_equal`.
    pub(super) fn try_new(
        geometry: Geometry,
        (dt_us, or_equal): (u32, bool),
        shift: u8,
        mut memory: S,
    ) -> Result<Self, FilterError> {
        cleared(memory.as_mut(), Self::required_len(geometry))?;
        let map = TimeMap::try_new(geometry, shift, memory)?;
        Ok(Self { gap: map.ticks(dt_us)?.saturating_add(or_equal as i32), map })
    }

    pub(super) fn advance(&mut self, now: u64) {
        self.map.advance(now);
    }

    pub(super) fn keep(&mut self, event: Event, keeps: impl Fn(Place) -> bool) -> bool {
        let gap = self.gap;
        self.map.keep(event, |pixels, at, event, now| place(pixels, at, event, now, gap).is_some_and(&keeps))
    }

    #[inline(always)]
    pub(super) fn retain(
        &mut self,
        block: &mut Block<'_>,
        keeps: impl Fn(Place) -> bool,
    ) -> Result<usize, WrongGeometry> {
        let gap = self.gap;
        self.map.retain(block, Reach::Pixel, |pixels, at, event, now| {
            place(pixels, at, event, now, gap).is_some_and(&keeps)
        })
    }
}

#[inline(always)]
fn place<T: Stamp>(pixels: &Pixels<'_, T>, at: usize, event: Event, now: T, gap: i32) -> Option<Place> {
    let [on, not_first] = Plane::two(pixels);
    let (pixel, last_on, last_not_first) = (pixels.pixel(at)?, on.bit(at)?, not_first.bit(at)?);
    let goes_on = (now.age(pixel.get()) < gap) & (last_on.get() == event.is_on());
    let later = goes_on & last_not_first.get();
    pixel.set(now);
    last_on.set(event.is_on());
    last_not_first.set(goes_on);
    Some(match (goes_on, later) {
        (false, _) => Place::First,
        (true, false) => Place::Second,
        (true, true) => Place::Later,
    })
}
