//! When events came, in space and time: each weighs as much as it is late in the window.
//!
//! Source: Gehrig et al., End-to-End Learning of Representations for Asynchronous Event-Based Data, ICCV 2019, section 3,
//! with the normalised time as measurement and the trilinear kernel. The learned kernel of the paper is a network's and
//! not here. The window's bounds stand in place of the first and last event's times.

use crate::prefetch::prefetch;
use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::{BadRepresentation, Build, Parameters, check};
use crate::vector::widest;
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Adding it rounds a small number to a whole one, which is then in the low bits of the sum.
const ROUND: f32 = 8_388_608.0; // 2^23

/// Event spike tensor (EST): 2 bins x H x W of f32, all bins of OFF first, then all of ON, as in the authors' code.
///
/// An event at `s = (t - t0) / (t1 - t0)` adds `s * max(0, 1 - |s (bins - 1) - b|)` to bin `b` of its polarity: its time,
/// shared between the two bins around it. One bin holds the sum of times.
///
/// ```
/// use lobula_core::representation::EventSpikeTensor;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(1, 1);
/// let events = [Event::new(50, 0, 0, Polarity::Off), Event::new(75, 0, 0, Polarity::On)];
/// let mut out = [f32::NAN; 6]; // whatever was there
/// let mut tensor = EventSpikeTensor::try_new(geometry, 3)?;
/// tensor.begin(Window { t0: 0, t1: 100 }, &mut out);
/// tensor.accumulate(Span { t_first: 50, t_last: 75, geometry, events: &events }, &mut out)?;
/// tensor.finish(&mut out);
/// assert_eq!(out, [0.0, 0.5, 0.0, 0.0, 0.375, 0.375]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct EventSpikeTensor {
    geometry: Geometry,
    bins: u16,
    clock: Clock,
}

impl EventSpikeTensor {
    /// For a sensor of this size; at least 1 bin, and no more than 2^32 elements in all.
    pub const fn try_new(geometry: Geometry, bins: u16) -> Result<Self, BadRepresentation> {
        if bins == 0 || geometry.pixels() as u64 * 2 * bins as u64 > 1 << 32 {
            return Err(BadRepresentation::Bins { found: bins });
        }
        Ok(Self { geometry, bins, clock: Clock { t0: 0, length: 0, windows_per_us: 0.0, last: 0.0 } })
    }
}

/// Turns times into shares of the window and positions on the axis of bins.
#[derive(Clone, Copy, Debug)]
struct Clock {
    t0: u32,
    length: i32,
    windows_per_us: f32,
    last: f32,
}

impl Clock {
    fn new(window: Window, bins: u16) -> Self {
        let length = window.t1.saturating_sub(window.t0).min(i32::MAX as u64) as i32;
        let last = bins.saturating_sub(1) as f32;
        Self { t0: window.t0 as u32, length, windows_per_us: 1.0 / length.max(1) as f32, last }
    }

    /// The event's time as a share of the window, the bin at or before it, and the share of the one after.
    #[inline(always)]
    fn place(&self, event: Event) -> (f32, u32, f32) {
        let age = (event.t().wrapping_sub(self.t0) as i32).max(0).min(self.length);
        let time = age as f32 * self.windows_per_us;
        let position = (time * self.last).min(self.last);
        // The whole number nearest to half below; at a tie either will do, since one of the two shares is 0 then.
        let rounded = (position - 0.5).max(0.0) + ROUND;
        (time, rounded.to_bits() & 0xFFFF, position - (rounded - ROUND))
    }
}

impl Representation for EventSpikeTensor {
    type Pixel = f32;

    fn shape(&self) -> Shape {
        Shape {
            channels: 2 * usize::from(self.bins),
            height: self.geometry.height.into(),
            width: self.geometry.width.into(),
        }
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [f32]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let pixels = self.geometry.pixels();
        let on = (pixels as u32).wrapping_mul(self.bins.into());
        let mut sharing = Sharing { clock: self.clock, pixels, on };
        widest(
            #[inline(always)]
            || draw_each(span.events, Places::by_pixel(self.geometry), out, &mut sharing),
        );
        Ok(())
    }

    fn finish(&mut self, _: &mut [f32]) {}

    fn is_sparse(&self) -> bool {
        true
    }

    fn begin_blank(&mut self, window: Window) {
        self.clock = Clock::new(window, self.bins);
    }

    fn planes(&self, events: &[Event]) -> u16 {
        let bins = events.iter().map(|event| self.clock.place(*event).1);
        let (first, last) = bins.fold((u32::MAX, 0), |(first, last), bin| (bin.min(first), bin.max(last)));
        let bit = |plane: u32| 1u16.rotate_left(plane % 16);
        let both = |bin: u32| bit(bin) | bit(bin.wrapping_add(self.bins.into()));
        (first..=last.wrapping_add(1)).take(16).fold(0, |bits, bin| bits | both(bin))
    }
}

/// Shares each event between two bins.
struct Sharing {
    clock: Clock,
    pixels: usize,
    /// Where the bins of ON events begin.
    on: u32,
}

impl Draw for Sharing {
    type Pixel = f32;
    type Value = [f32; 2];

    #[inline(always)]
    fn prepare(&self, event: Event, at: &mut u32) -> [f32; 2] {
        let (time, bin, share) = self.clock.place(event);
        let plane = bin.wrapping_mul(self.pixels as u32);
        *at = at.wrapping_add(plane).wrapping_add(self.on & event.on_mask());
        [time * (1.0 - share), time * share]
    }

    #[inline(always)]
    fn look_ahead(&self, out: &[f32], at: usize) {
        prefetch(out, at);
        prefetch(out, at + self.pixels);
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [f32], at: usize, [low, high]: [f32; 2]) {
        if let Some(cell) = out.get_mut(at) {
            *cell += low;
        }
        // Nothing for the last bin's next: it would be the other polarity's first.
        if let Some(cell) = out.get_mut(at + self.pixels) {
            *cell += high;
        }
    }
}

impl<S> Build<S> for EventSpikeTensor {
    fn state_len(_: &Parameters, _: Geometry) -> usize {
        0
    }

    fn build(parameters: &Parameters, geometry: Geometry, _: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.bins)
    }
}
