//! What the fast paths of the decoders share: the choice among them, and what they tell.

#[cfg(target_arch = "x86_64")]
use super::avx512;

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
    /// Sixteen words at a time, on an x86-64 CPU with AVX-512 (F, BW, CD, VL, VBMI2 and VPOPCNTDQ).
    Avx512,
}

impl Kernel {
    /// Every kernel, slowest first.
    pub const ALL: [Self; 4] = [Self::Plain, Self::Branching, Self::Portable, Self::Avx512];

    /// Whether this CPU has what it takes: seen at run time with feature `std`, else what the code is compiled for.
    pub fn is_available(self) -> bool {
        !matches!((self, self.choose()), (Self::Avx512, Chosen::Portable))
    }

    /// The fastest kernel of this CPU.
    pub fn best() -> Self {
        match () {
            () if Self::Avx512.is_available() => Self::Avx512,
            () if cfg!(target_pointer_width = "32") => Self::Branching,
            () => Self::Portable,
        }
    }

    pub(super) fn choose(self) -> Chosen {
        match self {
            Self::Plain => Chosen::Plain,
            Self::Branching => Chosen::Branching,
            Self::Portable => Chosen::Portable,
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
    Avx512(avx512::Cpu),
}

#[cfg(not(target_arch = "x86_64"))]
pub(super) mod avx512 {
    /// Never.
    #[derive(Clone, Copy, Debug)]
    pub enum Cpu {}

    impl Cpu {
        pub fn detect() -> Option<Self> {
            None
        }
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
