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

/// Which planes the polarities of a [`VoxelGrid`] go to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Polarities {
    /// The same: ON adds and OFF subtracts.
    #[default]
    Signed,
    /// Their own, where both add: all bins of ON, then all of OFF.
    Apart,
}

/// Which bins an event of a [`VoxelGrid`] adds to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Interpolation {
    /// The two around it in time, to each the more the nearer it is.
    #[default]
    Linear,
    /// The nearest in time; at a tie, the even one.
    Nearest,
}

/// Events in bins of time: bins x H x W of f32, or twice as many bins with [`Polarities::Apart`].
///
/// An event of sign ±1 (ON +) at position `(t - t0) / (t1 - t0) * (bins - 1)` adds to the two bins around it, to each
/// the more the nearer it is; with [`Interpolation::Nearest`], all of it to the nearer. One bin holds the plain sum.
/// No normalisation ([`SliceVoxelGrid`](crate::representation::SliceVoxelGrid) has it).
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
    polarities: Polarities,
    interpolation: Interpolation,
    clock: Clock,
}

impl VoxelGrid {
    /// For a sensor of this size, signed and linear; at least 1 bin, and no more than 2^32 elements in all.
    pub const fn try_new(geometry: Geometry, bins: u16) -> Result<Self, BadRepresentation> {
        Self::try_with(geometry, bins, Polarities::Signed, Interpolation::Linear)
    }

    /// The same with other polarities or interpolation.
    pub const fn try_with(
        geometry: Geometry,
        bins: u16,
        polarities: Polarities,
        interpolation: Interpolation,
    ) -> Result<Self, BadRepresentation> {
        let planes = bins as u64 * if matches!(polarities, Polarities::Apart) { 2 } else { 1 };
        if bins == 0 || geometry.pixels() as u64 * planes > 1 << 32 {
            return Err(BadRepresentation::Bins { found: bins });
        }
        let clock = Clock { t0: 0, length: 0, bins_per_us: 0.0, last: 0.0 };
        Ok(Self { geometry, bins, polarities, interpolation, clock })
    }
}

/// Turns times into positions on the axis of bins.
#[derive(Clone, Copy, Debug)]
struct Clock {
    t0: u32,
    length: i32,
    bins_per_us: f32,
    /// The last bin: rounding leads beyond it, which would be the first of OFF.
    last: f32,
}

impl Clock {
    fn new(window: Window, bins: u16) -> Self {
        let length = window.t1.saturating_sub(window.t0).min(i32::MAX as u64) as i32;
        let intervals = bins.saturating_sub(1) as f32;
        Self { t0: window.t0 as u32, length, bins_per_us: intervals / length.max(1) as f32, last: intervals }
    }

    /// How far into the window an event lies, in µs.
    #[inline(always)]
    fn age(&self, event: Event) -> i32 {
        (event.t().wrapping_sub(self.t0) as i32).max(0).min(self.length)
    }

    /// The bin at or before the event and the share of the one after it.
    #[inline(always)]
    fn bin(&self, event: Event) -> (u32, f32) {
        self.bin_at(self.age(event))
    }

    /// The bins of events, and the one after the last, as bits: see [`Representation::planes`].
    fn planes(&self, events: &[Event]) -> u16 {
        let ages = events.iter().map(|event| self.age(*event));
        let (first, last) = ages.fold((i32::MAX, 0), |(first, last), age| (age.min(first), age.max(last)));
        let (first, last) = (self.bin_at(first).0, self.bin_at(last).0 + 1);
        if last.wrapping_sub(first) >= 15 {
            return u16::MAX;
        }
        let bits = (2u32 << last.wrapping_sub(first)) - 1;
        (bits as u16).rotate_left(first % 16)
    }

    #[inline(always)]
    fn bin_at(&self, age: i32) -> (u32, f32) {
        let position = (age as f32 * self.bins_per_us).min(self.last);
        // The whole number nearest to half below; at a tie either will do, since one of the two shares is 0 then.
        let rounded = (position - 0.5).max(0.0) + ROUND;
        let bin = rounded.to_bits() & 0xFFFF;
        (bin, position - (rounded - ROUND))
    }

    /// The bin nearest to the event.
    #[inline(always)]
    fn nearest(&self, event: Event) -> u32 {
        (self.age(event) as f32 * self.bins_per_us + ROUND).to_bits() & 0xFFFF
    }
}

impl Representation for VoxelGrid {
    type Pixel = f32;

    fn shape(&self) -> Shape {
        let planes = if self.polarities == Polarities::Apart { 2 } else { 1 };
        Shape {
            channels: planes * usize::from(self.bins),
            height: self.geometry.height.into(),
            width: self.geometry.width.into(),
        }
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [f32]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let (places, planes) = (Places::by_pixel(self.geometry), Planes::of(self));
        widest(
            #[inline(always)]
            || match self.interpolation {
                Interpolation::Linear => draw_each(span.events, places, out, &mut Sharing(planes)),
                Interpolation::Nearest => draw_each(span.events, places, out, &mut Placing(planes)),
            },
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
        let planes = self.clock.planes(events);
        match self.polarities {
            Polarities::Signed => planes,
            Polarities::Apart => planes | planes.rotate_left(u32::from(self.bins) % 16),
        }
    }
}

/// Where events go and with what sign.
#[derive(Clone, Copy)]
struct Planes {
    clock: Clock,
    pixels: usize,
    /// How far the bins of OFF are from those of ON.
    off: u32,
    /// The sign of OFF.
    off_sign: u32,
}

impl Planes {
    fn of(grid: &VoxelGrid) -> Self {
        let pixels = grid.geometry.pixels();
        let (off, off_sign) = match grid.polarities {
            Polarities::Signed => (0, SIGN_BIT),
            Polarities::Apart => ((pixels * usize::from(grid.bins)) as u32, 0),
        };
        Self { clock: grid.clock, pixels, off, off_sign }
    }

    /// Moves `at` to the bin and gives the weight its sign.
    #[inline(always)]
    fn enter(&self, event: Event, bin: u32, at: &mut u32) -> impl Fn(f32) -> f32 {
        let off = !event.on_mask();
        *at = at.wrapping_add(bin.wrapping_mul(self.pixels as u32)).wrapping_add(off & self.off);
        let sign = off & self.off_sign;
        move |weight| f32::from_bits(weight.to_bits() ^ sign)
    }
}

/// Shares each event between two bins.
struct Sharing(Planes);

impl Draw for Sharing {
    type Pixel = f32;
    type Value = [f32; 2];

    #[inline(always)]
    fn prepare(&self, event: Event, at: &mut u32) -> [f32; 2] {
        let (bin, share) = self.0.clock.bin(event);
        [1.0 - share, share].map(self.0.enter(event, bin, at))
    }

    #[inline(always)]
    fn look_ahead(&self, out: &[f32], at: usize) {
        prefetch(out, at);
        prefetch(out, at + self.0.pixels);
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [f32], at: usize, [low, high]: [f32; 2]) {
        if let Some(cell) = out.get_mut(at) {
            *cell += low;
        }
        if let Some(cell) = out.get_mut(at + self.0.pixels) {
            *cell += high;
        }
    }
}

/// Adds each event to one bin.
struct Placing(Planes);

impl Draw for Placing {
    type Pixel = f32;
    type Value = f32;

    #[inline(always)]
    fn prepare(&self, event: Event, at: &mut u32) -> f32 {
        let bin = self.0.clock.nearest(event);
        self.0.enter(event, bin, at)(1.0)
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [f32], at: usize, weight: f32) {
        if let Some(cell) = out.get_mut(at) {
            *cell += weight;
        }
    }
}

impl<S> Build<S> for VoxelGrid {
    fn state_len(_: &Parameters, _: Geometry) -> usize {
        0
    }

    fn build(parameters: &Parameters, geometry: Geometry, _: S) -> Result<Self, BadRepresentation> {
        Self::try_with(geometry, parameters.bins, parameters.polarities, parameters.interpolation)
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
        let planes = Planes { clock: Clock::new(window, 9), ..Planes::of(&stage) };
        draw_each(&events, Places::by_pixel(geometry), &mut plain, &mut Sharing(planes));
        let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&wide), bits(&plain));
    }
}
