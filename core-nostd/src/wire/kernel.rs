//! What the fast paths of the decoders share: the choice among them, and what they tell.

#[cfg(not(target_arch = "x86_64"))]
use self::absent as avx512;
#[cfg(not(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little")))]
use self::absent as neon;
#[cfg(target_arch = "x86_64")]
use super::avx512;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
use super::neon;

/// How a decoder goes through the steady stretches of a stream. All give the same events, triggers and counters.
///
/// Mev/s for recordings repeated to 20 M events, 4096 at a time into one buffer, on a core of a Xeon with AVX-512 that
/// other virtual machines slow down by up to a half (2026-11-22, the `report` bench):
///
/// | | [`Portable`](Self::Portable) | [`Avx512`](Self::Avx512) |
/// |---|---|---|
/// | EVT 3.0, Gen4.1 | 220 to 360 | 410 to 540 |
/// | EVT 2.0, Gen3 | 400 to 650 | 1140 to 1440 |
/// | EVT 2.1, one event a word | 80 to 90 | 490 to 550 |
///
/// Instructions an event on aarch64 Linux, 32 KiB of a recording under qemu-user (rustc 1.96, 2026-11-22,
/// `tests/it/neon.rs`); times on hardware are not known:
///
/// | | [`Portable`](Self::Portable) | [`Neon`](Self::Neon) |
/// |---|---|---|
/// | EVT 3.0, Gen4.1 | 24.2 | 16.0 |
/// | EVT 3.0, few events among words of time | 98.9 | 35.2 |
/// | EVT 2.0, Gen3 | 12.0 | 6.0 |
/// | EVT 2.1, one event a word | 60.1 | 26.0 |
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Kernel {
    /// One word after another: the definition, which the others are tested against.
    Plain,
    /// A branch on every word, for microcontrollers: EVT3 takes 35 instructions an event on a Cortex-M4, portable 53
    /// (`tests/firmware`, 2026-11-22). The other formats are as portable.
    Branching,
    /// Tables instead of branches, for every CPU: no instructions of any one.
    Portable,
    /// Eight or sixteen words at a time, on a 64-bit ARM CPU, little-endian and compiled for with NEON, as Linux does. In
    /// EVT 2.1 words of three events or more are expanded as by portable, at as many instructions (16.7 an event where a
    /// word has 1 to 8).
    Neon,
    /// Sixteen words at a time, on an x86-64 CPU with AVX-512 (F, BW, CD, VL, VBMI2 and VPOPCNTDQ).
    Avx512,
}

impl Kernel {
    /// Every kernel, slowest first.
    pub const ALL: [Self; 5] = [Self::Plain, Self::Branching, Self::Portable, Self::Neon, Self::Avx512];

    /// Whether this CPU has what it takes: seen at run time with feature `std`, else what the code is compiled for.
    pub fn is_available(self) -> bool {
        !matches!((self, self.choose()), (Self::Neon | Self::Avx512, Chosen::Portable))
    }

    /// The kernels of this CPU, slowest first.
    pub fn available() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|kernel| kernel.is_available())
    }

    /// The fastest kernel of this CPU.
    pub fn best() -> Self {
        match () {
            () if Self::Avx512.is_available() => Self::Avx512,
            () if Self::Neon.is_available() => Self::Neon,
            () if crate::vector::SMALL_CORE => Self::Branching,
            () => Self::Portable,
        }
    }

    pub(super) fn choose(self) -> Chosen {
        match self {
            Self::Plain => Chosen::Plain,
            Self::Branching => Chosen::Branching,
            Self::Portable => Chosen::Portable,
            Self::Neon => neon::Cpu::detect().map_or(Chosen::Portable, Chosen::Neon),
            Self::Avx512 => avx512::Cpu::detect().map_or(Chosen::Portable, Chosen::Avx512),
        }
    }
}

/// A kernel that this CPU has.
#[derive(Clone, Copy, Debug)]
pub(super) enum Chosen {
    Plain,
    Branching,
    Portable,
    Neon(neon::Cpu),
    Avx512(avx512::Cpu),
}

/// In place of a kernel that this is not compiled for.
pub(super) mod absent {
    use super::Done;
    use crate::Event;

    /// Never.
    #[derive(Clone, Copy, Debug)]
    pub enum Cpu {}

    impl Cpu {
        pub fn detect() -> Option<Self> {
            None
        }
    }

    pub fn run(cpu: Cpu, _: &mut impl Sized, _: &[impl Sized], _: &mut [Event]) -> Done {
        match cpu {}
    }
}

/// How many words a kernel took and how many events it wrote.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Done {
    pub words: usize,
    pub events: usize,
}

impl core::ops::Add for Done {
    type Output = Self;

    fn add(self, more: Self) -> Self {
        Self { words: self.words + more.words, events: self.events + more.events }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_machine_has_its_own() {
        assert_eq!(Kernel::Neon.is_available(), cfg!(target_arch = "aarch64"));
        assert!(Kernel::available().all(|kernel| kernel != Kernel::Avx512) || cfg!(target_arch = "x86_64"));
        assert_eq!(Kernel::available().find(|kernel| *kernel == Kernel::best()), Some(Kernel::best()));
    }
}
