//! Elements as numbers: what every type of element is in f32, and back.

use half::f16;

use crate::representation::Pixel;

/// Added to a number from 0 to 2^22, it leaves the nearest whole one in the low bits of the sum, ties to even.
const ROUND: f32 = 8_388_608.0; // 2^23

/// An element that a tensor end reads and writes. Sealed.
pub trait Element: Pixel {
    /// Its value; exact for every type.
    fn real(self) -> f32;

    /// The nearest to `real`, ties to even. Whole types: clipped to what they hold, and 0 for NaN.
    fn from_real(real: f32) -> Self;
}

/// The whole number nearest to `real`, ties to even, clipped to 0..=`most`, which is at most 2^22; 0 for NaN.
#[inline(always)]
pub(super) fn whole(real: f32, most: f32) -> u32 {
    // In this order NaN becomes 0: a comparison with it is false.
    let real = if real > 0.0 { real } else { 0.0 };
    let real = if real < most { real } else { most };
    (real + ROUND).to_bits() & 0x007F_FFFF
}

impl Element for u8 {
    #[inline(always)]
    fn real(self) -> f32 {
        self.into()
    }

    #[inline(always)]
    fn from_real(real: f32) -> Self {
        whole(real, 255.0) as Self
    }
}

impl Element for u16 {
    #[inline(always)]
    fn real(self) -> f32 {
        self.into()
    }

    #[inline(always)]
    fn from_real(real: f32) -> Self {
        whole(real, 65_535.0) as Self
    }
}

impl Element for f16 {
    #[inline(always)]
    fn real(self) -> f32 {
        self.to_f32()
    }

    #[inline(always)]
    fn from_real(real: f32) -> Self {
        Self::from_f32(real)
    }
}

impl Element for f32 {
    #[inline(always)]
    fn real(self) -> f32 {
        self
    }

    #[inline(always)]
    fn from_real(real: f32) -> Self {
        real
    }
}
