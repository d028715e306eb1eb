//! How recent each pixel's events were on average.
//!
//! Source: `atsurf` of eventcv 1.0.8; the averaging of Sironi et al., HATS: Histograms of Averaged Time Surfaces, CVPR
//! 2018, without its cells and neighbourhoods, and from the window's end.

use crate::math::exp;
use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::time_surface::{DECAYS_MAX, TAU_US_MAX};
use crate::representation::{BadRepresentation, Build, Parameters, check};
use crate::vector::{in_order, widest};
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// The mean of exp(-age / tau) over the window's events of each pixel and polarity: 2 x H x W (ON, OFF) of f32.
///
/// The age is counted from the window's end, from 0 to 32 tau; a pixel without events is 0. Sums and numbers are kept in
/// memory of the caller's ([`state_len`](Self::state_len) elements); a mean is exact to single precision up to 2^24
/// events a pixel.
///
/// ```
/// use lobula_core::representation::AveragedTimeSurface;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(1, 1);
/// let events = [Event::new(900, 0, 0, Polarity::On), Event::new(1_000, 0, 0, Polarity::On)];
/// let mut out = [f32::NAN; 2]; // whatever was there
/// let mut surface = AveragedTimeSurface::try_new(geometry, 100, [0; 4])?;
/// surface.begin(Window { t0: 0, t1: 1_000 }, &mut out);
/// surface.accumulate(Span { t_first: 900, t_last: 1_000, geometry, events: &events }, &mut out)?;
/// surface.finish(&mut out);
/// assert_eq!(out, [(lobula_core::math::exp(-1.0) + 1.0) / 2.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct AveragedTimeSurface<S> {
    geometry: Geometry,
    tau_us: u32,
    window: Window,
    /// Whether the state holds anything.
    counted: bool,
    state: S,
}

/// A sum, as bits of an f32, and of how many.
type Mean = [u32; 2];

impl<S: AsRef<[u32]> + AsMut<[u32]>> AveragedTimeSurface<S> {
    /// Elements of the state.
    pub const fn state_len(geometry: Geometry) -> usize {
        4 * geometry.pixels()
    }

    /// For a sensor of this size, a decay of 1 to 2^25 µs and state of [`state_len`](Self::state_len) elements, whatever
    /// they hold.
    pub fn try_new(geometry: Geometry, tau_us: u32, state: S) -> Result<Self, BadRepresentation> {
        if tau_us == 0 || tau_us > TAU_US_MAX {
            return Err(BadRepresentation::TauUs { found: tau_us });
        }
        let (expected, found) = (Self::state_len(geometry), state.as_ref().len());
        if expected != found {
            return Err(BadRepresentation::StateLen { expected, found });
        }
        Ok(Self { geometry, tau_us, window: Window { t0: 0, t1: 0 }, counted: true, state })
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for AveragedTimeSurface<S> {
    type Pixel = f32;

    fn shape(&self) -> Shape {
        Shape { channels: 2, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn begin(&mut self, window: Window, _: &mut [f32]) {
        self.window = window;
        if self.counted {
            self.state.as_mut().fill(0);
            self.counted = false;
        }
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [f32]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        self.counted = true;
        let places = Places::by_polarity(self.geometry);
        let mut averaging = Averaging::new(self.window, self.tau_us);
        let means = self.state.as_mut().as_chunks_mut().0;
        widest(
            #[inline(always)]
            || draw_each(span.events, places, means, &mut averaging),
        );
        Ok(())
    }

    /// Forgets the means as it reads them: that they are in the cache once is enough.
    fn finish(&mut self, out: &mut [f32]) {
        let means = self.state.as_mut().as_chunks_mut::<2>().0;
        self.counted = out.len() < means.len();
        in_order(
            #[inline(always)]
            || {
                for (out, mean) in out.iter_mut().zip(means) {
                    let [sum, count] = core::mem::take(mean);
                    *out = f32::from_bits(sum) / (count as i32).max(1) as f32;
                }
            },
        );
    }
}

/// Adds what each event's age is worth.
struct Averaging {
    t1: u32,
    rate: f32,
    age_max: i32,
}

impl Averaging {
    fn new(window: Window, tau_us: u32) -> Self {
        let length = window.t1.saturating_sub(window.t0).min((tau_us * DECAYS_MAX).into());
        Self { t1: window.t1 as u32, rate: -1.0 / tau_us as f32, age_max: length as i32 }
    }
}

impl Draw for Averaging {
    type Pixel = Mean;
    type Value = f32;

    #[inline(always)]
    fn prepare(&self, event: Event, _: &mut u32) -> f32 {
        let age = (self.t1.wrapping_sub(event.t()) as i32).max(0).min(self.age_max);
        exp(age as f32 * self.rate)
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [Mean], at: usize, value: f32) {
        if let Some([sum, count]) = out.get_mut(at) {
            *sum = (f32::from_bits(*sum) + value).to_bits();
            *count = count.wrapping_add(1);
        }
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for AveragedTimeSurface<S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.tau_us, state)
    }
}
