//! The types of a tensor's elements.

use bytemuck::Pod;
use half::f16;

use crate::Event;
use crate::representation::index::{Places, change_each};
use crate::vector::widest;

/// Type of a tensor's element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
#[repr(u8)]
pub enum Dtype {
    /// Unsigned, 8 bits.
    U8 = 1,
    /// Unsigned, 16 bits.
    U16 = 2,
    /// IEEE 754 binary16.
    F16 = 3,
    /// IEEE 754 binary32.
    F32 = 4,
}

impl Dtype {
    /// Bytes of an element.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
        }
    }

    /// Its name in settings, and in numpy with `float` for `f` and `uint` for `u`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::U16 => "u16",
            Self::F16 => "f16",
            Self::F32 => "f32",
        }
    }
}

/// An element of a tensor. Sealed.
pub trait Pixel: Pod + PartialEq + core::fmt::Debug + sealed::Sealed {
    /// Its type as a value.
    const DTYPE: Dtype;
}

/// An element that counts. Sealed.
pub trait Tally: Pixel {
    /// Counts one more; where it can count no further, `saturated` does.
    fn count(&mut self, saturated: &mut u64);

    /// Takes one back; returns whether that is sure: of the greatest number it is not, there may have been more.
    fn uncount(&mut self) -> bool;
}

/// An element that sums signs. Sealed.
pub trait Signed: Pixel {
    /// What stands for 0.
    const NONE: Self;

    /// One more (`on`) or one less; where the type holds no such number, as before, and `saturated` counts.
    fn step(self, on: bool, saturated: &mut u64) -> Self;
}

/// An element that holds a share, from 0 to 1. Sealed.
pub trait Real: Pixel {
    /// The nearest to `share`, ties to even. Anything for what is not from 0 to 1.
    fn from_share(share: f32) -> Self;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for u8 {}
    impl Sealed for u16 {}
    impl Sealed for f32 {}
    impl Sealed for half::f16 {}
}

impl Pixel for u8 {
    const DTYPE: Dtype = Dtype::U8;
}

impl Pixel for u16 {
    const DTYPE: Dtype = Dtype::U16;
}

impl Pixel for f16 {
    const DTYPE: Dtype = Dtype::F16;
}

impl Pixel for f32 {
    const DTYPE: Dtype = Dtype::F32;
}

impl Tally for u8 {
    /// Adds first and looks then: one instruction does both in memory.
    #[inline(always)]
    fn count(&mut self, saturated: &mut u64) {
        let (more, full) = self.overflowing_add(1);
        *self = more;
        if full {
            *self = Self::MAX;
            *saturated += 1;
        }
    }

    #[inline(always)]
    fn uncount(&mut self) -> bool {
        let full = *self == Self::MAX;
        *self = self.wrapping_sub(1);
        !full
    }
}

impl Tally for u16 {
    /// Adds first and looks then: one instruction does both in memory.
    #[inline(always)]
    fn count(&mut self, saturated: &mut u64) {
        let (more, full) = self.overflowing_add(1);
        *self = more;
        if full {
            *self = Self::MAX;
            *saturated += 1;
        }
    }

    #[inline(always)]
    fn uncount(&mut self) -> bool {
        let full = *self == Self::MAX;
        *self = self.wrapping_sub(1);
        !full
    }
}

impl Tally for f32 {
    /// Exact up to 2^24, where it stays.
    #[inline(always)]
    fn count(&mut self, saturated: &mut u64) {
        let more = *self + 1.0;
        *saturated += u64::from(more == *self);
        *self = more;
    }

    #[inline(always)]
    fn uncount(&mut self) -> bool {
        let full = *self + 1.0 == *self;
        *self -= 1.0;
        !full
    }
}

impl Signed for u8 {
    const NONE: Self = 128;

    #[inline(always)]
    fn step(self, on: bool, saturated: &mut u64) -> Self {
        let next = if on { self.saturating_add(1) } else { self.saturating_sub(1) };
        *saturated += u64::from(next == self);
        next
    }
}

impl Signed for f32 {
    const NONE: Self = 0.0;

    /// Exact up to 2^24 either way, where it stays.
    #[inline(always)]
    fn step(self, on: bool, saturated: &mut u64) -> Self {
        let next = self + if on { 1.0 } else { -1.0 };
        *saturated += u64::from(next == self);
        next
    }
}

/// Counts events, each at its pixel; returns how many no pixel could count.
#[inline(always)]
pub(super) fn count_each<P: Tally>(places: Places, events: &[Event], out: &mut [P]) -> u64 {
    widest(
        #[inline(always)]
        || {
            let mut saturated = 0;
            change_each(places, events, out, |pixel, _| pixel.count(&mut saturated));
            saturated
        },
    )
}

/// Takes back what counting these events did to their pixels; returns whether that is sure of all of them.
pub(super) fn uncount_each<P: Tally>(places: Places, events: &[Event], out: &mut [P]) -> bool {
    widest(
        #[inline(always)]
        || {
            let mut sure = true;
            change_each(places, events, out, |pixel, _| sure &= pixel.uncount());
            sure
        },
    )
}

impl Real for f32 {
    #[inline(always)]
    fn from_share(share: f32) -> Self {
        share
    }
}

impl Real for f16 {
    /// Without a branch, so that a loop over a slice vectorises: the general conversion takes five times as long.
    #[inline(always)]
    fn from_share(share: f32) -> Self {
        const EXPONENTS_APART: u32 = (127 - 15) << 10;
        let bits = share.to_bits();
        let tie_to_even = (bits >> 13) & 1;
        let normal = (bits.wrapping_add(0xFFF + tie_to_even) >> 13).wrapping_sub(EXPONENTS_APART);
        // At 0.5 the last bit of an f32 is worth as much as that of a subnormal f16.
        let subnormal = (share + 0.5).to_bits().wrapping_sub(0.5f32.to_bits());
        let is_normal = share >= f16::MIN_POSITIVE.to_f32_const();
        f16::from_bits(if is_normal { normal } else { subnormal } as u16)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_precision_is_the_nearest_to_every_share() {
        let one = 1.0f32.to_bits();
        for bits in
            (0..=one).step_by(61).chain(one - 70_000..=one).chain(0x3380_0000 - 9_000..0x3380_0000 + 9_000)
        {
            let share = f32::from_bits(bits);
            assert_eq!(f16::from_share(share), f16::from_f32_const(share), "{share:e}");
        }
        // Every value of half precision, and every tie between two.
        for bits in 0..f16::ONE.to_bits() {
            let (low, high) = (f16::from_bits(bits).to_f32_const(), f16::from_bits(bits + 1).to_f32_const());
            for share in
                [low, (low + high) / 2.0, ((low + high) / 2.0).next_down(), ((low + high) / 2.0).next_up()]
            {
                assert_eq!(f16::from_share(share), f16::from_f32_const(share), "{share:e}");
            }
        }
    }
}
