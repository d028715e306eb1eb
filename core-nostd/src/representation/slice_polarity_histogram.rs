//! How many events of each polarity each pixel had, as shares of the most.
//!
//! Source: `polarity` of eventcv 1.0.8, in its normalised form.

use crate::representation::digits::Digits;
use crate::representation::{BadRepresentation, Build, Overlap, Parameters};
use crate::{Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Number of events of each pixel by polarity, as a share of the greatest: 2 x H x W (ON, OFF) of u8.
///
/// `255 n / max`, rounded to the nearest (halves up), where `max` is the greatest count of either polarity; all 0
/// without events. Known only at the window's end: the counts are kept in memory of the caller's
/// ([`state_len`](Self::state_len) elements), exact up to 2^32 - 1.
///
/// ```
/// use lobula_core::representation::SlicePolarityHistogram;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [(1, Polarity::On), (1, Polarity::On), (0, Polarity::Off)].map(|(x, p)| Event::new(5, x, 0, p));
/// let mut out = [0xFF; 4]; // whatever was there
/// let mut histogram = SlicePolarityHistogram::try_new(geometry, [0; 4])?;
/// histogram.begin(Window { t0: 0, t1: 10 }, &mut out);
/// histogram.accumulate(Span { t_first: 5, t_last: 5, geometry, events: &events }, &mut out)?;
/// histogram.finish(&mut out);
/// assert_eq!(out, [0, 255, 128, 0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SlicePolarityHistogram<S> {
    counts: Digits<S>,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> SlicePolarityHistogram<S> {
    /// Elements of the state.
    pub const fn state_len(geometry: Geometry) -> usize {
        Digits::<S>::state_len(geometry)
    }

    /// For a sensor of this size, and state of [`state_len`](Self::state_len) elements, whatever they hold.
    pub fn try_new(geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Ok(Self { counts: Digits::try_new(geometry, state)? })
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for SlicePolarityHistogram<S> {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        self.counts.shape(2)
    }

    fn begin(&mut self, _: Window, _: &mut [u8]) {
        self.counts.clear();
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [u8]) -> Result<(), WrongGeometry> {
        self.counts.accumulate(span)
    }

    fn finish(&mut self, out: &mut [u8]) {
        let max = u64::from(self.counts.max()).max(1);
        self.counts.map(0, out, |count| ((u64::from(count) * 255 + max / 2) / max) as u8);
    }

    fn overlap(&self) -> Overlap {
        Overlap::OwnSum
    }

    fn take_away(&mut self, span: Span<'_>, _: &mut [u8]) -> Result<bool, WrongGeometry> {
        self.counts.take_away(span)
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for SlicePolarityHistogram<S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(_: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, state)
    }

    fn saturated(&self) -> u64 {
        self.counts.saturated()
    }
}
