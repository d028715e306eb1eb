//! Which pixels had an event.

use crate::representation::index::{Places, change_each};
use crate::representation::{BadRepresentation, Build, Count, Overlap, Parameters, check};
use crate::vector::{in_order, widest};
use crate::{Geometry, Representation, Shape, Span, WrongGeometry};

/// 1 where a pixel had an event of either polarity, 0 else: 1 x H x W of u8.
///
/// ```
/// use lobula_core::representation::Binary;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(3, 1);
/// let events = [Event::new(5, 1, 0, Polarity::On), Event::new(6, 1, 0, Polarity::Off)];
/// let mut out = [0xFF; 3]; // whatever was there
/// let mut binary = Binary::new(geometry);
/// binary.begin(Window { t0: 0, t1: 10 }, &mut out);
/// binary.accumulate(Span { t_first: 5, t_last: 6, geometry, events: &events }, &mut out)?;
/// binary.finish(&mut out);
/// assert_eq!(out, [0, 1, 0]);
/// # Ok::<(), lobula_core::WrongGeometry>(())
/// ```
#[derive(Clone, Debug)]
pub struct Binary {
    geometry: Geometry,
    /// What goes on where windows overlap.
    count: Count<u8>,
}

impl Binary {
    /// For a sensor of this size.
    pub const fn new(geometry: Geometry) -> Self {
        Self { geometry, count: Count::new(geometry) }
    }
}

impl Representation for Binary {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        Shape { channels: 1, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [u8]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let places = Places::by_pixel(self.geometry);
        widest(
            #[inline(always)]
            || change_each(places, span.events, out, |pixel, _| *pixel = 1),
        );
        Ok(())
    }

    fn finish(&mut self, _: &mut [u8]) {}

    fn overlap(&self) -> Overlap {
        Overlap::Sum
    }

    fn add(&mut self, span: Span<'_>, sum: &mut [u8]) -> Result<(), WrongGeometry> {
        self.count.accumulate(span, sum)
    }

    fn show(&mut self, sum: &[u8], out: &mut [u8]) {
        in_order(
            #[inline(always)]
            || out.iter_mut().zip(sum).for_each(|(out, count)| *out = (*count).min(1)),
        );
    }

    fn take_away(&mut self, span: Span<'_>, sum: &mut [u8]) -> Result<bool, WrongGeometry> {
        self.count.take_away(span, sum)
    }
}

impl<S> Build<S> for Binary {
    fn state_len(_: &Parameters, _: Geometry) -> usize {
        0
    }

    fn build(_: &Parameters, geometry: Geometry, _: S) -> Result<Self, BadRepresentation> {
        Ok(Self::new(geometry))
    }
}
