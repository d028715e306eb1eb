//! The newest event of each pixel in ever shorter parts of the window, so that both slow and fast edges are sharp in
//! one of them.
//!
//! Source: Nam et al., Stereo Depth from Events Cameras: Concentrate and Focus on the Future, CVPR 2022, section 3.1,
//! with half the time in place of half the number of events, which no stream knows before its window ends.

use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::{BadRepresentation, Build, Parameters, check};
use crate::vector::widest;
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Mixed-density event stack (MDES): bins x H x W of f32, -1, 0 or 1.
///
/// Plane `i` holds the sign (ON +) of the last event in stream order of each pixel in the last `1 / 2^i` of the window,
/// `[t1 - (t1 - t0) / 2^i, t1)`; 0 where there is none. Plane 0 is the whole window.
///
/// ```
/// use lobula_core::representation::MixedDensityStack;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [Event::new(30, 0, 0, Polarity::On), Event::new(80, 1, 0, Polarity::Off)];
/// let mut out = [f32::NAN; 6]; // whatever was there
/// let mut stack = MixedDensityStack::try_new(geometry, 3)?;
/// stack.begin(Window { t0: 0, t1: 100 }, &mut out);
/// stack.accumulate(Span { t_first: 30, t_last: 80, geometry, events: &events }, &mut out)?;
/// stack.finish(&mut out);
/// assert_eq!(out, [1.0, -1.0, 0.0, -1.0, 0.0, -1.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct MixedDensityStack {
    geometry: Geometry,
    bins: u16,
    halves: Halves,
}

impl MixedDensityStack {
    /// For a sensor of this size; 1 to 31 bins, and no more than 2^32 elements in all.
    pub const fn try_new(geometry: Geometry, bins: u16) -> Result<Self, BadRepresentation> {
        if bins > 31 {
            let range = "1 to 31 for a mixed-density stack";
            return Err(BadRepresentation::Parameter { key: "bins", found: bins as u64, range });
        }
        if bins == 0 || geometry.pixels() as u64 * bins as u64 > 1 << 32 {
            return Err(BadRepresentation::Bins { found: bins });
        }
        Ok(Self { geometry, bins, halves: Halves { t1: 0, length: 1, last: 0 } })
    }
}

/// Parts of a window that end with it, each half as long as the one before.
#[derive(Clone, Copy, Debug)]
struct Halves {
    t1: u32,
    length: u32,
    /// The number of the shortest.
    last: u32,
}

impl Halves {
    fn new(window: Window, bins: u16) -> Self {
        let length = window.t1.saturating_sub(window.t0).clamp(1, i32::MAX as u64) as u32;
        Self { t1: window.t1 as u32, length, last: u32::from(bins).saturating_sub(1) }
    }

    /// The number of the shortest part that an event lies in.
    #[inline(always)]
    fn of(&self, event: Event) -> u32 {
        let before = (self.t1.wrapping_sub(event.t()) as i32).max(1).min(self.length as i32) as u32;
        let halvings = before.leading_zeros().wrapping_sub(self.length.leading_zeros());
        let beyond = before.wrapping_shl(halvings) > self.length;
        halvings.wrapping_sub(u32::from(beyond)).min(self.last)
    }
}

impl Representation for MixedDensityStack {
    type Pixel = f32;

    fn shape(&self) -> Shape {
        Shape {
            channels: self.bins.into(),
            height: self.geometry.height.into(),
            width: self.geometry.width.into(),
        }
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [f32]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let mut stacking = Stacking { halves: self.halves, pixels: self.geometry.pixels() };
        widest(
            #[inline(always)]
            || draw_each(span.events, Places::by_pixel(self.geometry), out, &mut stacking),
        );
        Ok(())
    }

    fn finish(&mut self, _: &mut [f32]) {}

    fn is_sparse(&self) -> bool {
        true
    }

    fn begin_blank(&mut self, window: Window) {
        self.halves = Halves::new(window, self.bins);
    }

    fn planes(&self, events: &[Event]) -> u16 {
        let last = events.iter().fold(0, |last, event| self.halves.of(*event).max(last));
        if last < 16 { ((2u32 << last) - 1) as u16 } else { u16::MAX }
    }
}

/// Writes each event's sign to all the parts it lies in.
struct Stacking {
    halves: Halves,
    pixels: usize,
}

impl Draw for Stacking {
    type Pixel = f32;
    type Value = (u32, f32);

    #[inline(always)]
    fn prepare(&self, event: Event, _: &mut u32) -> (u32, f32) {
        let off = !event.on_mask() & (1 << 31);
        (self.halves.of(event), f32::from_bits(1.0f32.to_bits() | off))
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [f32], at: usize, (last, sign): (u32, f32)) {
        for plane in 0..=last as usize {
            if let Some(cell) = out.get_mut(plane * self.pixels + at) {
                *cell = sign;
            }
        }
    }
}

impl<S> Build<S> for MixedDensityStack {
    fn state_len(_: &Parameters, _: Geometry) -> usize {
        0
    }

    fn build(parameters: &Parameters, geometry: Geometry, _: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.bins)
    }
}
