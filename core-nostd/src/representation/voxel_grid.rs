//! Events in space and time: bins of a window, each event shared between the two nearest.
//!
//! Source: Zhu et al., Unsupervised Event-based Learning of Optical Flow, Depth, and Egomotion, CVPR 2019, section 3.1,
//! with the window's bounds in place of the first and last event's times.

use crate::prefetch::prefetch;
use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::{BadRepresentation, Build, Parameters, check};
use crate::vector::widest;
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Adding it rounds a small number to a whole one, which is then in the low bits of the sum.
const ROUND: f32 = 8_388_608.0; // 2^23

const SIGN_BIT: u32 = 1 << 31;

/// Signed events in bins of time: bins x H x W of f32.
///
/// An event of sign ±1 (ON +) at position `(t - t0) / (t1 - t0) * (bins - 1)` adds to the two bins around it, to each
/// the more the nearer it is. One bin holds the plain sum of signs. No normalisation.
///
/// With a window that ends at the newest event's time this is the voxel grid of libraries that count ages from there.
///
/// ```
/// use lobula_core::representation::VoxelGrid;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(1, 1);
/// let events = [Event::new(25, 0, 0, Polarity::On), Event::new(75, 0, 0, Polarity::Off)];
/// let mut out = [f32::NAN; 3]; // whatever was there
/// let mut voxel = VoxelGrid::try_new(geometry, 3)?;
/// voxel.begin(Window { t0: 0, t1: 100 }, &mut out);
/// voxel.accumulate(Span { t_first: 25, t_last: 75, geometry, events: &events }, &mut out)?;
/// voxel.finish(&mut out);
/// assert_eq!(out, [0.5, 0.0, -0.5]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct VoxelGrid {
    geometry: Geometry,
    bins: u16,
    clock: Clock,
}

impl VoxelGrid {
    /// For a sensor of this size; at least 1 bin, and no more than 2^32 elements in all.
    pub const fn try_new(geometry: Geometry, bins: u16) -> Result<Self, BadRepresentation> {
        let len = geometry.pixels() as u64 * bins as u64;
        if bins == 0 || len > 1 << 32 {
            return Err(BadRepresentation::Bins { found: bins });
        }
        Ok(Self { geometry, bins, clock: Clock { t0: 0, length: 0, bins_per_us: 0.0 } })
    }
}

/// Turns times into positions on the axis of bins.
#[derive(Clone, Copy, Debug)]
struct Clock {
    t0: u32,
    length: i32,
    bins_per_us: f32,
}

impl Clock {
    fn new(window: Window, bins: u16) -> Self {
        let length = window.t1.saturating_sub(window.t0).min(i32::MAX as u64) as i32;
        let intervals = bins.saturating_sub(1) as f32;
        Self { t0: window.t0 as u32, length, bins_per_us: intervals / length.max(1) as f32 }
    }

    /// The bin at or before the event and the share of the one after it.
    #[inline(always)]
    fn bin(&self, event: Event) -> (u32, f32) {
        let age = (event.t().wrapping_sub(self.t0) as i32).max(0).min(self.length);
        let position = age as f32 * self.bins_per_us;
        // The whole number nearest to half below; at a tie either will do, since one of the two shares is 0 then.
        let rounded = (position - 0.5).max(0.0) + ROUND;
        let bin = rounded.to_bits() & 0xFFFF;
        (bin, position - (rounded - ROUND))
    }
}

impl Representation for VoxelGrid {
    type Pixel = f32;

    fn shape(&self) -> Shape {
        Shape {
            channels: self.bins.into(),
            height: self.geometry.height.into(),
            width: self.geometry.width.into(),
        }
    }

    fn begin(&mut self, window: Window, out: &mut [f32]) {
        self.clock = Clock::new(window, self.bins);
        out.fill(0.0);
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [f32]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let (geometry, clock) = (self.geometry, self.clock);
        widest(
            #[inline(always)]
            || add(geometry, clock, span.events, out),
        );
        Ok(())
    }

    fn finish(&mut self, _: &mut [f32]) {}
}

/// Adds events to the two bins around each.
#[inline(always)]
fn add(geometry: Geometry, clock: Clock, events: &[Event], out: &mut [f32]) {
    draw_each(events, Places::by_pixel(geometry), out, &mut Sharing { clock, pixels: geometry.pixels() });
}

/// Shares each event between two bins.
struct Sharing {
    clock: Clock,
    pixels: usize,
}

impl Draw for Sharing {
    type Pixel = f32;
    type Value = [f32; 2];

    #[inline(always)]
    fn prepare(&self, event: Event, at: &mut u32) -> [f32; 2] {
        let (bin, share) = self.clock.bin(event);
        *at = at.wrapping_add(bin.wrapping_mul(self.pixels as u32));
        let off = !event.on_mask() & SIGN_BIT;
        [1.0 - share, share].map(|weight| f32::from_bits(weight.to_bits() ^ off))
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
        if let Some(cell) = out.get_mut(at + self.pixels) {
            *cell += high;
        }
    }
}

impl<S> Build<S> for VoxelGrid {
    fn state_len(_: &Parameters, _: Geometry) -> usize {
        0
    }

    fn build(parameters: &Parameters, geometry: Geometry, _: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.bins)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polarity;

    #[test]
    fn wider_vectors_give_the_same_bits() {
        let geometry = Geometry::new(7, 3);
        let events: Vec<Event> = (0..1_000u32)
            .map(|i| {
                Event::new(i * 13 % 1_003, (i % 7) as u16, (i % 3) as u16, Polarity::from_bit(i as u16 / 5))
            })
            .collect();
        let window = Window { t0: 100, t1: 1_000 };
        let mut stage = VoxelGrid::try_new(geometry, 9).unwrap();
        let mut wide = vec![0.0; stage.shape().len()];
        stage.begin(window, &mut wide);
        stage.accumulate(Span { t_first: 0, t_last: 0, geometry, events: &events }, &mut wide).unwrap();
        let mut plain = vec![0.0f32; wide.len()];
        add(geometry, Clock::new(window, 9), &events, &mut plain);
        let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&wide), bits(&plain));
    }
}
