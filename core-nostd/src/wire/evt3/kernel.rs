//! What EVT3's kernels are given, and the calls of them.

#[cfg(target_arch = "x86_64")]
use super::avx512;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
use super::neon;
use super::{branching, portable};
#[cfg(not(target_arch = "x86_64"))]
use crate::wire::kernel::absent as avx512;
#[cfg(not(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little")))]
use crate::wire::kernel::absent as neon;
use crate::wire::kernel::{Chosen, Done};
use crate::{Event, Geometry, Polarity};

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

/// Decodes words from the start of `words` as long as they are steady and `out` has room.
#[inline]
pub(super) fn run(kernel: Chosen, state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
    match kernel {
        Chosen::Plain => Done::default(),
        Chosen::Branching => branching::run(state, words, out),
        Chosen::Portable => portable::run(state, words, out),
        Chosen::Neon(cpu) => neon::run(cpu, state, words, out),
        Chosen::Avx512(cpu) => {
            let done = avx512::run(cpu, state, words, out);
            let words = words.get(done.words..).unwrap_or_default();
            let out = out.get_mut(done.events..).unwrap_or_default();
            done + portable::run(state, words, out) // up to the end of `out`
        }
    }
}
