//! How many events of each polarity each pixel had.

use core::marker::PhantomData;

use crate::representation::index::{Places, draw_each};
use crate::representation::pixel::{Counting, uncount_each};
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, Tally, check};
use crate::vector::widest;
use crate::{Event, Geometry, Representation, Shape, Span, WrongGeometry};

/// Number of events of each pixel by polarity: 2 x H x W (ON, OFF) of u8, u16 or f32.
///
/// A pixel that reaches the greatest number of its type stays there (u8: 255, u16: 65535, f32: 2^24); the events it
/// could not count are in [`saturated`](Build::saturated). No normalisation: divide by what you know.
///
/// ```
/// use lobula_core::representation::PolarityHistogram;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [Event::new(5, 1, 0, Polarity::On), Event::new(6, 0, 0, Polarity::Off)];
/// let mut out = [0xFF; 4]; // whatever was there
/// let mut histogram = PolarityHistogram::<u8>::new(geometry);
/// histogram.begin(Window { t0: 0, t1: 10 }, &mut out);
/// histogram.accumulate(Span { t_first: 5, t_last: 6, geometry, events: &events }, &mut out)?;
/// histogram.finish(&mut out);
/// assert_eq!(out, [0, 1, 1, 0]);
/// # Ok::<(), lobula_core::WrongGeometry>(())
/// ```
#[derive(Clone, Debug)]
pub struct PolarityHistogram<P> {
    geometry: Geometry,
    saturated: u64,
    pixel: PhantomData<P>,
}

impl<P: Tally> PolarityHistogram<P> {
    /// For a sensor of this size.
    pub const fn new(geometry: Geometry) -> Self {
        Self { geometry, saturated: 0, pixel: PhantomData }
    }
}

impl<P: Tally> Representation for PolarityHistogram<P> {
    type Pixel = P;

    fn shape(&self) -> Shape {
        Shape { channels: 2, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [P]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let geometry = self.geometry;
        self.saturated += widest(
            #[inline(always)]
            || add(geometry, span.events, out),
        );
        Ok(())
    }

    fn finish(&mut self, _: &mut [P]) {}

    fn is_sparse(&self) -> bool {
        true
    }

    fn overlap(&self) -> Overlap {
        Overlap::Sum
    }

    fn take_away(&mut self, span: Span<'_>, out: &mut [P]) -> Result<bool, WrongGeometry> {
        check(self.geometry, &span)?;
        Ok(uncount_each(Places::by_polarity(self.geometry), span.events, out))
    }
}

/// Counts events; returns how many could not be.
#[inline(always)]
fn add<P: Tally>(geometry: Geometry, events: &[Event], out: &mut [P]) -> u64 {
    let mut counting = Counting::default();
    draw_each(events, Places::by_polarity(geometry), out, &mut counting);
    counting.saturated
}

impl<P: Tally, S> Build<S> for PolarityHistogram<P> {
    fn state_len(_: &Parameters, _: Geometry) -> usize {
        0
    }

    fn build(_: &Parameters, geometry: Geometry, _: S) -> Result<Self, BadRepresentation> {
        Ok(Self::new(geometry))
    }

    fn saturated(&self) -> u64 {
        self.saturated
    }
}
