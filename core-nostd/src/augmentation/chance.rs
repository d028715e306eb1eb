//! A probability, as a bar for random numbers.

use crate::transform::TransformError;

/// Parameters of what happens with a probability.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct ChanceParams {
    /// The probability, 0 to 1.
    pub p: f64,
}

/// Says yes to a share of random numbers: to none for 0 and to all for 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chance(u64);

/// As many bits as a probability has.
const BITS: u32 = 53;

impl Chance {
    pub(super) fn try_new(params: ChanceParams) -> Result<Self, TransformError> {
        let bar = ratio("p", params.p)? * (1u64 << BITS) as f64;
        Ok(Self(bar as u64))
    }

    #[inline(always)]
    pub(super) const fn hits(self, number: u64) -> bool {
        number >> (u64::BITS - BITS) < self.0
    }
}

/// Checks that a parameter is a share.
pub(super) fn ratio(key: &'static str, value: f64) -> Result<f64, TransformError> {
    match (0.0..=1.0).contains(&value) {
        true => Ok(value),
        false => Err(TransformError::OutOfRange { key, range: "0 to 1" }),
    }
}
