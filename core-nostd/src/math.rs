//! The core's own functions of real numbers: fixed polynomials without fused multiply-add, so that every machine and
//! every kernel gives the same bits. The standard library's and libm's are never used.

/// Below this, [`exp`] is 0 (the true value is under 1.7e-38, next to the least normal number).
pub const EXP_MIN: f32 = -87.0;

/// Above this, [`exp`] is infinite (the true value is over 1.6e38, half of the greatest number).
pub const EXP_MAX: f32 = 88.0;

/// ln 2 in two parts: the first has few bits, so that its product with a small whole number is exact.
const LN2_HIGH: f32 = 0.693_359_4;
const LN2_LOW: f32 = -2.121_944_4e-4;

/// Added to a number of small magnitude, it leaves the nearest whole one in the low bits of the sum.
const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23

/// (e^r - 1 - r) / r^2 for |r| <= ln 2 / 2, lowest power first: Chebyshev interpolation, relative error under 2e-8.
const TAIL: [f32; 5] = [0.5, 0.166_665_76, 0.041_666_552, 8.363_247e-3, 1.392_626_8e-3];

/// e to the power of `x`, within 1.2e-7 of the true value relative to it (about 1 unit in the last place).
///
/// 0 below [`EXP_MIN`], infinite above [`EXP_MAX`], never subnormal; NaN stays NaN. Free of branches, so that a loop
/// over a slice vectorises.
///
/// ```
/// use lobula_core::math::exp;
/// assert_eq!(exp(0.0), 1.0);
/// assert!((exp(-1.0) - 0.367_879_44).abs() < 1e-7);
/// ```
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    let shifted = x * core::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (x - n * LN2_HIGH) - n * LN2_LOW;
    let [c0, c1, c2, c3, c4] = TAIL;
    let tail = (((c4 * r + c3) * r + c2) * r + c1) * r + c0;
    let power = 1.0 + (r + r * r * tail);
    let value = power * power_of_two(shifted);
    let value = if x < EXP_MIN { 0.0 } else { value };
    if x > EXP_MAX { f32::INFINITY } else { value }
}

/// 2^n, where `shifted` is n + [`ROUND`]: the sum's low bits become an exponent.
#[inline(always)]
fn power_of_two(shifted: f32) -> f32 {
    let n = shifted.to_bits().wrapping_sub(ROUND.to_bits());
    f32::from_bits(n.wrapping_add(127) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_within_its_bound_of_the_double_precision_one() {
        let mut worst = 0.0f64;
        for i in 0..=4_000_000 {
            let x = EXP_MIN + (EXP_MAX - EXP_MIN) * (i as f32 / 4_000_000.0);
            let truth = f64::from(x).exp();
            worst = worst.max(((f64::from(exp(x)) - truth) / truth).abs());
        }
        assert!(worst < 1.2e-7, "relative error {worst:e}");
    }

    #[test]
    fn exp_ends_where_it_says() {
        assert_eq!(exp(0.0), 1.0);
        assert_eq!(exp(-0.0), 1.0);
        assert_eq!(exp(EXP_MIN.next_down()), 0.0);
        assert_eq!(exp(f32::NEG_INFINITY), 0.0);
        assert_eq!(exp(EXP_MAX.next_up()), f32::INFINITY);
        assert_eq!(exp(f32::INFINITY), f32::INFINITY);
        assert!(exp(f32::NAN).is_nan());
        assert!(exp(EXP_MIN).is_normal() && exp(EXP_MAX).is_normal());
    }

    #[test]
    fn exp_never_goes_up_as_its_argument_goes_down() {
        let mut last = f32::INFINITY;
        for i in 0..100_000 {
            let value = exp(-(i as f32) * 1e-3);
            assert!(value <= last);
            last = value;
        }
    }

    /// The law "same bits everywhere": the number is from the same steps in Python, each rounded to binary32.
    #[test]
    fn exp_has_these_bits_on_every_machine() {
        let mut digest = 0u32;
        for i in 0..100_000u32 {
            digest = digest.rotate_left(5).wrapping_mul(0x9E37_79B1) ^ exp(-(i as f32) * 3.3e-4).to_bits();
        }
        assert_eq!(digest, 2_131_304_060);
    }
}
