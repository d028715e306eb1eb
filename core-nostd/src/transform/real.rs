//! Pixels to real coordinates and back, in f64 by `+ - * /` alone: the same bits on every machine, in vectors too.

use super::TransformError;
use super::pixels::{X_MAX, Y_MAX, at, select, x_of, y_of};
use crate::{Block, Geometry, WrongGeometry};

/// 2^52: a whole number below it in the low bits of a float of this magnitude is that number added to it.
const WHOLE: f64 = 4_503_599_627_370_496.0;
/// 1.5 * 2^52: a float of this magnitude has no fraction, and none nearby is of another.
const NEAREST: f64 = 6_755_399_441_055_744.0;

/// Below this a number is rounded by [`nearest`].
pub(super) const REAL_MAX: u64 = 1 << 51;

/// A whole number below 2^52.
#[inline(always)]
pub(super) fn real(number: u64) -> f64 {
    f64::from_bits(number | WHOLE.to_bits()) - WHOLE
}

/// The whole number nearest to `value`, halves away from zero, for -0.5 < `value` < 2^51; anything else gives any.
#[inline(always)]
pub(super) fn nearest(value: f64) -> u64 {
    let shifted = value + NEAREST;
    let even = shifted - NEAREST;
    let whole = shifted.to_bits().wrapping_sub(NEAREST.to_bits());
    // Halves were rounded to the even one: those that went down go up.
    whole.wrapping_add((value - even == 0.5) as u64)
}

/// The event at the pixel nearest to (x, y), and whether it is on a sensor whose width and height are given less a half.
/// What is no number is off it.
#[inline(always)]
pub(super) fn place(word: u64, (x, y): (f64, f64), (x_end, y_end): (f64, f64)) -> (u64, bool) {
    let on = (x > -0.5) & (x < x_end) & (y > -0.5) & (y < y_end);
    // Off the sensor they may be anything, and must not reach into the bits beside them.
    (at(word, nearest(x) & X_MAX, nearest(y) & Y_MAX), on)
}

/// The event moved by (dx, dy), likewise.
#[inline(always)]
pub(crate) fn place_near(word: u64, (dx, dy): (f64, f64), geometry: Geometry) -> (u64, bool) {
    let (x, y) = (real(x_of(word)), real(y_of(word)));
    place(word, (x + dx, y + dy), ends(geometry))
}

/// Moves the events of a sensor's block to where `map` moves their pixels, and drops what leaves the sensor.
#[inline(always)]
pub(super) fn remap(
    block: &mut Block<'_>,
    geometry: Geometry,
    map: impl Fn(f64, f64) -> (f64, f64),
) -> Result<usize, WrongGeometry> {
    let ends = ends(geometry);
    select(
        block,
        geometry,
        geometry,
        #[inline(always)]
        move |word, _| place(word, map(real(x_of(word)), real(y_of(word))), ends),
    )
}

/// Refuses a matrix with an entry that is no finite number.
pub(super) fn check_matrix(rows: &[[f64; 3]]) -> Result<(), TransformError> {
    match rows.iter().flatten().all(|number| number.is_finite()) {
        true => Ok(()),
        false => Err(TransformError::NotFinite { key: "matrix" }),
    }
}

/// Half a pixel beyond the last column and row.
#[inline(always)]
pub(super) fn ends(geometry: Geometry) -> (f64, f64) {
    (real(geometry.width.into()) - 0.5, real(geometry.height.into()) - 0.5)
}

/// A time in µs, scaled and rounded; negative and what is no number is 0, too large the largest.
#[inline(always)]
pub(super) fn scaled(t: u64, factor: f64) -> u64 {
    let value = t as f64 * factor;
    let whole = value as u64;
    whole.saturating_add((value - whole as f64 >= 0.5) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_halves_away_from_zero_as_the_standard_library_does() {
        let mut check = |value: f64| {
            if value > -0.5 {
                assert_eq!(nearest(value), value.round() as u64, "{value:e}");
            }
        };
        for whole in [0.0, 1.0, 2.0, 3.0, 4.0, 1279.0, 1280.0, 65_535.0, 1e9] {
            for half in [whole - 0.5, whole, whole + 0.5f64] {
                let near = [half.next_down().next_down(), half.next_down(), half, half.next_up()];
                near.into_iter().for_each(&mut check);
            }
        }
        let mut state = 1u64;
        for _ in 0..100_000 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            check((state >> 33) as f64 / 65536.0 - 0.4);
        }
    }

    #[test]
    fn scaled_times_are_rounded_as_the_standard_library_does() {
        for t in [0, 1, 2, 3, 999, 1 << 31, (1 << 40) + 1, (1 << 53) + 1] {
            for factor in [0.1, 0.25, 0.5, 1.0, 1.5, 3.7, 1000.0] {
                assert_eq!(scaled(t, factor), (t as f64 * factor).round() as u64, "{t} {factor}");
            }
        }
        assert_eq!(scaled(u64::MAX, 2.0), u64::MAX);
    }
}
