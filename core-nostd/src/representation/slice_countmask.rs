//! How many events of each polarity each pixel had, clipped at a percentile, and which pixels had any: an image.
//!
//! Source: GEPT's event image (its equation 2), as `countmask` of eventcv 1.0.8 has it.

use crate::representation::digits::Digits;
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, check_percentile};
use crate::{Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// What stands for no events in an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Background {
    /// 0.
    #[default]
    Black,
    /// 255: each value is taken from 1.
    White,
}

/// Counts and activity as an image: 3 x H x W (red: ON, green: any, blue: OFF) of u8.
///
/// Red and blue are `255 min(n, a) / a` of the pixel's number of events n, cut off after the point, where a is the
/// percentile of all numbers of either polarity that are not 0 (linear between two, as numpy's default is). Green is 255
/// where there was any event. [`Background::White`] takes each from 1. In single precision, as the source does it.
/// Known only at the window's end: the counts are kept in memory of the caller's ([`state_len`](Self::state_len)
/// elements).
///
/// ```
/// use lobula_core::representation::{Background, SliceCountmask};
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [(0, Polarity::On), (1, Polarity::Off), (1, Polarity::Off)].map(|(x, p)| Event::new(5, x, 0, p));
/// let mut out = [0xFF; 6]; // whatever was there
/// let mut image = SliceCountmask::try_new(geometry, 100, Background::Black, [0; 4])?;
/// image.begin(Window { t0: 0, t1: 10 }, &mut out);
/// image.accumulate(Span { t_first: 5, t_last: 5, geometry, events: &events }, &mut out)?;
/// image.finish(&mut out);
/// assert_eq!(out, [127, 0, 255, 255, 0, 255]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SliceCountmask<S> {
    percentile: u8,
    background: Background,
    counts: Digits<S>,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> SliceCountmask<S> {
    /// Elements of the state.
    pub const fn state_len(geometry: Geometry) -> usize {
        Digits::<S>::state_len(geometry)
    }

    /// For a sensor of this size, a percentile of 0 to 100, and state of [`state_len`](Self::state_len) elements,
    /// whatever they hold.
    pub fn try_new(
        geometry: Geometry,
        percentile: u8,
        background: Background,
        state: S,
    ) -> Result<Self, BadRepresentation> {
        let percentile = check_percentile(percentile)?;
        Ok(Self { percentile, background, counts: Digits::try_new(geometry, state)? })
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for SliceCountmask<S> {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        self.counts.shape(3)
    }

    fn begin(&mut self, _: Window, _: &mut [u8]) {
        self.counts.clear();
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [u8]) -> Result<(), WrongGeometry> {
        self.counts.accumulate(span)
    }

    fn finish(&mut self, out: &mut [u8]) {
        let alpha = self.counts.percentile(self.counts.all(), self.percentile) as f32;
        let white = self.background == Background::White;
        let byte = |share: f32| ((if white { 1.0 - share } else { share }) * 255.0) as u8;
        let level = |count: u32| byte((count as f32).min(alpha) / alpha);
        self.counts.map_planes(self.counts.planes(out), [byte(0.0), byte(1.0)], level);
    }

    fn overlap(&self) -> Overlap {
        Overlap::OwnSum
    }

    fn take_away(&mut self, span: Span<'_>, _: &mut [u8]) -> Result<bool, WrongGeometry> {
        self.counts.take_away(span)
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for SliceCountmask<S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.percentile, parameters.background, state)
    }

    fn saturated(&self) -> u64 {
        self.counts.saturated()
    }
}
