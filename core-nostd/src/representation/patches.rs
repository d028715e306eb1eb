//! Surfaces on which an event changes all pixels around its own: bytes in memory of the caller's, with a margin, so that
//! every neighbourhood lies in it.

mod rows;

use core::hint::black_box;

use crate::prefetch::prefetch;
use crate::representation::BadRepresentation;
use crate::representation::index::{Draw, Places, draw_each};
use crate::vector::widest;
use crate::{Event, Geometry};
use rows::change_rows;

/// The greatest radius: a row of a neighbourhood is then 15 pixels.
pub(super) const RADIUS_MAX: u16 = 7;

/// Bytes that are changed at once, of which a row of a neighbourhood is the first ones: with radii up to 3, and with all.
const SHORT_ROW: usize = 8;
const ROW: usize = 16;

/// What an event does to the pixels around its own.
pub(super) trait Stamp: Copy {
    /// What is to be known of a column of bytes before they are looked at: `outside`, all bits of which are set if they are
    /// not of the neighbourhood and must stay, and what the event's own pixel was.
    fn column(self, outside: u8, centre: u8) -> u8;

    /// A byte's new value, in this column.
    fn around(self, value: u8, column: u8) -> u8;

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
        (planes * padded(geometry).pixels()).div_ceil(size_of::<u32>())
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
        match self.radius {
            1 => self.draw::<3, SHORT_ROW>(events, stamp),
            2 => self.draw::<5, SHORT_ROW>(events, stamp),
            3 => self.draw::<7, SHORT_ROW>(events, stamp),
            4 => self.draw::<9, ROW>(events, stamp),
            5 => self.draw::<11, ROW>(events, stamp),
            6 => self.draw::<13, ROW>(events, stamp),
            _ => self.draw::<15, ROW>(events, stamp),
        }
    }

    fn draw<const ROWS: u16, const N: usize>(&mut self, events: &[Event], stamp: impl Stamp) {
        let padded = padded(self.geometry);
        let places = if self.planes == 2 { Places::by_polarity(padded) } else { Places::by_pixel(padded) };
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(self.state.as_mut());
        let outside: [u8; N] = core::array::from_fn(|i| if i < usize::from(ROWS) { 0 } else { u8::MAX });
        // Bytes that it knows, the compiler takes one by one, out of the vector that the others are in.
        let outside = black_box(&outside);
        widest(
            // The closure owns what it draws with. Else each byte written may have changed that.
            #[inline(always)]
            move || {
                let mut stamping = Stamping::<_, ROWS, N> { stamp, width: padded.width, outside };
                draw_each(events, places, bytes, &mut stamping);
            },
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

/// Stamps events on neighbourhoods of `ROWS` rows, changing `N` bytes of each. An event's index in the padded plane is that of
/// the first pixel of its neighbourhood when the radius is the greatest.
struct Stamping<'a, T, const ROWS: u16, const N: usize> {
    stamp: T,
    width: u16,
    /// All bits of the bytes that are not of a row.
    outside: &'a [u8; N],
}

impl<T, const ROWS: u16, const N: usize> Stamping<'_, T, ROWS, N> {
    const RADIUS: usize = ROWS as usize / 2;

    /// What lies between two pixels, of which one is that many rows and columns further.
    #[inline(always)]
    fn diagonal(&self, pixels: usize) -> usize {
        pixels * (usize::from(self.width) + 1)
    }
}

impl<T: Stamp, const ROWS: u16, const N: usize> Draw for Stamping<'_, T, ROWS, N> {
    type Pixel = u8;
    type Value = ();

    #[inline(always)]
    fn prepare(&self, _: Event, _: &mut u32) {}

    #[inline(always)]
    fn look_ahead(&self, out: &[u8], at: usize) {
        prefetch(out, at + self.diagonal(RADIUS_MAX.into()));
    }

    #[inline(always)]
    fn draw(&mut self, out: &mut [u8], at: usize, (): ()) {
        let start = at + self.diagonal(usize::from(RADIUS_MAX) - Self::RADIUS);
        let len = usize::from(ROWS) * usize::from(self.width);
        let Some(patch) = out.get_mut(start..).and_then(|patch| patch.get_mut(..len)) else { return };
        let Some(own) = patch.get(self.diagonal(Self::RADIUS)) else { return };
        let columns = self.outside.map(
            #[inline(always)]
            |outside| self.stamp.column(outside, *own),
        );
        change_rows::<ROWS, N>(
            patch,
            self.width,
            #[inline(always)]
            |row| {
                for (value, column) in row.iter_mut().zip(&columns) {
                    *value = self.stamp.around(*value, *column);
                }
            },
        );
        if let Some(own) = patch.get_mut(self.diagonal(Self::RADIUS)) {
            *own = self.stamp.own();
        }
    }
}
