//! Surfaces on which an event changes all pixels around its own: bytes in memory of the caller's, with a margin, so that
//! every neighbourhood lies in it.

use crate::prefetch::prefetch;
use crate::representation::BadRepresentation;
use crate::representation::index::{Draw, Places, draw_each};
use crate::vector::widest;
use crate::{Event, Geometry};

/// The greatest radius: a row of a neighbourhood is then 15 pixels.
pub(super) const RADIUS_MAX: u16 = 7;

/// Bytes that are changed at once, of which a row of a neighbourhood is the first ones.
const ROW: usize = 16;

/// What an event does to the pixels around its own.
pub(super) trait Stamp: Copy {
    /// A pixel's new value where `inside` is 1, the one it has where `inside` is 0; the event's own pixel was `centre`.
    fn around(self, value: u8, centre: u8, inside: u8) -> u8;

    /// The new value of the event's own pixel.
    fn own(self) -> u8;
}

/// Planes of bytes with a margin, that outlast windows.
#[derive(Clone, Debug)]
pub(super) struct Patches<S> {
    geometry: Geometry,
    planes: usize,
    radius: u16,
    state: S,
}

/// Rows and columns of a plane with its margin. Sensors too large for that have none: no memory is that large.
const fn padded(geometry: Geometry) -> Geometry {
    let side = 2 * RADIUS_MAX + 1;
    Geometry { width: geometry.width.saturating_add(side), height: geometry.height.saturating_add(side) }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Patches<S> {
    /// Elements of the state.
    pub(super) const fn state_len(geometry: Geometry, planes: usize) -> usize {
        // Beyond the last row of a neighbourhood lies what 16 bytes are more.
        (planes * padded(geometry).pixels() + ROW).div_ceil(size_of::<u32>())
    }

    /// All 0, whatever the state held; the radius is 1 to [`RADIUS_MAX`].
    pub(super) fn try_new(
        geometry: Geometry,
        planes: usize,
        radius: u16,
        mut state: S,
    ) -> Result<Self, BadRepresentation> {
        if radius == 0 || radius > RADIUS_MAX {
            return Err(BadRepresentation::Parameter {
                key: "radius",
                found: radius.into(),
                range: "1 to 7 pixels",
            });
        }
        let (expected, found) = (Self::state_len(geometry, planes), state.as_ref().len());
        if expected != found {
            return Err(BadRepresentation::StateLen { expected, found });
        }
        state.as_mut().fill(0);
        Ok(Self { geometry, planes, radius, state })
    }

    /// Stamps each event, in order, on the plane of its polarity (ON, OFF) or the only one.
    pub(super) fn accumulate(&mut self, events: &[Event], stamp: impl Stamp) {
        let padded = padded(self.geometry);
        let places = if self.planes == 2 { Places::by_polarity(padded) } else { Places::by_pixel(padded) };
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(self.state.as_mut());
        let mut stamping = Stamping::new(stamp, self.radius, padded.width.into());
        widest(
            #[inline(always)]
            || draw_each(events, places, bytes, &mut stamping),
        );
    }

    /// The planes without their margins.
    pub(super) fn write(&self, out: &mut [u8]) {
        let (padded, bytes): (_, &[u8]) = (padded(self.geometry), bytemuck::cast_slice(self.state.as_ref()));
        let margin = usize::from(RADIUS_MAX);
        let (height, width) = (usize::from(self.geometry.height), usize::from(self.geometry.width));
        let rows = (0..self.planes).flat_map(|plane| (0..height).map(move |y| (plane, y)));
        for (out, (plane, y)) in out.chunks_mut(width.max(1)).zip(rows) {
            let start = plane * padded.pixels() + (y + margin) * usize::from(padded.width) + margin;
            for (out, byte) in out.iter_mut().zip(bytes.get(start..).unwrap_or_default()) {
                *out = *byte;
            }
        }
    }
}

/// Stamps events. An event's index in the padded plane is that of the first pixel of its neighbourhood when the radius is
/// the greatest.
struct Stamping<T> {
    stamp: T,
    width: usize,
    /// From the event's index to the first row of its neighbourhood, and to its own pixel.
    first: usize,
    own: usize,
    rows: usize,
    /// 1 for the pixels of a row.
    inside: [u8; ROW],
}

impl<T: Stamp> Stamping<T> {
    fn new(stamp: T, radius: u16, width: usize) -> Self {
        let (radius, most) = (usize::from(radius), usize::from(RADIUS_MAX));
        let rows = 2 * radius + 1;
        let inside = core::array::from_fn(|i| (i < rows) as u8);
        let (first, own) = ((most - radius) * (width + 1), most * (width + 1));
        Self { stamp, width, first, own, rows, inside }
    }
}

impl<T: Stamp> Draw for Stamping<T> {
    type Pixel = u8;
    type Value = ();

    #[inline(always)]
    fn prepare(&self, _: Event, _: &mut u32) {}

    #[inline(always)]
    fn look_ahead(&self, out: &[u8], at: usize) {
        prefetch(out, at + self.own);
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [u8], at: usize, (): ()) {
        let Some(centre) = out.get(at + self.own).copied() else { return };
        let mut start = at + self.first;
        for _ in 0..self.rows {
            let Some(row) = out.get_mut(start..).and_then(|row| row.first_chunk_mut::<ROW>()) else { break };
            for (value, inside) in row.iter_mut().zip(self.inside) {
                *value = self.stamp.around(*value, centre, inside);
            }
            start += self.width;
        }
        if let Some(own) = out.get_mut(at + self.own) {
            *own = self.stamp.own();
        }
    }
}
