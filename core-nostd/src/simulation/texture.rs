//! The still part of the scene: a picture of log intensity, larger than the sensor, over which the camera moves.

use crate::Geometry;
use crate::random::Random;
use alloc::vec;
use alloc::vec::Vec;

/// One unit of natural logarithm, in the fixed point of all log intensities here.
pub(super) const LOG_ONE: i32 = 1024;

/// How far the camera moves from its middle, in pixels.
pub(super) const RADIUS_PX: i32 = 16;

/// What the picture is larger by on each side: the motion, and a pixel for interpolation.
const MARGIN_PX: i32 = RADIUS_PX + 2;

/// Fraction of a pixel in which the camera moves.
pub(super) const SUBPIXEL: i32 = 256;

/// Log intensity on a grid of pixels, row-major.
pub(super) struct Texture {
    width: usize,
    levels: Vec<i16>,
}

impl Texture {
    /// A gentle slope with a fine grain, too weak for events of its own, and `shapes` bars and discs of good contrast on it.
    pub(super) fn new(geometry: Geometry, shapes: u32, random: &mut Random) -> Self {
        let width = geometry.width as usize + 2 * MARGIN_PX as usize;
        let height = geometry.height as usize + 2 * MARGIN_PX as usize;
        let mut texture = Self { width, levels: vec![0; width * height] };
        texture.slope_and_grain(random);
        for _ in 0..shapes {
            let shape = Shape::random(width as i32, height as i32, random);
            texture.draw(&shape);
        }
        texture
    }

    fn slope_and_grain(&mut self, random: &mut Random) {
        for (y, row) in self.levels.chunks_exact_mut(self.width.max(1)).enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                *level = (x / 16 + y / 8) as i16 + random.between(-4, 4) as i16;
            }
        }
    }

    fn draw(&mut self, shape: &Shape) {
        let rows = self.levels.chunks_exact_mut(self.width.max(1)).enumerate();
        for (y, row) in rows.skip(shape.top().max(0) as usize).take(shape.rows()) {
            let columns = row.iter_mut().enumerate();
            for (x, level) in columns.skip(shape.left().max(0) as usize).take(shape.columns()) {
                let coverage = shape.coverage((x as i32) * SUBPIXEL, (y as i32) * SUBPIXEL);
                *level = (*level as i32 + ((shape.contrast * coverage) >> 8)) as i16;
            }
        }
    }

    /// Writes row `y` of what the sensor sees, the camera being `dx`, `dy` (in [`SUBPIXEL`]s) off its middle.
    pub(super) fn render_row(&self, y: usize, dx: i32, dy: i32, out: &mut [i16]) {
        let (x0, wx) = split(dx);
        let (y0, wy) = split(dy);
        let start = (y + y0) * self.width + x0;
        let upper = self.levels.get(start..).unwrap_or_default();
        let lower = self.levels.get(start + self.width..).unwrap_or_default();
        let upper = upper.iter().zip(upper.get(1..).unwrap_or_default());
        let lower = lower.iter().zip(lower.get(1..).unwrap_or_default());
        for (out, ((a, b), (c, d))) in out.iter_mut().zip(upper.zip(lower)) {
            let top = (*a as i32) * (SUBPIXEL - wx) + (*b as i32) * wx;
            let bottom = (*c as i32) * (SUBPIXEL - wx) + (*d as i32) * wx;
            *out = ((top * (SUBPIXEL - wy) + bottom * wy) >> 16) as i16;
        }
    }
}

/// Whole pixels from the picture's corner, and the rest.
const fn split(offset: i32) -> (usize, i32) {
    let offset = offset + MARGIN_PX * SUBPIXEL;
    ((offset / SUBPIXEL) as usize, offset % SUBPIXEL)
}

/// What a shape is filled with, and how it ends.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Disc,
    Bar,
    /// A bar of vertical stripes, [`STRIPE_PX`] wide.
    Stripes,
}

const STRIPE_PX: i32 = 8;

/// A patch of the scene; lengths in [`SUBPIXEL`]s.
pub(super) struct Shape {
    pub(super) x: i32,
    pub(super) y: i32,
    pub(super) half_width: i32,
    pub(super) half_height: i32,
    pub(super) kind: Kind,
    /// Log intensity over what is behind it.
    pub(super) contrast: i32,
}

impl Shape {
    fn random(width: i32, height: i32, random: &mut Random) -> Self {
        let kind = [Kind::Disc, Kind::Bar, Kind::Stripes]
            .get(random.below(3) as usize)
            .copied()
            .unwrap_or(Kind::Bar);
        let half_width = random.between(6, 36) * SUBPIXEL;
        Self {
            x: random.between(0, width) * SUBPIXEL,
            y: random.between(0, height) * SUBPIXEL,
            half_width,
            half_height: if kind == Kind::Disc { half_width } else { random.between(6, 36) * SUBPIXEL },
            kind,
            contrast: random_contrast(random),
        }
    }

    /// How much of the pixel it covers, 0 to 256, with edges 2 pixels soft.
    pub(super) const fn coverage(&self, x: i32, y: i32) -> i32 {
        let (dx, dy) = ((x - self.x).abs(), (y - self.y).abs());
        if matches!(self.kind, Kind::Disc) {
            // (r² - d²) / 2r is the distance from the edge to first order, and needs no root.
            let r = self.half_width as i64;
            let d2 = (dx as i64) * (dx as i64) + (dy as i64) * (dy as i64);
            let inside = (r * r - d2) / (2 * if r > 0 { r } else { 1 });
            return soft(if inside > 4096 {
                4096
            } else if inside < -4096 {
                -4096
            } else {
                inside as i32
            });
        }
        let bar = (soft(self.half_width - dx) * soft(self.half_height - dy)) >> 8;
        if matches!(self.kind, Kind::Bar) { bar } else { (bar * stripe(x - self.x)) >> 8 }
    }

    pub(super) const fn top(&self) -> i32 {
        (self.y - self.half_height) / SUBPIXEL - 2
    }

    pub(super) const fn left(&self) -> i32 {
        (self.x - self.half_width) / SUBPIXEL - 2
    }

    /// Rows and columns from [`top`](Self::top) and [`left`](Self::left) on, if these are not negative.
    pub(super) fn rows(&self) -> usize {
        let bottom = (self.y + self.half_height) / SUBPIXEL + 3;
        (bottom - self.top().max(0)).max(0) as usize
    }

    pub(super) fn columns(&self) -> usize {
        let right = (self.x + self.half_width) / SUBPIXEL + 3;
        (right - self.left().max(0)).max(0) as usize
    }
}

/// A signed distance from an edge, inside positive, as coverage.
const fn soft(inside: i32) -> i32 {
    let half = inside / 2 + 128;
    if half < 0 {
        0
    } else if half > 256 {
        256
    } else {
        half
    }
}

/// A stripe's part of the pixel at `x`, 0 to 256.
const fn stripe(x: i32) -> i32 {
    let half = STRIPE_PX * SUBPIXEL / 2;
    let from_middle = (x.rem_euclid(4 * half) - 2 * half).abs();
    soft(half - from_middle)
}

/// Darker or brighter by a factor of 1.5 to 3.
pub(super) const fn random_contrast(random: &mut Random) -> i32 {
    let contrast = random.between(LOG_ONE * 4 / 10, LOG_ONE * 11 / 10);
    if random.below(2) == 0 { contrast } else { -contrast }
}
