//! How recently each pixel fired: an exponential decay of the age of its last event.
//!
//! Source: Lagorce et al., HOTS: A Hierarchy of Event-Based Time-Surfaces for Pattern Recognition, TPAMI 2017, section
//! 3.1, for the whole sensor at the window's end.

use core::marker::PhantomData;

use crate::math::exp;
use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::{BadRepresentation, Build, Parameters, Real, check};
use crate::vector::widest;
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// See [`TimeSurface::TAU_US_MAX`].
pub(super) const TAU_US_MAX: u32 = 1 << 25;

/// Ages of this many decays and more are 0 exactly (exp(-32) is 1.3e-14).
const DECAYS_MAX: u32 = 32;

/// An age that stands for every greater one, and for never: what the longest decay needs, 2^30 µs.
const OLD_US: u32 = TAU_US_MAX * DECAYS_MAX;

/// exp(-age / tau) of the last event of each pixel and polarity: 2 x H x W (ON, OFF) of f32 or f16.
///
/// The age is counted from the window's end; the value is in (0, 1], and 0 exactly where nothing ever fired or the
/// age is 32 tau or more. The last event is the last in stream order; one older than its window counts at its start.
///
/// The surface remembers across windows: the times are kept in a map of the caller's, `2 x H x W` elements of u32 µs
/// ([`state_len`](Self::state_len)), and hold through silence of any length. A window that ends before the one
/// before it did is a restart of the clock and forgets everything.
///
/// With a window that ends at the newest event's time this is the surface of libraries that count ages from there.
///
/// ```
/// use lobula_core::representation::TimeSurface;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [Event::new(900, 1, 0, Polarity::On)];
/// let mut out = [f32::NAN; 4]; // whatever was there
/// let mut surface = TimeSurface::try_new(geometry, 100, [0; 4])?;
/// surface.begin(Window { t0: 0, t1: 1_000 }, &mut out);
/// surface.accumulate(Span { t_first: 900, t_last: 900, geometry, events: &events }, &mut out)?;
/// surface.finish(&mut out);
/// assert_eq!(out, [0.0, lobula_core::math::exp(-1.0), 0.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct TimeSurface<P, S> {
    geometry: Geometry,
    tau_us: u32,
    window: Window,
    /// When no age in the map was over [`OLD_US`]; none before the first window.
    settled: Option<u64>,
    map: S,
    pixel: PhantomData<P>,
}

impl<P: Real, S: AsRef<[u32]> + AsMut<[u32]>> TimeSurface<P, S> {
    /// The longest decay, in µs (33.6 s).
    pub const TAU_US_MAX: u32 = TAU_US_MAX;

    /// Elements of the map.
    pub const fn state_len(geometry: Geometry) -> usize {
        2 * geometry.pixels()
    }

    /// For a sensor of this size, a decay of 1 to [`TAU_US_MAX`](Self::TAU_US_MAX) µs and a map of
    /// [`state_len`](Self::state_len) elements, whatever they hold.
    pub fn try_new(geometry: Geometry, tau_us: u32, map: S) -> Result<Self, BadRepresentation> {
        if tau_us == 0 || tau_us > Self::TAU_US_MAX {
            return Err(BadRepresentation::TauUs { found: tau_us });
        }
        let (expected, found) = (Self::state_len(geometry), map.as_ref().len());
        if expected != found {
            return Err(BadRepresentation::StateLen { expected, found });
        }
        let window = Window { t0: 0, t1: 0 };
        Ok(Self { geometry, tau_us, window, settled: None, map, pixel: PhantomData })
    }

    /// Readies the map for a window: by its end no age will have reached 2^31 µs, so that 32 bits tell them apart.
    fn settle(&mut self, window: Window) {
        let before = self.window.t1;
        let reaches = |settled: u64| window.t1.wrapping_sub(settled) < u64::from(OLD_US);
        let settled = self.settled.filter(|_| window.t1 >= before);
        self.settled = match settled {
            Some(settled) if reaches(settled) => Some(settled),
            Some(_) if reaches(before) => {
                self.bring_down(before as u32);
                Some(before)
            }
            // The first window, or a restart of the clock, or all that was is too old to be seen.
            _ => {
                self.map.as_mut().fill((window.t0 as u32).wrapping_sub(OLD_US));
                Some(window.t0)
            }
        };
    }

    /// Makes every age of over [`OLD_US`] at time `now` this one.
    fn bring_down(&mut self, now: u32) {
        for last in self.map.as_mut() {
            *last = now.wrapping_sub(now.wrapping_sub(*last).min(OLD_US));
        }
    }
}

impl<P: Real, S: AsRef<[u32]> + AsMut<[u32]>> Representation for TimeSurface<P, S> {
    type Pixel = P;

    fn shape(&self) -> Shape {
        Shape { channels: 2, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn begin(&mut self, window: Window, _: &mut [P]) {
        self.settle(window);
        self.window = window;
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [P]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let (geometry, window, map) = (self.geometry, self.window, self.map.as_mut());
        widest(
            #[inline(always)]
            || draw_each(span.events, Places::by_polarity(geometry), map, &mut Stamping::new(window)),
        );
        Ok(())
    }

    fn finish(&mut self, out: &mut [P]) {
        let (now, tau_us, map) = (self.window.t1 as u32, self.tau_us, self.map.as_ref());
        widest(
            #[inline(always)]
            || decay(now, tau_us, map, out),
        );
    }
}

/// Notes the times of events, as far as they lie in the window.
struct Stamping {
    t0: u32,
    length: i32,
}

impl Stamping {
    fn new(window: Window) -> Self {
        let length = window.t1.saturating_sub(window.t0).min(OLD_US.into()) as i32;
        Self { t0: window.t0 as u32, length }
    }
}

impl Draw for Stamping {
    type Pixel = u32;
    type Value = u32;

    #[inline(always)]
    fn prepare(&self, event: Event, _: &mut u32) -> u32 {
        let since = (event.t().wrapping_sub(self.t0) as i32).max(0).min(self.length);
        self.t0.wrapping_add(since as u32)
    }

    #[inline(always)]
    fn draw(&mut self, map: &mut [u32], at: usize, stamp: u32) {
        // Stores that miss the cache wait for each other, loads do not: hence the look before.
        if let Some(last) = map.get_mut(at).filter(|last| **last != stamp) {
            *last = stamp;
        }
    }
}

/// exp(-age / tau) of each time in the map.
#[inline(always)]
fn decay<P: Real>(now: u32, tau_us: u32, map: &[u32], out: &mut [P]) {
    let rate = -1.0 / tau_us as f32;
    let age_end = (tau_us * DECAYS_MAX) as i32;
    for (pixel, last) in out.iter_mut().zip(map) {
        let age = now.wrapping_sub(*last) as i32;
        let value = exp(age as f32 * rate);
        *pixel = P::from_share(if age < age_end { value } else { 0.0 });
    }
}

impl<P: Real, S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for TimeSurface<P, S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.tau_us, state)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wider_vectors_give_the_same_bits() {
        let geometry = Geometry::new(101, 53);
        let map: Vec<u32> =
            (0..2 * geometry.pixels() as u32).map(|i| i.wrapping_mul(0x9E37_79B1) >> 9).collect();
        let mut surface = TimeSurface::<f32, _>::try_new(geometry, 300_000, map.clone()).unwrap();
        surface.window.t1 = 1 << 23;
        let mut wide = vec![0.0; map.len()];
        surface.finish(&mut wide);
        let mut plain = vec![0.0f32; map.len()];
        decay(1 << 23, 300_000, &map, &mut plain);
        let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&wide), bits(&plain));
        assert!(wide.iter().filter(|value| **value > 0.0).count() > map.len() / 2);
    }
}
