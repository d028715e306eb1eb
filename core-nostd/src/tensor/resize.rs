//! Tensors of another height and width, plane by plane.
//!
//! Pixels are squares and their centres lie at halves: an output pixel's centre `(o + 0.5) * from / to` is where it
//! is looked up, and what it covers is `[o * from / to, (o + 1) * from / to)`. All of it is counted in whole numbers,
//! so that no position is ever rounded.

use core::num::NonZeroU32;

use crate::Shape;
use crate::tensor::{BadTensor, Element, check};
use crate::vector::widest;

/// How an output pixel comes of input pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Method {
    /// The pixel that its centre lies on. PyTorch's `nearest-exact`, Pillow's `NEAREST`.
    Nearest,
    /// The four pixels around its centre, the nearer the more; at the border the outermost goes on. PyTorch's
    /// `bilinear` with `align_corners=False` and no antialiasing. To make a tensor much smaller take [`Area`](Self::Area).
    Bilinear,
    /// The mean of what it covers, each pixel by the covered part of it. OpenCV's `INTER_AREA` for smaller tensors;
    /// where the sides divide, the mean of a block of pixels.
    Area,
}

/// Extent of a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Size {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

/// Makes tensors of one shape another size.
///
/// Each value is worked out in f32 and becomes the nearest of the output's type, ties to even.
///
/// ```
/// use lobula_core::Shape;
/// use lobula_core::tensor::{Method, Resize, Size};
/// let shape = Shape { channels: 1, height: 1, width: 2 };
/// let resize = Resize::try_new(shape, Size { height: 1, width: 4 }, Method::Bilinear)?;
/// let mut out = [0.0f32; 4];
/// resize.apply(&[0u8, 8], &mut out)?;
/// assert_eq!(out, [0.0, 2.0, 6.0, 8.0]);
/// # Ok::<(), lobula_core::tensor::BadTensor>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resize {
    from: Shape,
    rows: Axis,
    columns: Axis,
    method: Method,
}

impl Resize {
    /// The longest side, of either tensor.
    pub const SIDE_MAX: usize = 1 << 16;

    /// For tensors of shape `from`; all sides are 1 to [`SIDE_MAX`](Self::SIDE_MAX).
    pub fn try_new(from: Shape, to: Size, method: Method) -> Result<Self, BadTensor> {
        let rows = Axis::try_new(from.height, to.height)?;
        let columns = Axis::try_new(from.width, to.width)?;
        Ok(Self { from, rows, columns, method })
    }

    /// Extent of what comes out.
    pub const fn shape(&self) -> Shape {
        Shape {
            channels: self.from.channels,
            height: self.rows.to.get() as usize,
            width: self.columns.to.get() as usize,
        }
    }

    /// Fills `output` from `input`.
    pub fn apply<I: Element, O: Element>(&self, input: &[I], output: &mut [O]) -> Result<(), BadTensor> {
        check(self.from.len(), input.len())?;
        check(self.shape().len(), output.len())?;
        let (width, to) = (self.from.width.max(1), self.shape());
        let planes = input.chunks((width * self.from.height).max(1));
        for (input, output) in planes.zip(output.chunks_mut((to.height * to.width).max(1))) {
            let plane = Plane { elements: input, width };
            widest(
                #[inline(always)]
                || match self.method {
                    Method::Nearest => self.nearest(plane, output),
                    Method::Bilinear => self.bilinear(plane, output),
                    Method::Area => self.area(plane, output),
                },
            );
        }
        Ok(())
    }

    #[inline(always)]
    fn nearest<I: Element, O: Element>(&self, input: Plane<'_, I>, output: &mut [O]) {
        for (out, y) in output.chunks_mut(self.columns.len().max(1)).zip(self.rows.centres()) {
            let row = input.row(y);
            for (pixel, x) in out.iter_mut().zip(self.columns.centres()) {
                *pixel = O::from_real(at(row, x));
            }
        }
    }

    #[inline(always)]
    fn bilinear<I: Element, O: Element>(&self, input: Plane<'_, I>, output: &mut [O]) {
        for (out, (y, down)) in output.chunks_mut(self.columns.len().max(1)).zip(self.rows.pairs()) {
            let upper = input.row(y);
            let lower = if y + 1 < self.rows.from as usize { input.row(y + 1) } else { upper };
            for (pixel, (x, right)) in out.iter_mut().zip(self.columns.pairs()) {
                let next = (x + 1).min(self.columns.from as usize - 1);
                let mix = |row| between(at(row, x), at(row, next), right);
                *pixel = O::from_real(between(mix(upper), mix(lower), down));
            }
        }
    }

    #[inline(always)]
    fn area<I: Element, O: Element>(&self, input: Plane<'_, I>, output: &mut [O]) {
        let share = self.rows.shrinkage() * self.columns.shrinkage();
        for (out, rows) in output.chunks_mut(self.columns.len().max(1)).zip(self.rows.covers()) {
            let mut columns = self.columns.covers();
            let mut from = 0;
            for tile in out.chunks_mut(TILE) {
                let mut sums = [0.0; TILE];
                let sums = sums.get_mut(..tile.len()).unwrap_or_default();
                let start = columns.clone();
                for (y, weight) in rows.pixels() {
                    let row = input.row(y);
                    columns = start.clone();
                    match (self.columns.factor(), row.get(from..)) {
                        (Some(2), Some(row)) => add_blocks::<2, I>(row, weight, sums),
                        (Some(3), Some(row)) => add_blocks::<3, I>(row, weight, sums),
                        (Some(4), Some(row)) => add_blocks::<4, I>(row, weight, sums),
                        _ => add_covers(row, weight, &mut columns, sums),
                    }
                }
                if let Some(factor) = self.columns.factor().filter(|factor| (2..=4).contains(factor)) {
                    from += TILE * factor as usize;
                }
                for (pixel, sum) in tile.iter_mut().zip(sums) {
                    *pixel = O::from_real(*sum * share);
                }
            }
        }
    }
}

/// Output pixels whose sums are in hand at once.
const TILE: usize = 64;

/// Adds to each sum the sum of its pixels in a row, by the row's weight.
#[inline(always)]
fn add_covers<I: Element>(row: &[I], weight: f32, covers: &mut Covers, sums: &mut [f32]) {
    for (sum, cover) in sums.iter_mut().zip(covers) {
        *sum += weight * cover.pixels().fold(0.0, |sum, (x, part)| sum + part * at(row, x));
    }
}

/// The same where each pixel covers `N` whole ones: no position to work out, and vectors.
#[inline(always)]
fn add_blocks<const N: usize, I: Element>(row: &[I], weight: f32, sums: &mut [f32]) {
    for (sum, block) in sums.iter_mut().zip(row.as_chunks::<N>().0) {
        *sum += weight * block.iter().fold(0.0, |sum, element| sum + element.real());
    }
}

/// A plane of a tensor.
#[derive(Clone, Copy)]
struct Plane<'a, I> {
    elements: &'a [I],
    width: usize,
}

impl<'a, I> Plane<'a, I> {
    #[inline(always)]
    fn row(self, y: usize) -> &'a [I] {
        let start = y * self.width;
        self.elements.get(start..start + self.width).unwrap_or_default()
    }
}

/// The element at `x`, which is there.
#[inline(always)]
fn at<I: Element>(row: &[I], x: usize) -> f32 {
    row.get(x).map_or(0.0, |element| element.real())
}

#[inline(always)]
fn between(low: f32, high: f32, share: f32) -> f32 {
    low + (high - low) * share
}

/// One direction: `from` pixels become `to`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Axis {
    from: u32,
    to: NonZeroU32,
}

impl Axis {
    fn try_new(from: usize, to: usize) -> Result<Self, BadTensor> {
        let side = |found: usize| {
            let side = u32::try_from(found).ok().filter(|side| *side as usize <= Resize::SIDE_MAX);
            side.and_then(NonZeroU32::new).ok_or(BadTensor::Side { found })
        };
        Ok(Self { from: side(from)?.get(), to: side(to)? })
    }

    #[inline(always)]
    fn len(self) -> usize {
        self.to.get() as usize
    }

    /// Output pixels for one input pixel.
    fn shrinkage(self) -> f32 {
        self.to.get() as f32 / self.from as f32
    }

    /// How many whole pixels an output pixel covers, if they are whole.
    #[inline(always)]
    fn factor(self) -> Option<u32> {
        (self.from % self.to == 0).then(|| self.from / self.to)
    }

    /// The pixel under each output pixel's centre.
    #[inline(always)]
    fn centres(self) -> impl Iterator<Item = usize> {
        Walk::new(self.from, 2 * self.from, self.double()).map(|(at, _)| at)
    }

    /// The pixel whose centre lies at or before each output pixel's centre, and how far that is.
    #[inline(always)]
    fn pairs(self) -> impl Iterator<Item = (usize, f32)> {
        // A pixel further than it is: before the first centre there is none to come from.
        let walk = Walk::new(self.from + self.to.get(), 2 * self.from, self.double());
        let unit = self.double().get() as f32;
        walk.map(move |(ahead, part)| ahead.checked_sub(1).map_or((0, 0.0), |low| (low, part as f32 / unit)))
    }

    /// Half pixels of the output.
    #[inline(always)]
    fn double(self) -> NonZeroU32 {
        self.to.saturating_add(self.to.get())
    }

    /// What each output pixel covers.
    #[inline(always)]
    fn covers(self) -> Covers {
        let mut edges = Walk::new(0, self.from, self.to);
        let (start, past) = edges.next().unwrap_or_default();
        Covers { edges, start, past, unit: self.to.get() }
    }
}

/// Positions at equal distances, each a whole number and parts of one. Endless.
#[derive(Clone)]
struct Walk {
    whole: u32,
    part: u32,
    step_whole: u32,
    step_part: u32,
    unit: NonZeroU32,
}

impl Walk {
    /// From `start` by `step`, in parts of which `unit` are a whole.
    fn new(start: u32, step: u32, unit: NonZeroU32) -> Self {
        Self {
            whole: start / unit,
            part: start % unit,
            step_whole: step / unit,
            step_part: step % unit,
            unit,
        }
    }
}

impl Iterator for Walk {
    type Item = (usize, u32);

    #[inline(always)]
    fn next(&mut self) -> Option<(usize, u32)> {
        let item = (self.whole as usize, self.part);
        let part = self.part + self.step_part;
        let carry = part >= self.unit.get();
        self.part = if carry { part - self.unit.get() } else { part };
        self.whole = self.whole.wrapping_add(self.step_whole + u32::from(carry));
        Some(item)
    }
}

/// What output pixels cover, one after the other.
#[derive(Clone)]
struct Covers {
    edges: Walk,
    start: usize,
    past: u32,
    unit: u32,
}

impl Iterator for Covers {
    type Item = Cover;

    #[inline(always)]
    fn next(&mut self) -> Option<Cover> {
        let (end, into) = self.edges.next()?;
        let within = end == self.start;
        let first = if within { into } else { self.unit } - self.past;
        let last = if within { 0 } else { into };
        let share = |parts: u32| parts as f32 / self.unit as f32;
        let cover = Cover { start: self.start, end, first: share(first), last: share(last) };
        (self.start, self.past) = (end, into);
        Some(cover)
    }
}

/// The pixels that one output pixel covers: a part of the first, whole ones, and a part of that at `end`.
#[derive(Clone, Copy)]
struct Cover {
    start: usize,
    end: usize,
    first: f32,
    last: f32,
}

impl Cover {
    /// Each pixel of which a part is covered, and that part.
    #[inline(always)]
    fn pixels(self) -> impl Iterator<Item = (usize, f32)> {
        let inner = (self.start + 1..self.end).map(|at| (at, 1.0));
        let last = Some((self.end, self.last)).filter(|(_, part)| *part > 0.0);
        core::iter::once((self.start, self.first)).chain(inner).chain(last)
    }
}
