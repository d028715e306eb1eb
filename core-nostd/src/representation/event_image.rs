//! What a person looks at: each pixel's last event as a colour that fades.
//!
//! Source: `raw_image` of eventcv 1.0.8, whose colours are those of [`Palette::Dark`].

use crate::math::exp;
use crate::representation::index::Places;
use crate::representation::stamps::Stamps;
use crate::representation::time_surface::{DECAYS_MAX, TAU_US_MAX};
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, check};
use crate::vector::in_order;
use crate::{Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Adding it rounds a small number to a whole one, which is then in the low bits of the sum.
const ROUND: f32 = 8_388_608.0; // 2^23

/// Colours of an [`EventImage`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Palette {
    /// ON #ff496c, OFF #27c2ff, on black.
    #[default]
    Dark,
    /// ON #c81e1e, OFF #1e50c8, on white.
    Light,
    /// ON white, OFF black, on mid-gray (#808080).
    Gray,
}

impl Palette {
    /// Red, green and blue of nothing, ON and OFF.
    pub const fn colours(self) -> [[u8; 3]; 3] {
        match self {
            Self::Dark => [[0; 3], [0xFF, 0x49, 0x6C], [0x27, 0xC2, 0xFF]],
            Self::Light => [[0xFF; 3], [0xC8, 0x1E, 0x1E], [0x1E, 0x50, 0xC8]],
            Self::Gray => [[0x80; 3], [0xFF; 3], [0; 3]],
        }
    }
}

/// The last event of each pixel as the colour of its polarity, which fades into the background: 3 x H x W (red, green,
/// blue) of u8.
///
/// `background + (colour - background) exp(-age / tau)`, rounded; the age is counted from the window's end in steps of
/// 2 µs. The last event is the last in stream order; one older than its window counts at its start. Like a
/// [`TimeSurface`](super::TimeSurface) it remembers across windows, in a map of the caller's
/// ([`state_len`](Self::state_len) elements).
///
/// ```
/// use lobula_core::representation::{EventImage, Palette};
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [Event::new(1_000, 1, 0, Polarity::On)];
/// let mut out = [0xFF; 6]; // whatever was there
/// let mut image = EventImage::try_new(geometry, 500, Palette::Dark, [0; 2])?;
/// image.begin(Window { t0: 0, t1: 1_000 }, &mut out);
/// image.accumulate(Span { t_first: 1_000, t_last: 1_000, geometry, events: &events }, &mut out)?;
/// image.finish(&mut out);
/// assert_eq!(out, [0, 0xFF, 0, 0x49, 0, 0x6C]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct EventImage<S> {
    geometry: Geometry,
    tau_us: u32,
    palette: Palette,
    stamps: Stamps<S>,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> EventImage<S> {
    /// Elements of the map.
    pub const fn state_len(geometry: Geometry) -> usize {
        geometry.pixels()
    }

    /// For a sensor of this size, a fading of 1 to 2^25 µs and a map of [`state_len`](Self::state_len) elements, whatever
    /// they hold.
    pub fn try_new(
        geometry: Geometry,
        tau_us: u32,
        palette: Palette,
        map: S,
    ) -> Result<Self, BadRepresentation> {
        if tau_us == 0 || tau_us > TAU_US_MAX {
            return Err(BadRepresentation::TauUs { found: tau_us });
        }
        let stamps = Stamps::try_new(Self::state_len(geometry), map)?;
        Ok(Self { geometry, tau_us, palette, stamps })
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for EventImage<S> {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        Shape { channels: 3, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn begin(&mut self, window: Window, _: &mut [u8]) {
        self.stamps.begin(window);
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [u8]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        self.stamps.accumulate_with_polarity(span.events, Places::by_pixel(self.geometry));
        Ok(())
    }

    fn finish(&mut self, out: &mut [u8]) {
        let (tau_us, (now, map), colours) = (self.tau_us, self.stamps.ages(), self.palette.colours());
        let pixels = self.geometry.pixels();
        let (red, rest) = out.split_at_mut(pixels.min(out.len()));
        let (green, blue) = rest.split_at_mut(pixels.min(rest.len()));
        let channels = [red, green, blue];
        in_order(
            #[inline(always)]
            || fade(now, tau_us, map, colours, channels),
        );
    }

    fn overlap(&self) -> Overlap {
        Overlap::Memory
    }
}

/// Pixels whose shares are worked out together, for all three channels.
const ROW: usize = 256;

/// Paints every pixel of the map.
#[inline(always)]
fn fade(now: u32, tau_us: u32, map: &[u32], colours: [[u8; 3]; 3], mut channels: [&mut [u8]; 3]) {
    let rate = -1.0 / tau_us as f32;
    let age_max = (tau_us * DECAYS_MAX) as i32;
    let mut shares = [0.0f32; ROW];
    for map in map.chunks(ROW) {
        for (share, last) in shares.iter_mut().zip(map) {
            let age = (now.wrapping_sub(*last & !1) as i32).min(age_max);
            *share = exp(age as f32 * rate);
        }
        for (at, channel) in channels.iter_mut().enumerate() {
            let [none, on, off] =
                colours.map(|colour| f32::from(colour.get(at).copied().unwrap_or_default()));
            let left = core::mem::take(channel);
            let (out, rest) = left.split_at_mut(map.len().min(left.len()));
            for (out, (last, share)) in out.iter_mut().zip(map.iter().zip(&shares)) {
                let colour = if *last & 1 == 0 { off - none } else { on - none };
                // Rounded into the lowest bits, which is quicker than a conversion.
                *out = (none + colour * *share + ROUND).to_bits() as u8;
            }
            *channel = rest;
        }
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for EventImage<S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(parameters: &Parameters, geometry: Geometry, map: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.tau_us, parameters.palette, map)
    }
}
