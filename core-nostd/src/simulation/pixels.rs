//! The pixels of the sensor: an event for each threshold that log intensity crosses.

use super::object::{Object, TURN, scaled, sine};
use super::texture::{LOG_ONE, RADIUS_PX, SUBPIXEL, Texture};
use crate::random::Random;
use crate::{Geometry, Polarity};
use alloc::vec;
use alloc::vec::Vec;

/// Contrast threshold of a pixel, and by how much one pixel's may differ from another's.
const THRESHOLD: i32 = LOG_ONE / 5;
const MISMATCH: i32 = THRESHOLD / 25;

/// Frames of a loop: the camera moves at most 0.7 pixels in one.
pub(super) const FRAMES: u32 = 192;

/// Frames that the loop is run with once before, so that the pixels' memory closes like the scene does.
const FRAMES_BEFORE: u32 = FRAMES / 4;

/// Units of time between two frames, in which crossings are interpolated.
pub(super) const TICKS: u32 = 1 << 16;

/// A threshold crossed.
#[derive(Clone, Copy)]
pub(super) struct Crossing {
    /// When, in [`TICKS`] from the start of the loop.
    pub(super) ticks: u32,
    pub(super) x: u16,
    pub(super) y: u16,
    pub(super) polarity: Polarity,
}

/// Pixels that are looked at together: in most groups nothing happens, and a few vector instructions tell.
const GROUP: usize = 32;

/// What moves before the sensor, and what each pixel remembers, row-major.
pub(super) struct Pixels {
    width: usize,
    texture: Texture,
    objects: Vec<Object>,
    /// Log intensity in the frame before.
    before: Vec<i16>,
    /// Log intensity at the last event.
    reference: Vec<i16>,
    /// How far from the reference the next event is.
    threshold: Vec<i16>,
    /// How far the reference is from the level at the start.
    offset: Vec<i16>,
}

impl Pixels {
    pub(super) fn new(
        geometry: Geometry,
        texture: Texture,
        objects: Vec<Object>,
        random: &mut Random,
    ) -> Self {
        let pixels = geometry.pixels();
        let threshold =
            (0..pixels).map(|_| random.between(THRESHOLD - MISMATCH, THRESHOLD + MISMATCH) as i16);
        let threshold: Vec<i16> = threshold.collect();
        let offset = threshold.iter().map(|threshold| {
            let most = *threshold as i32 - 1;
            random.between(-most, most) as i16
        });
        let offset = offset.collect();
        Self {
            offset,
            width: (geometry.width as usize).max(1),
            texture,
            objects,
            before: vec![0; pixels],
            reference: vec![0; pixels],
            threshold,
        }
    }

    /// The crossings of one loop, frame after frame.
    pub(super) fn run(&mut self) -> Vec<Crossing> {
        self.frame(0, &mut Vec::new());
        // Any offset within the threshold: were it none, each pixel would fire late and alone, when an edge that has
        // passed gives back the very level from before.
        for ((reference, level), offset) in self.reference.iter_mut().zip(&self.before).zip(&self.offset) {
            *reference = level.wrapping_add(*offset);
        }
        for frame in 1..=FRAMES_BEFORE {
            self.frame(frame * (FRAMES / FRAMES_BEFORE), &mut Vec::new());
        }
        let mut crossings = Vec::new();
        for frame in 1..=FRAMES {
            self.frame(frame, &mut crossings);
        }
        crossings
    }

    /// Renders a frame and shows it to each pixel.
    fn frame(&mut self, frame: u32, crossings: &mut Vec<Crossing>) {
        let turn = frame * TURN / FRAMES;
        let dx = scaled(sine(turn), RADIUS_PX * SUBPIXEL);
        let dy = scaled(sine(turn + TURN / 4), RADIUS_PX * SUBPIXEL);
        for object in &mut self.objects {
            object.move_to(turn);
        }
        let mut levels = vec![0; self.width];
        let rows = self.before.chunks_exact_mut(self.width).zip(self.reference.chunks_exact_mut(self.width));
        let rows = rows.zip(self.threshold.chunks_exact(self.width)).enumerate();
        for (y, ((before, reference), threshold)) in rows {
            self.texture.render_row(y, dx, dy, &mut levels);
            for object in &self.objects {
                object.draw_row(y, &mut levels);
            }
            let start = frame.saturating_sub(1) * TICKS;
            look_at_row(&levels, before, reference, threshold, |x, after, polarity| {
                crossings.push(Crossing { ticks: start + after, x, y: y as u16, polarity });
            });
            before.copy_from_slice(&levels);
        }
    }
}

/// Shows a row of a frame to its pixels and tells each crossing: column, [`TICKS`] after the frame before, direction.
fn look_at_row(
    levels: &[i16],
    before: &[i16],
    reference: &mut [i16],
    threshold: &[i16],
    mut tell: impl FnMut(u16, u32, Polarity),
) {
    let groups = levels.chunks(GROUP).zip(before.chunks(GROUP));
    let groups = groups.zip(reference.chunks_mut(GROUP).zip(threshold.chunks(GROUP)));
    for (group, ((levels, before), (reference, threshold))) in groups.enumerate() {
        let pixels = levels.iter().zip(&*reference).zip(threshold);
        let crossed = pixels.fold(false, |any, ((level, reference), threshold)| {
            any | (level.wrapping_sub(*reference).wrapping_abs() >= *threshold)
        });
        if !crossed {
            continue;
        }
        let pixels = levels.iter().zip(before).zip(reference.iter_mut().zip(threshold));
        for (i, ((level, before), (reference, threshold))) in pixels.enumerate() {
            let x = (group * GROUP + i) as u16;
            cross(*level, *before, reference, *threshold, |after, polarity| tell(x, after, polarity));
        }
    }
}

/// Goes from the level before to `level` and tells each threshold crossed on the way, with its time in [`TICKS`].
#[inline(always)]
fn cross(level: i16, before: i16, reference: &mut i16, threshold: i16, mut tell: impl FnMut(u32, Polarity)) {
    while level.wrapping_sub(*reference).wrapping_abs() >= threshold {
        let up = level > *reference;
        *reference = reference.wrapping_add(if up { threshold } else { -threshold });
        tell(ticks_to(*reference, before, level), if up { Polarity::On } else { Polarity::Off });
    }
}

/// When a level that goes evenly from `before` to `after` within [`TICKS`] reaches `level`.
const fn ticks_to(level: i16, before: i16, after: i16) -> u32 {
    let whole = (after as i32 - before as i32).unsigned_abs();
    let part = (level as i32 - before as i32).unsigned_abs();
    if part >= whole { TICKS - 1 } else { part * (TICKS - 1) / whole }
}
