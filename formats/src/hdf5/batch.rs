//! The hot loops: columns of numbers into events, where all of a batch are as they should be.
//!
//! No loop has a branch; what is wrong with any number is gathered and looked at once. Columns of the types that nearly
//! all files have go through one loop for all four: 0.5 ns an event with AVX2, 1.0 without (Sapphire Rapids, 2026-11).
//! Others go through a loop each.

use super::datatype::NumberKind;
use lobula_core::vector::in_order;
use lobula_core::{Event, Geometry, Sink, full_time};

/// Most rows of a batch: what is between the loops stays in the nearest cache.
pub(super) const ROWS: usize = 1024;

/// One column of the rows of a batch, little-endian.
#[derive(Clone, Copy, Debug)]
pub(super) struct Column<'a> {
    pub kind: NumberKind,
    /// Starts with the first row.
    pub bytes: &'a [u8],
    /// From one row to the next.
    pub stride: usize,
    /// Of the number in its row.
    pub offset: usize,
}

/// The columns of a batch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows<'a> {
    /// At most [`ROWS`].
    pub count: usize,
    pub t: Column<'a>,
    pub x: Column<'a>,
    pub y: Column<'a>,
    pub p: Column<'a>,
    /// µs of one unit of a time that is a floating point number.
    pub scale: f64,
    /// What is added to every time, in µs.
    pub shift: i64,
}

/// Memory between the loops.
#[derive(Debug)]
pub(super) struct Between {
    t: [u32; ROWS],
    x: [u16; ROWS],
    y: [u16; ROWS],
    on: [u16; ROWS],
}

impl Default for Between {
    fn default() -> Self {
        Self { t: [0; ROWS], x: [0; ROWS], y: [0; ROWS], on: [0; ROWS] }
    }
}

/// Puts the events of a batch into the sink, if they fit and every one is on the sensor, has a polarity, and a time
/// near `first`, that of the first of the batch. Else nothing is done.
pub(super) fn push(
    rows: &Rows<'_>,
    first: u64,
    geometry: Geometry,
    between: &mut Between,
    sink: &mut Sink<'_>,
) -> Option<()> {
    let count = rows.count;
    let anchor = if sink.is_empty() { first } else { sink.t_first() };
    let out: &mut [[u32; 2]] = bytemuck::cast_slice_mut::<Event, _>(sink.spare().get_mut(..count)?);
    if usual(rows, anchor, geometry, out).is_none() {
        any(rows, anchor, geometry, between, out)?;
    }
    let last = out.last()?[0];
    sink.commit(count, first, full_time(anchor, last));
    Some(())
}

/// Times this near are surely admitted; a power of two.
const NEAR_US: u64 = 1 << 30;

/// Columns of the types that nearly all files have, if that is what they are.
fn usual(rows: &Rows<'_>, anchor: u64, geometry: Geometry, out: &mut [[u32; 2]]) -> Option<()> {
    let Rows { count, t, x, y, p, .. } = *rows;
    let (x, y) = (Coordinate::new(x, count, geometry.width)?, Coordinate::new(y, count, geometry.height)?);
    let p = matches!(p.kind, NumberKind::U8 | NumberKind::I8).then(|| p.plain(count))??;
    let origin = Origin::new(anchor, rows.shift)?;
    let is_sound = match t.kind {
        NumberKind::I64 | NumberKind::U64 => {
            let t = t.plain(count)?;
            in_order(
                #[inline(always)]
                || together(t, u64::from_le_bytes, (x, y), p, origin, out),
            )
        }
        NumberKind::U32 => {
            let t = t.plain(count)?;
            in_order(
                #[inline(always)]
                || together(t, |t| u32::from_le_bytes(t).into(), (x, y), p, origin, out),
            )
        }
        _ => return None,
    };
    is_sound.then_some(())
}

/// A column of coordinates of two bytes.
#[derive(Clone, Copy)]
struct Coordinate<'a> {
    column: &'a [[u8; 2]],
    /// The first that is off the sensor; not 0.
    end: u16,
}

impl<'a> Coordinate<'a> {
    fn new(column: Column<'a>, count: usize, side: u16) -> Option<Self> {
        let end = match column.kind {
            NumberKind::U16 => side,
            // Negative ones are beyond it.
            NumberKind::I16 => side.min(1 << 15),
            _ => return None,
        };
        Some(Self { column: column.plain(count)?, end })
    }
}

/// Times that a batch may have, before and after the shift.
#[derive(Clone, Copy)]
struct Origin {
    /// The earliest, as the file tells it.
    told: u64,
    /// What is added, modulo 2^32.
    shift: u32,
}

impl Origin {
    /// Where all of twice [`NEAR_US`] from the earliest on are times, and near the anchor.
    fn new(anchor: u64, shift: i64) -> Option<Self> {
        let anchor = i64::try_from(anchor).ok()?;
        let earliest = anchor.checked_sub(NEAR_US as i64)?.max(shift).max(0);
        let told = earliest.checked_sub(shift)?;
        let span = 2 * NEAR_US as i64;
        let is_near =
            earliest <= anchor && earliest.checked_add(span).is_some() && told.checked_add(span).is_some();
        is_near.then_some(Self { told: told as u64, shift: shift as u32 })
    }
}

/// All columns in one loop; false where any number is not as it should be.
#[inline(always)]
fn together<const BYTES: usize>(
    t: &[[u8; BYTES]],
    time: impl Fn([u8; BYTES]) -> u64,
    (x, y): (Coordinate<'_>, Coordinate<'_>),
    p: &[[u8; 1]],
    origin: Origin,
    out: &mut [[u32; 2]],
) -> bool {
    let (mut far, mut x_most, mut y_most, mut any) = (0, 0, 0, 0);
    for ((((out, t), x_of), y_of), [on]) in out.iter_mut().zip(t).zip(x.column).zip(y.column).zip(p) {
        let (told, x, y) = (time(*t), u16::from_le_bytes(*x_of), u16::from_le_bytes(*y_of));
        far |= told.wrapping_sub(origin.told);
        x_most = x_most.max(x);
        y_most = y_most.max(y);
        any |= *on;
        let y_on = y | u16::from(*on) << 15;
        *out = [(told as u32).wrapping_add(origin.shift), u32::from(x) | u32::from(y_on) << 16];
    }
    far < 2 * NEAR_US && x_most < x.end && y_most < y.end && any <= 1
}

/// Columns of any types.
fn any(
    rows: &Rows<'_>,
    anchor: u64,
    geometry: Geometry,
    between: &mut Between,
    out: &mut [[u32; 2]],
) -> Option<()> {
    let count = out.len();
    let times = Times { scale: rows.scale, shift: rows.shift, anchor, out: between.t.get_mut(..count)? };
    rows.t.work(times)?;
    let x = rows.x.work(Coordinates { out: between.x.get_mut(..count)? });
    let y = rows.y.work(Coordinates { out: between.y.get_mut(..count)? });
    let on = rows.p.work(Polarities { out: between.on.get_mut(..count)? });
    if x >= geometry.width || y >= geometry.height || on > 1 {
        return None;
    }
    let (t, x, y, on) = (&between.t[..count], &between.x[..count], &between.y[..count], &between.on[..count]);
    for ((((out, t), x), y), on) in out.iter_mut().zip(t).zip(x).zip(y).zip(on) {
        *out = [*t, u32::from(*x) | u32::from(*y | *on << 15) << 16];
    }
    Some(())
}

/// The least and the largest of whole numbers.
pub(super) fn extent(column: Column<'_>) -> Option<(i64, i64)> {
    column.work(Extent)
}

/// A number of a column.
trait Element: Copy {
    /// As µs; negative where it is, or where that cannot be told without a branch.
    fn time(self, scale: f64) -> i64;
    /// The largest where it is none that can be on a sensor.
    fn coordinate(self) -> u16;
    /// 1 for ON, 0 for OFF, more where it is neither.
    fn on(self) -> u16;
}

macro_rules! integers {
    ($($int:ty: $min:expr;)*) => {
        $(impl Element for $int {
            #[inline(always)]
            fn time(self, _: f64) -> i64 {
                self as i64
            }

            #[inline(always)]
            fn coordinate(self) -> u16 {
                // Negative ones become the largest there are.
                #[allow(clippy::unnecessary_cast)]
                let coordinate = if self < 0 as $int { u16::MAX } else { $min(self) };
                coordinate
            }

            #[inline(always)]
            fn on(self) -> u16 {
                let minus_one = (0 as $int).wrapping_sub(1);
                // Unsigned 255 is no -1.
                let is_minus_one = minus_one < 0 as $int && self == minus_one;
                if is_minus_one { 0 } else { $min(self) | u16::from(self < 0 as $int) << 1 }
            }
        })*
    };
}

#[allow(unused_comparisons)] // for unsigned ones
mod integers {
    use super::Element;

    integers! {
        u8: |value: u8| u16::from(value);
        i8: |value: i8| value as u16;
        u16: |value: u16| value;
        i16: |value: i16| value as u16;
        u32: |value: u32| value.min(0xFFFF) as u16;
        i32: |value: i32| (value as u32).min(0xFFFF) as u16;
        u64: |value: u64| value.min(0xFFFF) as u16;
        i64: |value: i64| (value as u64).min(0xFFFF) as u16;
    }
}

impl Element for f64 {
    #[inline(always)]
    fn time(self, scale: f64) -> i64 {
        /// 1.5 * 2^52: a number near it has its last bit at 1, so that adding it rounds to the nearest whole.
        const ROUND: f64 = 6_755_399_441_055_744.0;
        let us = self * scale;
        let rounded = (us + ROUND).to_bits().wrapping_sub(ROUND.to_bits()) as i64;
        // Not a number fails too.
        if us.abs() < (1u64 << 51) as f64 { rounded } else { -1 }
    }

    #[inline(always)]
    fn coordinate(self) -> u16 {
        let whole = self as i32;
        if f64::from(whole) == self && whole >= 0 { (whole as u32).min(0xFFFF) as u16 } else { u16::MAX }
    }

    #[inline(always)]
    fn on(self) -> u16 {
        let on = if self == 1.0 { 1 } else { 2 };
        if self == 0.0 || self == -1.0 { 0 } else { on }
    }
}

impl Element for f32 {
    #[inline(always)]
    fn time(self, scale: f64) -> i64 {
        f64::from(self).time(scale)
    }

    #[inline(always)]
    fn coordinate(self) -> u16 {
        f64::from(self).coordinate()
    }

    #[inline(always)]
    fn on(self) -> u16 {
        f64::from(self).on()
    }
}

/// What is done with the numbers of a column.
trait Work {
    type Done;
    fn work<T: Element>(self, numbers: impl Iterator<Item = T>) -> Self::Done;
}

impl<'a> Column<'a> {
    /// The first `count` numbers, where they are one after the other and of this many bytes.
    fn plain<const BYTES: usize>(&self, count: usize) -> Option<&'a [[u8; BYTES]]> {
        let numbers = (self.stride == BYTES).then_some(self.bytes.as_chunks().0);
        numbers.and_then(|numbers| numbers.get(..count))
    }

    #[inline]
    fn work<W: Work>(self, work: W) -> W::Done {
        match self.kind {
            NumberKind::U8 => self.numbers::<1, _, _>(work, u8::from_le_bytes),
            NumberKind::I8 => self.numbers::<1, _, _>(work, i8::from_le_bytes),
            NumberKind::U16 => self.numbers::<2, _, _>(work, u16::from_le_bytes),
            NumberKind::I16 => self.numbers::<2, _, _>(work, i16::from_le_bytes),
            NumberKind::U32 => self.numbers::<4, _, _>(work, u32::from_le_bytes),
            NumberKind::I32 => self.numbers::<4, _, _>(work, i32::from_le_bytes),
            NumberKind::U64 => self.numbers::<8, _, _>(work, u64::from_le_bytes),
            NumberKind::I64 => self.numbers::<8, _, _>(work, i64::from_le_bytes),
            NumberKind::F32 => self.numbers::<4, _, _>(work, f32::from_le_bytes),
            NumberKind::F64 => self.numbers::<8, _, _>(work, f64::from_le_bytes),
        }
    }

    #[inline]
    fn numbers<const BYTES: usize, T: Element, W: Work>(
        self,
        work: W,
        number: impl Fn([u8; BYTES]) -> T,
    ) -> W::Done {
        if self.stride == BYTES {
            work.work(self.bytes.as_chunks::<BYTES>().0.iter().map(|bytes| number(*bytes)))
        } else {
            let rows = self.bytes.chunks_exact(self.stride.max(1));
            let in_row = |row: &[u8]| row.get(self.offset..).and_then(|row| row.first_chunk()).copied();
            work.work(rows.map(|row| number(in_row(row).unwrap_or([0; BYTES]))))
        }
    }
}

/// Times modulo 2^32, if none is negative and all are within 2^30 µs of the anchor.
struct Times<'a> {
    scale: f64,
    shift: i64,
    anchor: u64,
    out: &'a mut [u32],
}

impl Work for Times<'_> {
    type Done = Option<()>;

    #[inline(always)]
    fn work<T: Element>(self, numbers: impl Iterator<Item = T>) -> Option<()> {
        let (mut any, mut far) = (0, 0);
        for (out, number) in self.out.iter_mut().zip(numbers) {
            let told = number.time(self.scale);
            let t = told.wrapping_add(self.shift);
            any |= told | t;
            far |= (t as u64).wrapping_sub(self.anchor).wrapping_add(NEAR_US);
            *out = t as u32;
        }
        (any >= 0 && far < 2 * NEAR_US).then_some(())
    }
}

/// The least and the largest number.
struct Extent;

impl Work for Extent {
    type Done = Option<(i64, i64)>;

    #[inline(always)]
    fn work<T: Element>(self, numbers: impl Iterator<Item = T>) -> Option<(i64, i64)> {
        numbers.map(|number| number.time(1.0)).fold(None, |extent, t| {
            let (least, most) = extent.unwrap_or((t, t));
            Some((least.min(t), most.max(t)))
        })
    }
}

/// Coordinates; the largest of them.
struct Coordinates<'a> {
    out: &'a mut [u16],
}

impl Work for Coordinates<'_> {
    type Done = u16;

    #[inline(always)]
    fn work<T: Element>(self, numbers: impl Iterator<Item = T>) -> u16 {
        let mut most = 0;
        for (out, number) in self.out.iter_mut().zip(numbers) {
            *out = number.coordinate();
            most = most.max(*out);
        }
        most
    }
}

/// Polarities; more than 1 where any is none.
struct Polarities<'a> {
    out: &'a mut [u16],
}

impl Work for Polarities<'_> {
    type Done = u16;

    #[inline(always)]
    fn work<T: Element>(self, numbers: impl Iterator<Item = T>) -> u16 {
        let mut any = 0;
        for (out, number) in self.out.iter_mut().zip(numbers) {
            *out = number.on();
            any |= *out;
        }
        any
    }
}
