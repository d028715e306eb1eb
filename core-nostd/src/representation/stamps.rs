//! When each element last fired: a map of 32-bit times that holds through silence of any length.

use crate::representation::BadRepresentation;
use crate::representation::index::{Draw, Places, draw_each};
use crate::vector::widest;
use crate::{Event, Window};

/// An age that stands for every greater one, and for never.
pub(super) const AGE_US_MAX: u32 = 1 << 30;

/// The times in µs of the last event of each element, in memory of the caller's. They outlast windows.
#[derive(Clone, Debug)]
pub(super) struct Stamps<S> {
    window: Window,
    /// When no age in the map was over [`AGE_US_MAX`]; none before the first window.
    settled: Option<u64>,
    map: S,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Stamps<S> {
    /// Of `expected` elements, whatever they hold.
    pub(super) fn try_new(expected: usize, map: S) -> Result<Self, BadRepresentation> {
        let found = map.as_ref().len();
        if expected != found {
            return Err(BadRepresentation::StateLen { expected, found });
        }
        Ok(Self { window: Window { t0: 0, t1: 0 }, settled: None, map })
    }

    /// Readies the map for a window: by its end no age will have reached 2^31 µs, so that 32 bits tell them apart. A
    /// window that ends before the one before it did is a restart of the clock: everything is forgotten.
    pub(super) fn begin(&mut self, window: Window) {
        let before = self.window.t1;
        let reaches = |settled: u64| window.t1.wrapping_sub(settled) < u64::from(AGE_US_MAX);
        let settled = self.settled.filter(|_| window.t1 >= before);
        self.settled = match settled {
            Some(settled) if reaches(settled) => Some(settled),
            Some(_) if reaches(before) => {
                self.bring_down(before as u32);
                Some(before)
            }
            // The first window, or a restart of the clock, or all that was is too old to be seen.
            _ => {
                self.map.as_mut().fill((window.t0 as u32).wrapping_sub(AGE_US_MAX));
                Some(window.t0)
            }
        };
        self.window = window;
    }

    /// Makes every age of over [`AGE_US_MAX`] at time `now` this one.
    fn bring_down(&mut self, now: u32) {
        for last in self.map.as_mut() {
            *last = now.wrapping_sub(now.wrapping_sub(*last).min(AGE_US_MAX));
        }
    }

    /// Notes the times of events, as far as they lie in the window.
    pub(super) fn accumulate(&mut self, events: &[Event], places: Places) {
        self.draw(events, places, 0);
    }

    /// Notes the times of events to 2 µs; the lowest bit tells whether the last was ON.
    pub(super) fn accumulate_with_polarity(&mut self, events: &[Event], places: Places) {
        self.draw(events, places, 1);
    }

    fn draw(&mut self, events: &[Event], places: Places, polarity_bit: u32) {
        let (window, map) = (self.window, self.map.as_mut());
        widest(
            #[inline(always)]
            || draw_each(events, places, map, &mut Stamping::new(window, polarity_bit)),
        );
    }

    /// The open window and the map, for those that keep more than the last time of an element.
    pub(super) fn map_mut(&mut self) -> (Window, &mut [u32]) {
        (self.window, self.map.as_mut())
    }

    /// With these times, at the end of a window.
    #[cfg(test)]
    pub(super) fn at(t1: u64, map: S) -> Self {
        Self { window: Window { t0: 0, t1 }, settled: None, map }
    }

    /// The window's end and the map: ages are the one less the other, wrapping.
    pub(super) fn ages(&self) -> (u32, &[u32]) {
        (self.window.t1 as u32, self.map.as_ref())
    }
}

struct Stamping {
    t0: u32,
    length: i32,
    polarity_bit: u32,
}

impl Stamping {
    fn new(window: Window, polarity_bit: u32) -> Self {
        let length = window.t1.saturating_sub(window.t0).min(AGE_US_MAX.into()) as i32;
        Self { t0: window.t0 as u32, length, polarity_bit }
    }
}

impl Draw for Stamping {
    type Pixel = u32;
    type Value = u32;

    #[inline(always)]
    fn prepare(&self, event: Event, _: &mut u32) -> u32 {
        let since = (event.t().wrapping_sub(self.t0) as i32).max(0).min(self.length);
        let stamp = self.t0.wrapping_add(since as u32);
        stamp & !self.polarity_bit | event.on_mask() & self.polarity_bit
    }

    #[inline(always)]
    fn draw(&mut self, map: &mut [u32], at: usize, stamp: u32) {
        // Stores that miss the cache wait for each other, loads do not: hence the look before.
        if let Some(last) = map.get_mut(at).filter(|last| **last != stamp) {
            *last = stamp;
        }
    }
}
