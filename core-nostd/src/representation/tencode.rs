//! The last event of each pixel as a colour: its polarity in red or blue, its age in green.
//!
//! Source: Huang et al., Eventpoint: Self-Supervised Interest Point Detection and Description for Event-based Camera,
//! WACV 2023 (Tencode), as `tencode` of eventcv 1.0.8 has it.

use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::{BadRepresentation, Build, Parameters, check};
use crate::vector::{in_order, widest};
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Polarity and age of each pixel's last event in the window: 3 x H x W (ON, age, OFF) of u8.
///
/// The plane of its polarity is 255 and the other's 0; the age is `255 age / (t1 - t0)` from the window's end, rounded to
/// the nearest (halves up). All three are 0 without an event. The last event is the last in stream order; one older than
/// the window counts at its start. The colours are kept in memory of the caller's, 2 bytes a pixel
/// ([`state_len`](Self::state_len) elements): an event touches one place, not three.
///
/// ```
/// use lobula_core::representation::Tencode;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [Event::new(10, 1, 0, Polarity::Off), Event::new(80, 1, 0, Polarity::On)];
/// let mut out = [0xFF; 6]; // whatever was there
/// let mut tencode = Tencode::try_new(geometry, [0; 1])?;
/// tencode.begin(Window { t0: 0, t1: 100 }, &mut out);
/// tencode.accumulate(Span { t_first: 10, t_last: 80, geometry, events: &events }, &mut out)?;
/// tencode.finish(&mut out);
/// assert_eq!(out, [0, 255, 0, 51, 0, 0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Tencode<S> {
    geometry: Geometry,
    window: Window,
    state: S,
}

/// Adding it rounds a small number to a whole one, which is then in the low bits of the sum.
const ROUND: f64 = 4_503_599_627_370_496.0; // 2^52

/// Of a pixel's colour, which is its age in the low byte: whether ON, whether OFF.
const ON: u16 = 0x100;
const OFF: u16 = 0x200;

impl<S: AsRef<[u32]> + AsMut<[u32]>> Tencode<S> {
    /// Elements of the state.
    pub const fn state_len(geometry: Geometry) -> usize {
        geometry.pixels().div_ceil(2)
    }

    /// For a sensor of this size, and state of [`state_len`](Self::state_len) elements, whatever they hold.
    pub fn try_new(geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        let (expected, found) = (Self::state_len(geometry), state.as_ref().len());
        if expected != found {
            return Err(BadRepresentation::StateLen { expected, found });
        }
        Ok(Self { geometry, window: Window { t0: 0, t1: 0 }, state })
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for Tencode<S> {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        Shape { channels: 3, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn begin(&mut self, window: Window, _: &mut [u8]) {
        self.window = window;
        self.state.as_mut().fill(0);
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [u8]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let places = Places::by_pixel(self.geometry);
        let mut colouring = Colouring::new(self.window);
        let colours: &mut [u16] = bytemuck::cast_slice_mut(self.state.as_mut());
        widest(
            #[inline(always)]
            || draw_each(span.events, places, colours, &mut colouring),
        );
        Ok(())
    }

    fn finish(&mut self, out: &mut [u8]) {
        let pixels = self.geometry.pixels();
        let colours: &[u16] = bytemuck::cast_slice(self.state.as_ref());
        let colours = colours.get(..pixels).unwrap_or_default();
        let (on, rest) = out.split_at_mut(pixels.min(out.len()));
        let (age, off) = rest.split_at_mut(pixels.min(rest.len()));
        in_order(
            #[inline(always)]
            || {
                on.iter_mut().zip(colours).for_each(|(out, colour)| *out = full(colour & ON));
                age.iter_mut().zip(colours).for_each(|(out, colour)| *out = *colour as u8);
                off.iter_mut().zip(colours).for_each(|(out, colour)| *out = full(colour & OFF));
            },
        );
    }
}

#[inline(always)]
fn full(bit: u16) -> u8 {
    if bit == 0 { 0 } else { u8::MAX }
}

/// Gives the pixel of each event its colour.
struct Colouring {
    t1: u32,
    length: i32,
    per_us: f64,
    nudge: f64,
}

impl Colouring {
    fn new(window: Window) -> Self {
        let length = window.t1.saturating_sub(window.t0).min(i32::MAX as u64) as i32;
        let lengths = f64::from(length.max(1));
        // Values lie 1 / length apart: a quarter of that leads every half up, and what this product is off nowhere.
        Self { t1: window.t1 as u32, length, per_us: 255.0 / lengths, nudge: 0.25 / lengths }
    }
}

impl Draw for Colouring {
    type Pixel = u16;
    type Value = u16;

    #[inline(always)]
    fn prepare(&self, event: Event, _: &mut u32) -> u16 {
        let age = (self.t1.wrapping_sub(event.t()) as i32).max(0).min(self.length);
        // Rounded into the lowest bits, which is quicker than a conversion.
        let share = (f64::from(age) * self.per_us + self.nudge + ROUND).to_bits() as u16;
        share | (event.on_mask() as u16 & (ON ^ OFF)) ^ OFF
    }

    #[inline(always)]
    fn draw(&mut self, colours: &mut [u16], at: usize, colour: u16) {
        if let Some(cell) = colours.get_mut(at) {
            *cell = colour;
        }
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for Tencode<S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(_: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, state)
    }
}
