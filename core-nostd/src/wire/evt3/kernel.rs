//! What the fast paths of the decoder share: the choice among them, and what they are given.

use super::portable;
use crate::{Event, Geometry, Polarity};

/// How a decoder goes through the steady stretches of a stream. All give the same events, triggers and counters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Kernel {
    /// One word after another: the definition, which the others are tested against.
    Plain,
    /// Tables instead of branches, in safe code for every CPU.
    Portable,
}

impl Kernel {
    /// Every kernel, slowest first.
    pub const ALL: [Self; 2] = [Self::Plain, Self::Portable];

    /// The fastest kernel of this CPU.
    pub fn best() -> Self {
        Self::Portable
    }

    /// Decodes words from the start of `words` as long as they are steady and `out` has room.
    #[inline]
    pub(super) fn run(self, state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
        match self {
            Self::Plain => Done::default(),
            Self::Portable => portable::run(state, words, out),
        }
    }
}

/// The state of a decoder that knows time and row. A kernel stops before a word that would change the high bits of
/// time, that is off the sensor, faulty, or a trigger: these are the decoder's.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steady {
    pub geometry: Geometry,
    /// Time in µs modulo 2^32; the lower 12 bits may change.
    pub time: u32,
    /// A row of the sensor.
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
