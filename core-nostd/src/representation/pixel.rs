//! The types of a tensor's elements.

use bytemuck::Pod;
use half::f16;

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
    /// One more; the same where it can count no further.
    #[must_use]
    fn more(self) -> Self;
}

/// An element that holds real numbers. Sealed.
pub trait Real: Pixel {
    /// The nearest value to `value`, ties to even.
    fn from_f32(value: f32) -> Self;
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
    #[inline(always)]
    fn more(self) -> Self {
        self.saturating_add(1)
    }
}

impl Tally for u16 {
    #[inline(always)]
    fn more(self) -> Self {
        self.saturating_add(1)
    }
}

impl Tally for f32 {
    /// Exact up to 2^24, where it stays.
    #[inline(always)]
    fn more(self) -> Self {
        self + 1.0
    }
}

impl Real for f32 {
    #[inline(always)]
    fn from_f32(value: f32) -> Self {
        value
    }
}

impl Real for f16 {
    #[inline(always)]
    fn from_f32(value: f32) -> Self {
        f16::from_f32_const(value)
    }
}
