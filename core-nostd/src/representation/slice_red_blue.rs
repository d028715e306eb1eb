//! Which polarity prevails at each pixel, and how much: red and blue on white.
//!
//! Source: `redblue` of eventcv 1.0.8.

use crate::representation::digits::Digits;
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, check_percentile};
use crate::{Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// ON red, OFF blue, on white: 3 x H x W (red, green, blue) of u8.
///
/// Of each polarity, `min(n, a) / a` of the pixel's number of events n, where a is the percentile of that polarity's
/// numbers that are not 0 (linear between two, as numpy's default is). The greater of the two (ON at a tie) gives the
/// pixel its colour: the other two channels are `255 (1 - value)`, cut off after the point. In single precision, as the
/// source does it. Known only at the window's end: the counts are kept in memory of the caller's
/// ([`state_len`](Self::state_len) elements).
///
/// ```
/// use lobula_core::representation::SliceRedBlue;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let mut out = [0; 6]; // whatever was there
/// let mut image = SliceRedBlue::try_new(geometry, 99, [0; 4])?;
/// image.begin(Window { t0: 0, t1: 10 }, &mut out);
/// let events = [Event::new(5, 1, 0, Polarity::Off)];
/// image.accumulate(Span { t_first: 5, t_last: 5, geometry, events: &events }, &mut out)?;
/// image.finish(&mut out);
/// assert_eq!(out, [255, 0, 255, 0, 255, 255]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SliceRedBlue<S> {
    percentile: u8,
    counts: Digits<S>,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> SliceRedBlue<S> {
    /// Elements of the state.
    pub const fn state_len(geometry: Geometry) -> usize {
        Digits::<S>::state_len(geometry)
    }

    /// For a sensor of this size, a percentile of 0 to 100, and state of [`state_len`](Self::state_len) elements,
    /// whatever they hold.
    pub fn try_new(geometry: Geometry, percentile: u8, state: S) -> Result<Self, BadRepresentation> {
        let percentile = check_percentile(percentile)?;
        Ok(Self { percentile, counts: Digits::try_new(geometry, state)? })
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for SliceRedBlue<S> {
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
        let alphas = self.counts.by_polarity().map(|cells| self.counts.percentile(cells, self.percentile));
        let levels = alphas.map(|alpha| move |count: u32| (count as f32).min(alpha as f32) / alpha as f32);
        let faded = |value: f32| ((1.0 - value) * 255.0) as u8;
        let [red, green, blue] = self.counts.planes(out);
        self.counts.map_greater([blue, red], green, levels, faded);
    }

    fn overlap(&self) -> Overlap {
        Overlap::OwnSum
    }

    fn take_away(&mut self, span: Span<'_>, _: &mut [u8]) -> Result<bool, WrongGeometry> {
        self.counts.take_away(span)
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for SliceRedBlue<S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.percentile, state)
    }

    fn saturated(&self) -> u64 {
        self.counts.saturated()
    }
}
