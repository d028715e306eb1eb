//! The last event of each pixel as a colour: its polarity in red or blue, its age in green.
//!
//! Source: Huang et al., Eventpoint: Self-Supervised Interest Point Detection and Description for Event-based Camera,
//! WACV 2023 (Tencode), as `tencode` of eventcv 1.0.8 has it.

use crate::prefetch::prefetch;
use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::{BadRepresentation, Build, Parameters, check};
use crate::vector::widest;
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Polarity and age of each pixel's last event in the window: 3 x H x W (ON, age, OFF) of u8.
///
/// The plane of its polarity is 255 and the other's 0; the age is `255 age / (t1 - t0)` from the window's end, rounded to
/// the nearest (halves up). All three are 0 without an event. The last event is the last in stream order; one older than
/// the window counts at its start.
///
/// ```
/// use lobula_core::representation::Tencode;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [Event::new(10, 1, 0, Polarity::Off), Event::new(80, 1, 0, Polarity::On)];
/// let mut out = [0xFF; 6]; // whatever was there
/// let mut tencode = Tencode::new(geometry);
/// tencode.begin(Window { t0: 0, t1: 100 }, &mut out);
/// tencode.accumulate(Span { t_first: 10, t_last: 80, geometry, events: &events }, &mut out)?;
/// tencode.finish(&mut out);
/// assert_eq!(out, [0, 255, 0, 51, 0, 0]);
/// # Ok::<(), lobula_core::WrongGeometry>(())
/// ```
#[derive(Clone, Debug)]
pub struct Tencode {
    geometry: Geometry,
    window: Window,
}

impl Tencode {
    /// For a sensor of this size.
    pub const fn new(geometry: Geometry) -> Self {
        Self { geometry, window: Window { t0: 0, t1: 0 } }
    }
}

impl Representation for Tencode {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        Shape { channels: 3, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn begin(&mut self, window: Window, out: &mut [u8]) {
        self.window = window;
        out.fill(0);
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [u8]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let places = Places::by_pixel(self.geometry);
        let mut colouring = Colouring::new(self.window, self.geometry.pixels());
        widest(
            #[inline(always)]
            || draw_each(span.events, places, out, &mut colouring),
        );
        Ok(())
    }

    fn finish(&mut self, _: &mut [u8]) {}
}

/// Gives the pixel of each event its colour.
struct Colouring {
    t1: u32,
    length: i32,
    per_us: f64,
    half: f64,
    pixels: usize,
}

impl Colouring {
    fn new(window: Window, pixels: usize) -> Self {
        let length = window.t1.saturating_sub(window.t0).min(i32::MAX as u64) as i32;
        let lengths = f64::from(length.max(1));
        // In whole numbers, (510 age + length) / (2 length) without its rest. What is added to the one half keeps the
        // rounding of this product far from any whole number.
        Self { t1: window.t1 as u32, length, per_us: 255.0 / lengths, half: 0.5 + 0.25 / lengths, pixels }
    }
}

impl Draw for Colouring {
    type Pixel = u8;
    type Value = [u8; 2];

    #[inline(always)]
    fn prepare(&self, event: Event, _: &mut u32) -> [u8; 2] {
        let age = (self.t1.wrapping_sub(event.t()) as i32).max(0).min(self.length);
        let share = (f64::from(age) * self.per_us + self.half) as i32;
        [event.on_mask() as u8, share as u8]
    }

    #[inline(always)]
    fn look_ahead(&self, out: &[u8], at: usize) {
        (0..3).for_each(|plane| prefetch(out, at + plane * self.pixels));
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [u8], at: usize, [on, share]: [u8; 2]) {
        for (plane, value) in [on, share, !on].into_iter().enumerate() {
            if let Some(cell) = out.get_mut(at + plane * self.pixels) {
                *cell = value;
            }
        }
    }
}

impl<S> Build<S> for Tencode {
    fn state_len(_: &Parameters, _: Geometry) -> usize {
        0
    }

    fn build(_: &Parameters, geometry: Geometry, _: S) -> Result<Self, BadRepresentation> {
        Ok(Self::new(geometry))
    }
}
