//! Any tensor to bytes.

use crate::tensor::element::whole;
use crate::tensor::{BadTensor, Element, check};
use crate::vector::widest;

/// Bytes of a tensor: `v * (255 - zero) / range + zero`, to the nearest whole number with ties to even, clipped to
/// 0..=255.
///
/// So a value of `range` becomes 255 and 0 becomes `zero`. With `zero` 0 negative values are lost; with `zero` 128 a
/// signed tensor keeps both signs and -range becomes 1. NaN becomes 0.
///
/// Choose `range` once and for all (fixed), or from the tensor by [`maximum`](crate::tensor::maximum) or
/// [`percentile`](crate::tensor::percentile).
///
/// ```
/// use lobula_core::tensor::Quantise;
/// let mut bytes = [0; 4];
/// let clipped = Quantise { range: 2.0, zero: 128 }.apply(&[0.0, -2.0, 1.0, 5.0f32], &mut bytes)?;
/// assert_eq!(bytes, [128, 1, 192, 255]);
/// assert_eq!(clipped, 1);
/// # Ok::<(), lobula_core::tensor::BadTensor>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantise {
    /// The value that becomes 255. One that is not above 0 makes every element `zero`.
    pub range: f32,
    /// What a value of 0 becomes.
    pub zero: u8,
}

impl Quantise {
    /// For values from 0 to `range`.
    pub const fn to(range: f32) -> Self {
        Self { range, zero: 0 }
    }

    /// Fills `output`, of as many elements as `input`; returns how many lay beyond what bytes can tell (above `range`,
    /// or below what becomes 0) and were clipped.
    pub fn apply<E: Element>(&self, input: &[E], output: &mut [u8]) -> Result<u64, BadTensor> {
        check(input.len(), output.len())?;
        let zero = f32::from(self.zero);
        let scale = if self.range > 0.0 { (255.0 - zero) / self.range } else { 0.0 };
        Ok(widest(
            #[inline(always)]
            || quantise(input, scale, zero, output),
        ))
    }
}

/// Elements that are counted in 32 bits at a time, so that the count is as wide as the elements.
const RUN: usize = 4096;

#[inline(always)]
fn quantise<E: Element>(input: &[E], scale: f32, zero: f32, output: &mut [u8]) -> u64 {
    let mut clipped = 0;
    for (input, output) in input.chunks(RUN).zip(output.chunks_mut(RUN)) {
        let mut beyond = 0u32;
        for (byte, element) in output.iter_mut().zip(input) {
            let value = element.real() * scale + zero;
            // Half a step more rounds to what there is.
            beyond += u32::from(value > 255.5) + u32::from(value < -0.5);
            *byte = whole(value, 255.0) as u8;
        }
        clipped += u64::from(beyond);
    }
    clipped
}
