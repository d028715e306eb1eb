//! How recently each pixel fired, on several scales of time.
//!
//! Source: Multi-Channel Time Surface, as `mcts` of eventcv 1.0.8 has it.

use core::marker::PhantomData;

use crate::math::sqrt;
use crate::representation::index::Places;
use crate::representation::stamps::{AGE_US_MAX, Stamps};
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, Real, check};
use crate::vector::in_order;
use crate::{Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Scales of time of an [`Mcts`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scales {
    lens_us: [f32; Self::MAX],
    len: usize,
}

impl Scales {
    /// How many there can be.
    pub const MAX: usize = 16;

    /// Scales of these lengths in µs, each 1 to 2^30, at most [`MAX`](Self::MAX) and at least one.
    pub fn try_new(lens_us: &[u32]) -> Result<Self, BadRepresentation> {
        let range = "1 to 2^30 µs each";
        if let Some(bad) = lens_us.iter().find(|len| !(1..=AGE_US_MAX).contains(*len)) {
            return Err(BadRepresentation::Parameter { key: "windows_us", found: u64::from(*bad), range });
        }
        let mut scales = Self { lens_us: [1.0; Self::MAX], len: lens_us.len() };
        if lens_us.is_empty() || lens_us.len() > Self::MAX {
            let (found, range) = (lens_us.len() as u64, "1 to 16 lengths");
            return Err(BadRepresentation::Parameter { key: "windows_us", found, range });
        }
        scales.lens_us.iter_mut().zip(lens_us).for_each(|(scale, len)| *scale = *len as f32);
        Ok(scales)
    }

    /// Five scales from 1 ms to `max_us` (1000 to 2^30), each longer than the one before by the same factor.
    pub fn up_to(max_us: u32) -> Result<Self, BadRepresentation> {
        if !(1000..=AGE_US_MAX).contains(&max_us) {
            let (found, range) = (u64::from(max_us), "1000 to 2^30 µs");
            return Err(BadRepresentation::Parameter { key: "max_window_us", found, range });
        }
        let factor = sqrt(sqrt(max_us as f32 / 1000.0));
        let mut scales = Self { lens_us: [1000.0; Self::MAX], len: 5 };
        let mut len_us = 1000.0;
        for scale in &mut scales.lens_us {
            *scale = len_us;
            len_us *= factor;
        }
        Ok(scales)
    }

    /// Their lengths in µs.
    pub fn lens_us(&self) -> &[f32] {
        self.lens_us.get(..self.len).unwrap_or_default()
    }
}

/// 1 - age / w of each pixel's last event for each scale w: 2 N x H x W of f32 or f16. First the N scales of OFF, then
/// those of ON.
///
/// The age is counted from the window's end; 0 where it is w or more or nothing ever fired. The last event is the last
/// in stream order; one older than its window counts at its start. Like a [`TimeSurface`](super::TimeSurface) it
/// remembers across windows, in a map of the caller's ([`state_len`](Self::state_len) elements).
///
/// ```
/// use lobula_core::representation::{Mcts, Scales};
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(1, 1);
/// let events = [Event::new(9_900, 0, 0, Polarity::On)];
/// let mut out = [f32::NAN; 4]; // whatever was there
/// let mut surface = Mcts::try_new(geometry, Scales::try_new(&[200, 400])?, [0; 2])?;
/// surface.begin(Window { t0: 0, t1: 10_000 }, &mut out);
/// surface.accumulate(Span { t_first: 9_900, t_last: 9_900, geometry, events: &events }, &mut out)?;
/// surface.finish(&mut out);
/// assert_eq!(out, [0.0, 0.0, 0.5, 0.75]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Mcts<P, S> {
    geometry: Geometry,
    scales: Scales,
    stamps: Stamps<S>,
    pixel: PhantomData<P>,
}

impl<P: Real, S: AsRef<[u32]> + AsMut<[u32]>> Mcts<P, S> {
    /// Elements of the map.
    pub const fn state_len(geometry: Geometry) -> usize {
        2 * geometry.pixels()
    }

    /// For a sensor of this size and a map of [`state_len`](Self::state_len) elements, whatever they hold.
    pub fn try_new(geometry: Geometry, scales: Scales, map: S) -> Result<Self, BadRepresentation> {
        let stamps = Stamps::try_new(Self::state_len(geometry), map)?;
        Ok(Self { geometry, scales, stamps, pixel: PhantomData })
    }
}

impl<P: Real, S: AsRef<[u32]> + AsMut<[u32]>> Representation for Mcts<P, S> {
    type Pixel = P;

    fn shape(&self) -> Shape {
        let channels = 2 * self.scales.lens_us().len();
        Shape { channels, height: self.geometry.height.into(), width: self.geometry.width.into() }
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
        let ((now, map), pixels, scales) =
            (self.stamps.ages(), self.geometry.pixels(), self.scales.lens_us());
        let (on, off) = map.split_at_checked(pixels).unwrap_or_default();
        let planes = [off, on].into_iter().flat_map(|map| scales.iter().map(move |scale| (map, *scale)));
        for (plane, (map, scale)) in out.chunks_mut(pixels.max(1)).zip(planes) {
            in_order(
                #[inline(always)]
                || recency(now, 1.0 / scale, map, plane),
            );
        }
    }

    fn overlap(&self) -> Overlap {
        Overlap::Memory
    }
}

/// 1 - age * rate of each time in the map, 0 at least.
#[inline(always)]
fn recency<P: Real>(now: u32, rate: f32, map: &[u32], out: &mut [P]) {
    for (out, last) in out.iter_mut().zip(map) {
        let age = now.wrapping_sub(*last) as i32;
        *out = P::from_share((1.0 - age as f32 * rate).max(0.0));
    }
}

impl<P: Real, S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for Mcts<P, S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(parameters: &Parameters, geometry: Geometry, map: S) -> Result<Self, BadRepresentation> {
        let scales = match parameters.windows_us.as_slice() {
            [] => Scales::up_to(parameters.max_window_us),
            lens_us => Scales::try_new(lens_us),
        }?;
        Self::try_new(geometry, scales, map)
    }
}
