//! How many events each pixel had, of either polarity or of each.

use core::marker::PhantomData;

use crate::representation::index::Places;
use crate::representation::pixel::{count_each, uncount_each};
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, Tally, check};
use crate::{Geometry, Representation, Shape, Span, WrongGeometry};

/// Number of events of each pixel, of either polarity: 1 x H x W of u8, u16 or f32.
///
/// A pixel that reaches the greatest number of its type stays there (u8: 255, u16: 65535, f32: 2^24); the events it
/// could not count are in [`saturated`](Build::saturated). No normalisation: divide by what you know.
///
/// ```
/// use lobula_core::representation::Count;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(3, 1);
/// let events = [Event::new(5, 1, 0, Polarity::On), Event::new(6, 1, 0, Polarity::Off)];
/// let mut out = [0xFF; 3]; // whatever was there
/// let mut count = Count::<u8>::new(geometry);
/// count.begin(Window { t0: 0, t1: 10 }, &mut out);
/// count.accumulate(Span { t_first: 5, t_last: 6, geometry, events: &events }, &mut out)?;
/// count.finish(&mut out);
/// assert_eq!(out, [0, 2, 0]);
/// # Ok::<(), lobula_core::WrongGeometry>(())
/// ```
pub type Count<P> = EventCount<P, 1>;

/// Number of events of each pixel by polarity: 2 x H x W (ON, OFF) of u8, u16 or f32.
///
/// Pixels stop at the same numbers as those of a [`Count`], and tell as much.
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
pub type PolarityHistogram<P> = EventCount<P, 2>;

/// Number of events in `PLANES` planes: one of both polarities ([`Count`]), or ON and OFF ([`PolarityHistogram`]).
#[derive(Clone, Debug)]
pub struct EventCount<P, const PLANES: usize> {
    geometry: Geometry,
    saturated: u64,
    pixel: PhantomData<P>,
}

impl<P: Tally, const PLANES: usize> EventCount<P, PLANES> {
    /// For a sensor of this size.
    pub const fn new(geometry: Geometry) -> Self {
        const { assert!(PLANES == 1 || PLANES == 2, "there are two polarities") };
        Self { geometry, saturated: 0, pixel: PhantomData }
    }

    #[inline(always)]
    fn places(&self) -> Places {
        if PLANES == 1 { Places::by_pixel(self.geometry) } else { Places::by_polarity(self.geometry) }
    }
}

impl<P: Tally, const PLANES: usize> Representation for EventCount<P, PLANES> {
    type Pixel = P;

    fn shape(&self) -> Shape {
        Shape { channels: PLANES, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [P]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        self.saturated += count_each(self.places(), span.events, out);
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
        Ok(uncount_each(self.places(), span.events, out))
    }
}

impl<P: Tally, S, const PLANES: usize> Build<S> for EventCount<P, PLANES> {
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
