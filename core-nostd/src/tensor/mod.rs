//! What a complete tensor becomes on its way to a network: another size, and bytes, straight into the caller's memory.
//!
//! | end | from | to | source |
//! |---|---|---|---|
//! | [`Resize`] | C x H x W of any type | C x H' x W' of any type | nearest, bilinear: PyTorch's `interpolate` (`nearest-exact`, `bilinear` with `align_corners=False`); area: OpenCV's `INTER_AREA` |
//! | [`Quantise`] | any tensor | u8 of the same shape | `rint(clip(v * (255 - zero) / range + zero, 0, 255))` of numpy |
//! | [`maximum`], [`percentile`] | any tensor | the range to quantise by | numpy's `max` and `percentile` (linear) of the magnitudes |
//!
//! The same bits on every machine: each value is the same steps in f32, in the same order.
//!
//! ```
//! use lobula_core::Shape;
//! use lobula_core::tensor::{Method, Quantise, Resize, Size, maximum};
//! // Counts of a 4x2 sensor become half the size, and then bytes of which the greatest is 255.
//! let counts: [u8; 8] = [2, 2, 0, 0, 2, 2, 0, 1];
//! let shape = Shape { channels: 1, height: 2, width: 4 };
//! let resize = Resize::try_new(shape, Size { height: 1, width: 2 }, Method::Area)?;
//! let mut small = [0.0f32; 2];
//! resize.apply(&counts, &mut small)?;
//! assert_eq!(small, [2.0, 0.25]);
//! let mut bytes = [0; 2];
//! Quantise::to(maximum(&small)).apply(&small, &mut bytes)?;
//! assert_eq!(bytes, [255, 32]);
//! # Ok::<(), lobula_core::tensor::BadTensor>(())
//! ```

mod element;
mod percentile;
mod quantise;
mod resize;

pub use element::Element;
pub use percentile::{Histogram, maximum, percentile};
pub use quantise::Quantise;
pub use resize::{Method, Resize, Size};

/// Why an end cannot do its work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadTensor {
    /// A side of no pixels, or of more than [`Resize::SIDE_MAX`].
    Side {
        /// What was asked for.
        found: usize,
    },
    /// Memory of another length than the tensor has elements.
    Len {
        /// Elements of the tensor.
        expected: usize,
        /// Elements given.
        found: usize,
    },
}

impl core::fmt::Display for BadTensor {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Side { found } => {
                write!(f, "a side of {found} pixels is no tensor's: give 1 to {}", Resize::SIDE_MAX)
            }
            Self::Len { expected, found } => {
                write!(f, "memory of {found} elements was given for a tensor of {expected}")
            }
        }
    }
}

impl core::error::Error for BadTensor {}

/// Refuses memory of another length.
fn check(expected: usize, found: usize) -> Result<(), BadTensor> {
    if expected == found { Ok(()) } else { Err(BadTensor::Len { expected, found }) }
}
