//! The moving part of the scene: bars and discs on closed paths of their own, before the still part.

use super::texture::{Kind, SUBPIXEL, Shape, random_contrast};
use crate::Geometry;
use crate::random::Random;

/// A full turn of a path.
pub(super) const TURN: u32 = 1 << 16;

/// A bar or a disc and its path, an ellipse or an eight, once per loop.
pub(super) struct Object {
    middle: (i32, i32),
    amplitude: (i32, i32),
    phase: u32,
    /// Turns per loop up and down, for one from left to right.
    lobes: u32,
    shape: Shape,
}

impl Object {
    pub(super) fn random(geometry: Geometry, random: &mut Random) -> Self {
        let kind = if random.below(2) == 0 { Kind::Disc } else { Kind::Bar };
        let half_width = random.between(8, 24) * SUBPIXEL;
        Self {
            middle: (
                random.below(geometry.width as u32) as i32 * SUBPIXEL,
                random.below(geometry.height as u32) as i32 * SUBPIXEL,
            ),
            amplitude: (random.between(20, 60) * SUBPIXEL, random.between(10, 40) * SUBPIXEL),
            phase: random.below(TURN),
            lobes: random.between(1, 2) as u32,
            shape: Shape {
                x: 0,
                y: 0,
                half_width,
                half_height: if kind == Kind::Disc { half_width } else { random.between(8, 24) * SUBPIXEL },
                kind,
                contrast: random_contrast(random),
            },
        }
    }

    /// Moves it to where it is at `turn` of the loop.
    pub(super) const fn move_to(&mut self, turn: u32) {
        let turn = turn.wrapping_add(self.phase);
        self.shape.x = self.middle.0 + scaled(sine(turn), self.amplitude.0);
        self.shape.y =
            self.middle.1 + scaled(sine(turn.wrapping_mul(self.lobes) + TURN / 4), self.amplitude.1);
    }

    /// Draws its part of row `y` over what is there.
    pub(super) fn draw_row(&self, y: usize, row: &mut [i16]) {
        let shape = &self.shape;
        let top = shape.top().max(0) as usize;
        if y < top || y >= top + shape.rows() {
            return;
        }
        let columns = row.iter_mut().enumerate();
        for (x, level) in columns.skip(shape.left().max(0) as usize).take(shape.columns()) {
            let coverage = shape.coverage((x as i32) * SUBPIXEL, (y as i32) * SUBPIXEL);
            // It hides what is behind it: the level goes over to the object's own.
            *level = (*level as i32 + (((shape.contrast - *level as i32) * coverage) >> 8)) as i16;
        }
    }
}

/// A parabola's idea of a sine: `turn` modulo [`TURN`] to -32768..=32768.
pub(super) const fn sine(turn: u32) -> i32 {
    let turn = (turn % TURN) as i32;
    let x = turn % 32768;
    let half = (x * (32768 - x)) >> 13;
    if turn < 32768 { half } else { -half }
}

/// `amplitude` times a [`sine`].
pub(super) const fn scaled(sine: i32, amplitude: i32) -> i32 {
    ((sine as i64 * amplitude as i64) >> 15) as i32
}
