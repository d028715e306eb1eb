//! How recently each pixel fired: an exponential (or linear) decay of the age of its last event.
//!
//! Source: Lagorce et al., HOTS: A Hierarchy of Event-Based Time-Surfaces for Pattern Recognition, TPAMI 2017, section
//! 3.1, for the whole sensor at the window's end.

use core::marker::PhantomData;

use crate::math::exp;
use crate::representation::index::Places;
use crate::representation::stamps::{AGE_US_MAX, Stamps};
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, Real, check};
use crate::vector::in_order;
use crate::{Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// See [`TimeSurface::TAU_US_MAX`].
pub(super) const TAU_US_MAX: u32 = AGE_US_MAX / DECAYS_MAX;

/// Ages of this many decays and more are 0 exactly (exp(-32) is 1.3e-14).
pub(super) const DECAYS_MAX: u32 = 32;

/// How a value falls with age.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Decay {
    /// exp(-age / tau); 0 exactly from 32 tau on.
    #[default]
    Exponential,
    /// 1 - age / tau; 0 from tau on.
    Linear,
}

/// exp(-age / tau) of the last event of each pixel and polarity: 2 x H x W (ON, OFF) of f32 or f16. With
/// [`Decay::Linear`], 1 - age / tau as far as that is over 0.
///
/// The age is counted from the window's end; the value is in (0, 1], and 0 exactly where nothing ever fired or the
/// age is 32 tau (linear: tau) or more. The last event is the last in stream order; one older than its window counts at
/// its start.
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
    decay: Decay,
    stamps: Stamps<S>,
    pixel: PhantomData<P>,
}

impl<P: Real, S: AsRef<[u32]> + AsMut<[u32]>> TimeSurface<P, S> {
    /// The longest decay, in µs (33.6 s).
    pub const TAU_US_MAX: u32 = TAU_US_MAX;

    /// Elements of the map.
    pub const fn state_len(geometry: Geometry) -> usize {
        2 * geometry.pixels()
    }

    /// For a sensor of this size, an exponential decay of 1 to [`TAU_US_MAX`](Self::TAU_US_MAX) µs and a map of
    /// [`state_len`](Self::state_len) elements, whatever they hold.
    pub fn try_new(geometry: Geometry, tau_us: u32, map: S) -> Result<Self, BadRepresentation> {
        if tau_us == 0 || tau_us > Self::TAU_US_MAX {
            return Err(BadRepresentation::TauUs { found: tau_us });
        }
        let stamps = Stamps::try_new(Self::state_len(geometry), map)?;
        Ok(Self { geometry, tau_us, decay: Decay::Exponential, stamps, pixel: PhantomData })
    }

    /// The same with another decay.
    pub fn with_decay(self, decay: Decay) -> Self {
        Self { decay, ..self }
    }
}

impl<P: Real, S: AsRef<[u32]> + AsMut<[u32]>> Representation for TimeSurface<P, S> {
    type Pixel = P;

    fn shape(&self) -> Shape {
        Shape { channels: 2, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn begin(&mut self, window: Window, _: &mut [P]) {
        self.stamps.begin(window);
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [P]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        self.stamps.accumulate(span.events, Places::by_polarity(self.geometry));
        Ok(())
    }

    fn finish(&mut self, out: &mut [P]) {
        let (tau_us, decay, (now, map)) = (self.tau_us, self.decay, self.stamps.ages());
        in_order(
            #[inline(always)]
            || match decay {
                Decay::Exponential => exponential(now, tau_us, map, out),
                Decay::Linear => linear(now, tau_us, map, out),
            },
        );
    }

    fn overlap(&self) -> Overlap {
        Overlap::Memory
    }
}

/// exp(-age / tau) of each time in the map.
#[inline(always)]
fn exponential<P: Real>(now: u32, tau_us: u32, map: &[u32], out: &mut [P]) {
    let rate = -1.0 / tau_us as f32;
    let age_end = (tau_us * DECAYS_MAX) as i32;
    for (pixel, last) in out.iter_mut().zip(map) {
        let age = now.wrapping_sub(*last) as i32;
        let value = exp(age as f32 * rate);
        *pixel = P::from_share(if age < age_end { value } else { 0.0 });
    }
}

/// 1 - age / tau of each time in the map, 0 at least.
#[inline(always)]
fn linear<P: Real>(now: u32, tau_us: u32, map: &[u32], out: &mut [P]) {
    let rate = 1.0 / tau_us as f32;
    for (pixel, last) in out.iter_mut().zip(map) {
        let left = (tau_us as i32).wrapping_sub(now.wrapping_sub(*last) as i32).max(0);
        *pixel = P::from_share(left as f32 * rate);
    }
}

impl<P: Real, S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for TimeSurface<P, S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Ok(Self::try_new(geometry, parameters.tau_us, state)?.with_decay(parameters.decay))
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
        surface.stamps = Stamps::at(1 << 23, map.clone());
        let mut wide = vec![0.0; map.len()];
        surface.finish(&mut wide);
        let mut plain = vec![0.0f32; map.len()];
        exponential(1 << 23, 300_000, &map, &mut plain);
        let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&wide), bits(&plain));
        assert!(wide.iter().filter(|value| **value > 0.0).count() > map.len() / 2);
    }
}
