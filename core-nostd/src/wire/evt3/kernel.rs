//! What the fast paths of the decoder share: the choice among them, and what they are given.

#[cfg(target_arch = "x86_64")]
use super::avx512;
use super::portable;
use crate::{Event, Geometry, Polarity};

/// How a decoder goes through the steady stretches of a stream. All give the same events, triggers and counters.
///
/// Speed for a recording of a Gen4.1 sensor into a sink of 8192 events, on a shared core of a Xeon with AVX-512
/// (2026-11-22), where a `match` per word in unsafe code does 100 Mev/s: [`Portable`](Self::Portable) 280,
/// [`Avx512`](Self::Avx512) 520.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Kernel {
    /// One word after another: the definition, which the others are tested against.
    Plain,
    /// Tables instead of branches, in safe code for every CPU.
    Portable,
    /// Sixteen words at a time, on an x86-64 CPU with AVX-512 (F, BW, CD, VL, VBMI2 and VPOPCNTDQ).
    Avx512,
}

impl Kernel {
    /// Every kernel, slowest first.
    pub const ALL: [Self; 3] = [Self::Plain, Self::Portable, Self::Avx512];

    /// Whether this CPU has what it takes: seen at run time with feature `std`, else what the code is compiled for.
    pub fn is_available(self) -> bool {
        !matches!((self, self.choose()), (Self::Avx512, Chosen::Portable))
    }

    /// The fastest kernel of this CPU.
    pub fn best() -> Self {
        if Self::Avx512.is_available() { Self::Avx512 } else { Self::Portable }
    }

    pub(super) fn choose(self) -> Chosen {
        match self {
            Self::Plain => Chosen::Plain,
            Self::Portable => Chosen::Portable,
            Self::Avx512 => avx512::Cpu::detect().map_or(Chosen::Portable, Chosen::Avx512),
        }
    }
}

/// A kernel that this CPU has.
#[derive(Clone, Copy, Debug)]
pub(super) enum Chosen {
    Plain,
    Portable,
    Avx512(avx512::Cpu),
}

impl Chosen {
    /// Decodes words from the start of `words` as long as they are steady and `out` has room.
    #[inline]
    pub fn run(self, state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
        match self {
            Self::Plain => Done::default(),
            Self::Portable => portable::run(state, words, out),
            Self::Avx512(cpu) => {
                let done = avx512::run(cpu, state, words, out);
                let words = words.get(done.words..).unwrap_or_default();
                let out = out.get_mut(done.events..).unwrap_or_default();
                done + portable::run(state, words, out) // up to the end of `out`
            }
        }
    }
}

#[cfg(not(target_arch = "x86_64"))]
mod avx512 {
    use super::{Done, Event, Steady};

    /// Never.
    #[derive(Clone, Copy, Debug)]
    pub enum Cpu {}

    impl Cpu {
        pub fn detect() -> Option<Self> {
            None
        }
    }

    pub fn run(cpu: Cpu, _: &mut Steady, _: &[[u8; 2]], _: &mut [Event]) -> Done {
        match cpu {}
    }
}

/// The state of a decoder that knows time and row. A kernel stops before a word that would change the high bits of
/// time, that is off the sensor, faulty, or a trigger: these are the decoder's.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steady {
    pub geometry: Geometry,
    /// Time in µs modulo 2^32; the lower 12 bits may change.
    pub time: u32,
    /// The row told last.
    pub row: u16,
    /// Column and polarity of the next vector.
    pub base: Option<(u16, Polarity)>,
    /// The TIME_HIGH word that changes nothing.
    pub repeated: u16,
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
