//! The newest events of each neighbourhood in their order, and nothing older: an image on which corner detectors for
//! frames work.
//!
//! Source: Glover et al., luvHarris: A Practical Corner Detector for Event-cameras, TPAMI 2021, algorithm 1.

use crate::representation::patches::{Patches, Stamp};
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, check};
use crate::{Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Threshold ordinal surface (TOS) of both polarities: 1 x H x W of u8, 0 or `threshold` to 255.
///
/// An event lowers every pixel within `radius` of its own (a square, cut at the border) by 1; what comes below the
/// threshold is 0; then its own is 255. Nothing decays with time: the surface begins at 0 and remembers across windows.
///
/// State: a byte a pixel with a margin of 15 pixels. The radius is 1 to 7 and 3 by default (7 x 7 pixels), the threshold
/// 1 to 255 and 241 by default, 255 - 2 (2 radius + 1) for that radius.
///
/// ```
/// use lobula_core::representation::Tos;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(4, 1);
/// let events = [0, 1, 2, 3].map(|x| Event::new(10 * x, x as u16, 0, Polarity::On));
/// let mut out = [0xFF; 4]; // whatever was there
/// let mut tos = Tos::try_new(geometry, 3, 253, vec![0; Tos::<Vec<u32>>::state_len(geometry)])?;
/// tos.begin(Window { t0: 0, t1: 100 }, &mut out);
/// tos.accumulate(Span { t_first: 0, t_last: 30, geometry, events: &events }, &mut out)?;
/// tos.finish(&mut out);
/// assert_eq!(out, [0, 253, 254, 255]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Tos<S> {
    geometry: Geometry,
    threshold: u8,
    patches: Patches<S>,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Tos<S> {
    /// Elements of the state.
    pub const fn state_len(geometry: Geometry) -> usize {
        Patches::<S>::state_len(geometry, 1)
    }

    /// For a sensor of this size, a radius of 1 to 7 pixels, a threshold from 1 on and state of
    /// [`state_len`](Self::state_len) elements, whatever they hold.
    pub fn try_new(
        geometry: Geometry,
        radius: u16,
        threshold: u8,
        state: S,
    ) -> Result<Self, BadRepresentation> {
        if threshold == 0 {
            return Err(BadRepresentation::Parameter { key: "threshold", found: 0, range: "1 to 255" });
        }
        let patches = Patches::try_new(geometry, 1, radius, state)?;
        Ok(Self { geometry, threshold, patches })
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for Tos<S> {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        Shape { channels: 1, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn begin(&mut self, _: Window, _: &mut [u8]) {}

    fn accumulate(&mut self, span: Span<'_>, _: &mut [u8]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        self.patches.accumulate(span.events, Lowering { threshold: self.threshold });
        Ok(())
    }

    fn finish(&mut self, out: &mut [u8]) {
        self.patches.write(out);
    }

    fn overlap(&self) -> Overlap {
        Overlap::Memory
    }
}

/// Pixels go down by 1 until they fall below the threshold.
#[derive(Clone, Copy)]
struct Lowering {
    threshold: u8,
}

impl Stamp for Lowering {
    /// What is taken from a value.
    #[inline(always)]
    fn column(self, outside: u8, _: u8) -> u8 {
        !outside & 1
    }

    #[inline(always)]
    fn around(self, value: u8, less: u8) -> u8 {
        let lower = value.saturating_sub(less); // every value is 0 or no less than the threshold
        if lower < self.threshold { 0 } else { lower }
    }

    #[inline(always)]
    fn own(self) -> u8 {
        u8::MAX
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for Tos<S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.radius, parameters.threshold, state)
    }
}
