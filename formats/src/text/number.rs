//! Decimal numbers, exactly: an epoch time with six decimals is beyond what an f64 holds.

use crate::TimeUnit;

/// A decimal number as it is written: `digits` x 10^`exponent`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Decimal {
    negative: bool,
    digits: u128,
    exponent: i32,
}

/// Digits that `u128` holds whatever they are.
const DIGITS_MAX: u32 = 38;
/// Exponents beyond these mean nothing here.
const EXPONENT_MAX: i32 = 400;

impl Decimal {
    /// Reads a number such as `12`, `-1.50`, `.5` or `1.5e-05`; `None` for anything else.
    pub fn parse(text: &[u8]) -> Option<Self> {
        let (negative, text) = match text {
            [b'-', rest @ ..] => (true, rest),
            [b'+', rest @ ..] => (false, rest),
            _ => (false, text),
        };
        let (mantissa, exponent) = match text.iter().position(|byte| matches!(byte, b'e' | b'E')) {
            Some(at) => (text.get(..at)?, exponent(text.get(at + 1..)?)?),
            None => (text, 0),
        };
        let mut number = Self { negative, digits: 0, exponent };
        let (mut any, mut fraction, mut held) = (false, false, 0);
        for byte in mantissa {
            match byte {
                b'0'..=b'9' => {
                    any = true;
                    // Beyond what fits only the size counts: it is far below what a µs can tell.
                    let fits = held < DIGITS_MAX;
                    if fits {
                        number.digits = number.digits * 10 + u128::from(byte - b'0');
                        held += u32::from(number.digits > 0);
                    }
                    number.exponent += i32::from(!fits) - i32::from(fraction);
                }
                b'.' if !fraction => fraction = true,
                _ => return None,
            }
        }
        any.then_some(number)
    }

    /// Whether it is written in plain digits, without an exponent, and what follows the point is not only zeros.
    pub fn is_fraction(self) -> bool {
        self.scaled(0).is_none_or(|(_, exact)| !exact)
    }

    /// The nearest integer to the number x 10^`power`, and whether it is the number; `None` beyond 64 bits.
    pub fn scaled(self, power: i32) -> Option<(i64, bool)> {
        let (magnitude, exact) = match self.exponent + power {
            _ if self.digits == 0 => (0, true),
            up @ 0.. => (10u128.checked_pow(up as u32)?.checked_mul(self.digits)?, true),
            down => match 10u128.checked_pow(down.unsigned_abs()) {
                Some(divisor) => {
                    let (whole, rest) = (self.digits / divisor, self.digits % divisor);
                    (whole + u128::from(rest >= divisor - rest), rest == 0)
                }
                None => (0, false),
            },
        };
        let magnitude = i64::try_from(magnitude).ok()?;
        Some((if self.negative { -magnitude } else { magnitude }, exact))
    }

    /// The number, where it is an integer.
    pub fn integer(self) -> Option<i64> {
        self.scaled(0).filter(|(_, exact)| *exact).map(|(integer, _)| integer)
    }
}

fn exponent(text: &[u8]) -> Option<i32> {
    let text = std::str::from_utf8(text).ok()?;
    text.parse().ok().filter(|exponent: &i32| exponent.unsigned_abs() <= EXPONENT_MAX as u32)
}

/// By which power of ten a time of this unit becomes one in µs.
pub(super) const fn exponent_of_us(unit: TimeUnit) -> i32 {
    match unit {
        TimeUnit::Seconds => 6,
        TimeUnit::Milliseconds => 3,
        TimeUnit::Microseconds => 0,
        TimeUnit::Nanoseconds => -3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, power: i32, expected: Option<(i64, bool)>) {
        let found = Decimal::parse(text.as_bytes()).and_then(|number| number.scaled(power));
        assert_eq!(found, expected, "{text}");
    }

    #[test]
    fn numbers_are_exact() {
        check("12", 0, Some((12, true)));
        check("-1.50", 1, Some((-15, true)));
        check("+.5", 6, Some((500_000, true)));
        check("5.", 0, Some((5, true)));
        check("1744227144.732712", 6, Some((1_744_227_144_732_712, true)));
        check("9007199254740993", 0, Some((9_007_199_254_740_993, true)));
        check("1.744227144732712000e+15", 0, Some((1_744_227_144_732_712, true)));
        check("0.0000005", 6, Some((1, false)));
        check("0.00000049", 6, Some((0, false)));
        check("-0.0000005", 6, Some((-1, false)));
        check("1e-300", 6, Some((0, false)));
        check("000000000000000000000000000000000000000000000001", 0, Some((1, true)));
        check("0.3333333333333333333333333333333333333333333333333", 6, Some((333_333, false)));
        check("0e400", 0, Some((0, true)));
    }

    #[test]
    fn what_is_none_is_none() {
        for text in
            ["", "-", ".", "e5", "1e", "1e1.5", "0x10", "1 2", "nan", "inf", "1_000", "--1", "1.2.3", "1e401"]
        {
            assert_eq!(Decimal::parse(text.as_bytes()), None, "{text}");
        }
        check("9223372036854775808", 0, None);
        check("1e30", 0, None);
        check("99999999999999999999999999999999999999999999999", 0, None);
    }
}
