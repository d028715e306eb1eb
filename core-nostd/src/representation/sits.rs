//! How recently each pixel fired in the order of its neighbourhood: a surface that a fast edge and a slow one leave
//! alike.
//!
//! Source: Manderscheid et al., Speed Invariant Time Surface for Learning to Detect Corner Points with Event-Based
//! Cameras, CVPR 2019, algorithm 1.

use crate::representation::patches::{Patches, Stamp};
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, check};
use crate::{Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Speed invariant time surface (SITS) by polarity: 2 x H x W (ON, OFF) of u8, 0 to `(2 radius + 1)^2`.
///
/// An event lowers every pixel within `radius` of its own (a square, cut at the border) on the surface of its polarity
/// that is not below its own by 1, 0 stays; then its own is `(2 radius + 1)^2`. Time is not looked at, but for the order,
/// and nothing decays: the surface begins at 0 and remembers across windows.
///
/// State: a byte a pixel and polarity with a margin of 15 pixels. The radius is 1 to 7 and 3 by default (7 x 7 pixels);
/// the paper's corner detector and dv-processing take other ones.
///
/// ```
/// use lobula_core::representation::Sits;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(3, 1);
/// let events = [0, 1, 2].map(|x| Event::new(10 * x, x as u16, 0, Polarity::On));
/// let mut out = [0xFF; 6]; // whatever was there
/// let mut sits = Sits::try_new(geometry, 1, vec![0; Sits::<Vec<u32>>::state_len(geometry)])?;
/// sits.begin(Window { t0: 0, t1: 100 }, &mut out);
/// sits.accumulate(Span { t_first: 0, t_last: 20, geometry, events: &events }, &mut out)?;
/// sits.finish(&mut out);
/// assert_eq!(out, [8, 8, 9, 0, 0, 0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Sits<S> {
    geometry: Geometry,
    newest: u8,
    patches: Patches<S>,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Sits<S> {
    /// Elements of the state.
    pub const fn state_len(geometry: Geometry) -> usize {
        Patches::<S>::state_len(geometry, 2)
    }

    /// For a sensor of this size, a radius of 1 to 7 pixels and state of [`state_len`](Self::state_len) elements,
    /// whatever they hold.
    pub fn try_new(geometry: Geometry, radius: u16, state: S) -> Result<Self, BadRepresentation> {
        let patches = Patches::try_new(geometry, 2, radius, state)?;
        let side = 2 * radius + 1;
        Ok(Self { geometry, newest: (side * side) as u8, patches })
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for Sits<S> {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        Shape { channels: 2, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn begin(&mut self, _: Window, _: &mut [u8]) {}

    fn accumulate(&mut self, span: Span<'_>, _: &mut [u8]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        self.patches.accumulate(span.events, Ranking { newest: self.newest });
        Ok(())
    }

    fn finish(&mut self, out: &mut [u8]) {
        self.patches.write(out);
    }

    fn overlap(&self) -> Overlap {
        Overlap::Memory
    }
}

/// The newest pixel is ranked first, and those that were not behind it go one rank back.
#[derive(Clone, Copy)]
struct Ranking {
    newest: u8,
}

impl Stamp for Ranking {
    /// The least value that goes back. No value is as great as that of the columns outside.
    #[inline(always)]
    fn column(self, outside: u8, centre: u8) -> u8 {
        centre.max(1) | outside
    }

    #[inline(always)]
    fn around(self, value: u8, least: u8) -> u8 {
        value.wrapping_sub(u8::from(value >= least))
    }

    #[inline(always)]
    fn own(self) -> u8 {
        self.newest
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for Sits<S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.radius, state)
    }
}
