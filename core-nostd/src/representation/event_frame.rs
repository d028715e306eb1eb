//! What polarity each pixel's events had: their sum, or the last one.
//!
//! Source: Gallego et al., Event-Based Vision: A Survey, TPAMI 2022, section 3.1 ("event frame": pixel-wise count or
//! accumulation of polarity).

use core::marker::PhantomData;

use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::pixel::Signed;
use crate::representation::{BadRepresentation, Build, Dtype, Overlap, Parameters, check};
use crate::vector::widest;
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// What becomes of a pixel's events in an [`EventFrame`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Combine {
    /// The sum of their signs.
    #[default]
    Sum,
    /// The sign of the last in stream order.
    Latest,
}

/// Signs of each pixel's events, ON +1 and OFF -1: 1 x H x W of f32, or of u8 where 128 stands for 0.
///
/// Their sum, or the last one's ([`Combine`]); 0 where there was none. A sum stays within what the type holds (u8: -128
/// to 127, f32: ±2^24); the events beyond are in [`saturated`](Build::saturated).
///
/// ```
/// use lobula_core::representation::{Combine, EventFrame};
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [Polarity::On, Polarity::On, Polarity::Off].map(|p| Event::new(5, 1, 0, p));
/// let span = Span { t_first: 5, t_last: 5, geometry, events: &events };
/// let mut out = [f32::NAN; 2]; // whatever was there
/// for (combine, expected) in [(Combine::Sum, 1.0), (Combine::Latest, -1.0)] {
///     let mut frame = EventFrame::<f32>::new(geometry, combine);
///     frame.begin(Window { t0: 0, t1: 10 }, &mut out);
///     frame.accumulate(span, &mut out)?;
///     frame.finish(&mut out);
///     assert_eq!(out, [0.0, expected]);
/// }
/// # Ok::<(), lobula_core::WrongGeometry>(())
/// ```
#[derive(Clone, Debug)]
pub struct EventFrame<P> {
    geometry: Geometry,
    combine: Combine,
    saturated: u64,
    pixel: PhantomData<P>,
}

impl<P: Signed> EventFrame<P> {
    /// For a sensor of this size.
    pub const fn new(geometry: Geometry, combine: Combine) -> Self {
        Self { geometry, combine, saturated: 0, pixel: PhantomData }
    }
}

impl<P: Signed> Representation for EventFrame<P> {
    type Pixel = P;

    fn shape(&self) -> Shape {
        Shape { channels: 1, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn begin(&mut self, _: Window, out: &mut [P]) {
        out.fill(P::NONE);
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [P]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let places = Places::by_pixel(self.geometry);
        let latest = self.combine == Combine::Latest;
        let mut signing = Signing { latest, saturated: 0, pixel: PhantomData };
        widest(
            #[inline(always)]
            || draw_each(span.events, places, out, &mut signing),
        );
        self.saturated += signing.saturated;
        Ok(())
    }

    fn finish(&mut self, _: &mut [P]) {}

    /// What a sum of bytes comes to depends on where in the window it stopped at a limit.
    fn overlap(&self) -> Overlap {
        let is_sum = self.combine == Combine::Sum && P::DTYPE == Dtype::F32;
        if is_sum { Overlap::Sum } else { Overlap::Anew }
    }

    fn take_away(&mut self, span: Span<'_>, out: &mut [P]) -> Result<bool, WrongGeometry> {
        check(self.geometry, &span)?;
        let mut taking = Opposite(Signing { latest: false, saturated: 0, pixel: PhantomData });
        let places = Places::by_pixel(self.geometry);
        widest(
            #[inline(always)]
            || draw_each(span.events, places, out, &mut taking),
        );
        Ok(taking.0.saturated == 0)
    }
}

/// Adds the sign of each event, or puts it there.
struct Signing<P> {
    latest: bool,
    saturated: u64,
    pixel: PhantomData<P>,
}

impl<P: Signed> Draw for Signing<P> {
    type Pixel = P;
    type Value = bool;

    #[inline(always)]
    fn prepare(&self, event: Event, _: &mut u32) -> bool {
        event.is_on()
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [P], at: usize, on: bool) {
        if let Some(cell) = out.get_mut(at) {
            let from = if self.latest { P::NONE } else { *cell };
            *cell = from.step(on, &mut self.saturated);
        }
    }
}

/// Signs as if each event were of the other polarity.
struct Opposite<P>(Signing<P>);

impl<P: Signed> Draw for Opposite<P> {
    type Pixel = P;
    type Value = bool;

    #[inline(always)]
    fn prepare(&self, event: Event, at: &mut u32) -> bool {
        !self.0.prepare(event, at)
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [P], at: usize, on: bool) {
        self.0.draw(out, at, on);
    }
}

impl<P: Signed, S> Build<S> for EventFrame<P> {
    fn state_len(_: &Parameters, _: Geometry) -> usize {
        0
    }

    fn build(parameters: &Parameters, geometry: Geometry, _: S) -> Result<Self, BadRepresentation> {
        Ok(Self::new(geometry, parameters.combine))
    }

    fn saturated(&self) -> u64 {
        self.saturated
    }
}
