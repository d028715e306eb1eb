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

/// ln(2) in two parts: the first has 16 bits, so that its product with an exponent is exact.
const LN_TWO_HIGH: f32 = 0.693_145_75;
const LN_TWO_LOW: f32 = 1.428_606_8e-6;

/// The natural logarithm of `x`, within 1.5e-7 of the true value relative to it.
///
/// Minus infinity of 0, NaN of what is negative or NaN; infinity stays. Free of branches but for subnormal numbers.
///
/// ```
/// use lobula_core::math::ln;
/// assert_eq!(ln(1.0), 0.0);
/// assert!((ln(10.0) - 2.302_585_1).abs() < 4e-7);
/// ```
#[inline(always)]
pub fn ln(x: f32) -> f32 {
    const SCALE: f32 = 16_777_216.0; // 2^24
    let (scaled, scale) = if x < f32::MIN_POSITIVE { (x * SCALE, 24) } else { (x, 0) };
    // x = m 2^n with m from sqrt(1/2) to sqrt(2).
    let bits = scaled.to_bits().wrapping_sub(core::f32::consts::FRAC_1_SQRT_2.to_bits());
    let n = ((bits as i32 >> 23) - scale) as f32;
    let m = f32::from_bits((bits & 0x007F_FFFF).wrapping_add(core::f32::consts::FRAC_1_SQRT_2.to_bits()));
    // ln m = 2 artanh s with |s| under 0.172: its series, of which what is left out is under 2e-9 of it.
    let f = m - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let series = z * (1.0 / 3.0 + z * (1.0 / 5.0 + z * (1.0 / 7.0 + z * (1.0 / 9.0))));
    // 2 s (1 + series) = f - s (f - 2 series), and f is exact.
    let value = n * LN_TWO_HIGH + (f - (s * (f - 2.0 * series) - n * LN_TWO_LOW));
    let value = if x == 0.0 { f32::NEG_INFINITY } else { value };
    let value = if x == f32::INFINITY { x } else { value };
    if x >= 0.0 { value } else { f32::NAN }
}

/// The square root of `x`, correctly rounded. Of whole numbers, so for numbers now and then rather than for tensors.
///
/// -0 and infinity stay, NaN of what is negative or NaN.
///
/// ```
/// assert_eq!(lobula_core::math::sqrt(2.25), 1.5);
/// ```
pub fn sqrt(x: f32) -> f32 {
    if x == 0.0 || x == f32::INFINITY {
        return x;
    }
    if x < 0.0 || x.is_nan() {
        return f32::NAN;
    }
    let bits = x.to_bits();
    // x = m 2^e, where m is a whole number.
    let (m, e) = match bits >> 23 {
        0 => (bits, -149),
        exponent => (bits & 0x007F_FFFF | 0x0080_0000, exponent as i32 - 150),
    };
    // To 49 or 50 bits with an even exponent: the root has 25 bits, one more than are kept.
    let up = m.leading_zeros() + 17;
    let up = up + (up as i32 + e).rem_euclid(2) as u32;
    let root = (u64::from(m) << up).isqrt();
    // A root of so few bits is never halfway between two numbers of 24: its last bit rounds it.
    let (half, exponent) = ((root + 1) >> 1, (e - up as i32) / 2 + 1);
    // Both are exact: half is at most 2^24, and the root of no number is subnormal.
    half as f32 * f32::from_bits(((exponent + 127) as u32) << 23)
}

/// Square root of a normal number, within 1 unit in the last place: Newton's steps from a guess by halving the exponent.
/// 0 of 0, no number of less.
///
/// ```
/// assert_eq!(lobula_core::math::sqrt_f64(2.25), 1.5);
/// ```
pub fn sqrt_f64(x: f64) -> f64 {
    if x == 0.0 || x == f64::INFINITY {
        return x;
    }
    if x.is_nan() || x < 0.0 {
        return f64::NAN;
    }
    let mut root = f64::from_bits((x.to_bits() >> 1) + (0x1FF8 << 48));
    // The guess is within 7 %; each step squares the error.
    for _ in 0..5 {
        root = 0.5 * (root + x / root);
    }
    root
}

/// pi / 2 in two parts: the first has few bits, so that its product with a small whole number is exact.
const QUARTER_HIGH: f64 = 1.570_796_326_734_125_6;
const QUARTER_LOW: f64 = 6.077_100_506_506_192e-11;
/// 1.5 * 2^52, for doubles what [`ROUND`] is for singles.
const ROUND_F64: f64 = 6_755_399_441_055_744.0;

/// Sine and cosine of an angle of at most 10^5, within 3e-16: Taylor's series within an eighth of a turn.
///
/// ```
/// let (sin, cos) = lobula_core::math::sin_cos_f64(std::f64::consts::FRAC_PI_6);
/// assert!((sin - 0.5).abs() < 3e-16 && (cos * cos - 0.75).abs() < 3e-16);
/// ```
pub fn sin_cos_f64(x: f64) -> (f64, f64) {
    let shifted = x * core::f64::consts::FRAC_2_PI + ROUND_F64;
    let quarters = shifted - ROUND_F64;
    let r = (x - quarters * QUARTER_HIGH) - quarters * QUARTER_LOW;
    let (mut sin, mut cos) = (0.0, 0.0);
    // 1 - r^2 / ((n - 1) n) (1 - ...), for even n the cosine's and for odd n the sine's.
    for n in (1..=9u32).rev() {
        let even = f64::from(2 * n);
        cos = r * r / ((even - 1.0) * even) * (1.0 - cos);
        sin = r * r / (even * (even + 1.0)) * (1.0 - sin);
    }
    let (sin, cos) = (r * (1.0 - sin), 1.0 - cos);
    match shifted.to_bits() & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Tangent of an angle of at most 10^5, within 1e-15 of it relative to it.
///
/// ```
/// assert!((lobula_core::math::tan_f64(1.0) - 1.557_407_724_654_902_2).abs() < 1e-15);
/// ```
pub fn tan_f64(x: f64) -> f64 {
    let (sin, cos) = sin_cos_f64(x);
    sin / cos
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

    #[test]
    fn ln_is_within_its_bound_of_the_double_precision_one() {
        let mut worst = 0.0f64;
        let near_one = 0.9f32.to_bits()..1.1f32.to_bits();
        for bits in (1..f32::INFINITY.to_bits()).step_by(997).chain(near_one) {
            let x = f32::from_bits(bits);
            let truth = f64::from(x).ln();
            let error = (f64::from(ln(x)) - truth).abs();
            worst = worst.max(if x == 1.0 { error } else { error / truth.abs() });
        }
        assert!(worst < 1.5e-7, "relative error {worst:e}");
        assert_eq!((ln(1.0), ln(0.0), ln(-0.0)), (0.0, f32::NEG_INFINITY, f32::NEG_INFINITY));
        assert_eq!(ln(f32::INFINITY), f32::INFINITY);
        assert!(ln(-1.0).is_nan() && ln(f32::NAN).is_nan() && ln(f32::NEG_INFINITY).is_nan());
    }

    #[test]
    fn the_square_root_is_that_of_the_processor() {
        let ends = [0.0, -0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX];
        let all = (1..f32::INFINITY.to_bits()).step_by(1013).chain(0..70_000).map(f32::from_bits);
        let near = (0..3_000u32).flat_map(|i| {
            let square = (i * i) as f32;
            [square.next_down(), square, square.next_up()]
        });
        for x in all.chain(near).chain(ends) {
            let (found, expected) = (sqrt(x), x.sqrt());
            assert!(found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan(), "{x:e}");
        }
    }

    #[test]
    fn roots_are_within_a_unit_in_the_last_place() {
        for i in 0..200_000u64 {
            let x = f64::from_bits(
                (i.wrapping_mul(0x9E37_79B9_7F4A_7C15) & !(1 << 63)).clamp(1 << 52, 0x7FE << 52),
            );
            let (root, truth) = (sqrt_f64(x), x.sqrt());
            assert!(root.to_bits().abs_diff(truth.to_bits()) <= 1, "{x:e}: {root:e} is {truth:e}");
        }
        assert_eq!((sqrt_f64(0.0), sqrt_f64(f64::INFINITY)), (0.0, f64::INFINITY));
        assert!(sqrt_f64(-1.0).is_nan() && sqrt_f64(f64::NAN).is_nan());
    }

    #[test]
    fn sine_cosine_and_tangent_are_within_their_bounds() {
        for i in -200_000..=200_000 {
            let x = f64::from(i) * 1e-3 / 3.0;
            let (sin, cos) = sin_cos_f64(x);
            assert!((sin - x.sin()).abs() < 3e-16 && (cos - x.cos()).abs() < 3e-16, "{x}");
            let truth = x.tan();
            assert!(
                (tan_f64(x) - truth).abs() <= 1e-15 * truth.abs().max(1e-300),
                "{x}: {} is {truth}",
                tan_f64(x)
            );
        }
    }
}
