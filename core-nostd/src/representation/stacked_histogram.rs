//! How many events each pixel had in each part of the window, as recurrent detectors take them.
//!
//! Source: Gehrig and Scaramuzza, Recurrent Vision Transformers for Object Detection with Event Cameras, CVPR 2023,
//! section 3.1, with the window's bounds in place of the first and last event's times.

use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::{BadRepresentation, Build, Parameters, check};
use crate::vector::widest;
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Number of events by polarity and part of the window: 2 bins x H x W of u8, all bins of OFF first, then all of ON, as
/// in the authors' code.
///
/// An event's bin is `floor((t - t0) / (t1 - t0) * bins)`, at most the last. A pixel that reaches `cutoff` (1 to 255,
/// default 10) stays there; the events it did not count are in [`saturated`](Build::saturated).
///
/// ```
/// use lobula_core::representation::StackedHistogram;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(1, 1);
/// let events = [10, 40, 60].map(|t| Event::new(t, 0, 0, Polarity::from_bit(u16::from(t > 20))));
/// let mut out = [0xFF; 4]; // whatever was there
/// let mut stacked = StackedHistogram::try_new(geometry, 2, 10)?;
/// stacked.begin(Window { t0: 0, t1: 100 }, &mut out);
/// stacked.accumulate(Span { t_first: 10, t_last: 60, geometry, events: &events }, &mut out)?;
/// stacked.finish(&mut out);
/// assert_eq!(out, [1, 0, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct StackedHistogram {
    geometry: Geometry,
    bins: u16,
    cutoff: u8,
    parts: Parts,
    saturated: u64,
}

impl StackedHistogram {
    /// For a sensor of this size; at least 1 bin, no more than 2^32 elements in all, and a cutoff from 1 on.
    pub const fn try_new(geometry: Geometry, bins: u16, cutoff: u8) -> Result<Self, BadRepresentation> {
        if bins == 0 || geometry.pixels() as u64 * 2 * bins as u64 > 1 << 32 {
            return Err(BadRepresentation::Bins { found: bins });
        }
        if cutoff == 0 {
            return Err(BadRepresentation::Parameter { key: "cutoff", found: 0, range: "1 to 255" });
        }
        let parts = Parts { t0: 0, length: 1, bins: 1.0 };
        Ok(Self { geometry, bins, cutoff, parts, saturated: 0 })
    }
}

/// Equal parts of a window.
#[derive(Clone, Copy, Debug)]
struct Parts {
    t0: u32,
    length: i32,
    bins: f64,
}

impl Parts {
    fn new(window: Window, bins: u16) -> Self {
        let length = window.t1.saturating_sub(window.t0).clamp(1, i32::MAX as u64) as i32;
        Self { t0: window.t0 as u32, length, bins: bins.into() }
    }

    /// The part that an event lies in. Exact: a quotient of whole numbers this small never rounds up to a whole one.
    #[inline(always)]
    fn of(&self, event: Event) -> u32 {
        let age = (event.t().wrapping_sub(self.t0) as i32).max(0).min(self.length.wrapping_sub(1));
        (f64::from(age) * self.bins / f64::from(self.length)) as i32 as u32
    }
}

impl Representation for StackedHistogram {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        Shape {
            channels: 2 * usize::from(self.bins),
            height: self.geometry.height.into(),
            width: self.geometry.width.into(),
        }
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [u8]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let pixels = self.geometry.pixels() as u32;
        let on = pixels.wrapping_mul(self.bins.into());
        let mut stacking = Stacking { parts: self.parts, pixels, on, cutoff: self.cutoff, saturated: 0 };
        widest(
            #[inline(always)]
            || draw_each(span.events, Places::by_pixel(self.geometry), out, &mut stacking),
        );
        self.saturated += stacking.saturated;
        Ok(())
    }

    fn finish(&mut self, _: &mut [u8]) {}

    fn is_sparse(&self) -> bool {
        true
    }

    fn begin_blank(&mut self, window: Window) {
        self.parts = Parts::new(window, self.bins);
    }

    fn planes(&self, events: &[Event]) -> u16 {
        let parts = events.iter().map(|event| self.parts.of(*event));
        let (first, last) =
            parts.fold((u32::MAX, 0), |(first, last), part| (part.min(first), part.max(last)));
        let bit = |plane: u32| 1u16.rotate_left(plane % 16);
        let both = |part: u32| bit(part) | bit(part.wrapping_add(self.bins.into()));
        (first..=last).take(16).fold(0, |bits, part| bits | both(part))
    }
}

/// Counts events in the part of each.
struct Stacking {
    parts: Parts,
    pixels: u32,
    /// Where the planes of ON events begin.
    on: u32,
    cutoff: u8,
    saturated: u64,
}

impl Draw for Stacking {
    type Pixel = u8;
    type Value = ();

    #[inline(always)]
    fn prepare(&self, event: Event, at: &mut u32) {
        let plane = self.parts.of(event).wrapping_mul(self.pixels);
        *at = at.wrapping_add(plane).wrapping_add(self.on & event.on_mask());
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [u8], at: usize, (): ()) {
        if let Some(cell) = out.get_mut(at) {
            let more = u8::from(*cell < self.cutoff);
            *cell = cell.wrapping_add(more);
            self.saturated += u64::from(1 - more);
        }
    }
}

impl<S> Build<S> for StackedHistogram {
    fn state_len(_: &Parameters, _: Geometry) -> usize {
        0
    }

    fn build(parameters: &Parameters, geometry: Geometry, _: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.bins, parameters.cutoff)
    }

    fn saturated(&self) -> u64 {
        self.saturated
    }
}
