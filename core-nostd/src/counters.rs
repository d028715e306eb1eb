//! The decoder's side of the ledgers: every byte and every event is in exactly one count.

/// What can be wrong with a word; each is counted, skipped, and harms nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Fault {
    /// A type of word the format does not define.
    UnknownWord = 0,
    /// An event or trigger before the stream told its time, at the start or after a gap.
    BeforeTime = 1,
    /// An event before the stream told its row (EVT3 ADDR_Y).
    BeforeRow = 2,
    /// A vector before the stream told its base (EVT3 VECT_BASE_X).
    BeforeBase = 3,
    /// A word cut short by the end of the stream or a gap.
    CutShort = 4,
    /// A record, packet or chunk whose bytes contradict its format (files).
    Damaged = 5,
}

impl Fault {
    /// Every kind, in the order of their counts.
    pub const ALL: [Self; 6] = [
        Self::UnknownWord,
        Self::BeforeTime,
        Self::BeforeRow,
        Self::BeforeBase,
        Self::CutShort,
        Self::Damaged,
    ];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::UnknownWord => "unknown_word",
            Self::BeforeTime => "before_time",
            Self::BeforeRow => "before_row",
            Self::BeforeBase => "before_base",
            Self::CutShort => "cut_short",
            Self::Damaged => "damaged",
        }
    }
}

/// Number of malformed words, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults([u64; Fault::ALL.len()]);

impl Faults {
    /// None yet.
    pub const fn new() -> Self {
        Self([0; Fault::ALL.len()])
    }

    /// Counts one more.
    #[inline]
    pub fn count(&mut self, fault: Fault) {
        if let Some(n) = self.0.get_mut(fault as usize) {
            *n += 1;
        }
    }

    /// How many of this kind.
    pub fn get(&self, fault: Fault) -> u64 {
        self.0.get(fault as usize).copied().unwrap_or_default()
    }

    fn zip(&self, other: &Self, with: impl Fn(u64, u64) -> u64) -> Self {
        let mut out = Self::new();
        for ((out, a), b) in out.0.iter_mut().zip(self.0).zip(other.0) {
            *out = with(a, b);
        }
        out
    }

    /// How many in all.
    pub fn total(&self) -> u64 {
        self.0.iter().sum()
    }
}

/// What a decoder has done since it was made.
///
/// `bytes taken = bytes_decoded + bytes_faulty + pending`, and `events = events handed to the sink + off_sensor`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Bytes of well-formed words.
    pub bytes_decoded: u64,
    /// Bytes of malformed words.
    pub bytes_faulty: u64,
    /// Events decoded, those off the sensor included.
    pub events: u64,
    /// Events whose pixel is not on the sensor: dropped.
    pub off_sensor: u64,
    /// Events and triggers that the file marks as invalid: dropped, and not among `events` (files).
    pub marked_invalid: u64,
    /// External triggers decoded.
    pub triggers: u64,
    /// Malformed words by kind.
    pub faults: Faults,
}

impl Counters {
    /// Nothing done yet.
    pub const fn new() -> Self {
        Self {
            bytes_decoded: 0,
            bytes_faulty: 0,
            events: 0,
            off_sensor: 0,
            marked_invalid: 0,
            triggers: 0,
            faults: Faults::new(),
        }
    }

    /// Counts what was done with another part of the stream too.
    pub fn add(&mut self, other: &Self) {
        *self = self.zip(other, u64::saturating_add);
    }

    /// The counts since `before`, an earlier state of these.
    pub fn since(&self, before: &Self) -> Self {
        self.zip(before, u64::saturating_sub)
    }

    fn zip(&self, other: &Self, with: impl Fn(u64, u64) -> u64) -> Self {
        Self {
            bytes_decoded: with(self.bytes_decoded, other.bytes_decoded),
            bytes_faulty: with(self.bytes_faulty, other.bytes_faulty),
            events: with(self.events, other.events),
            off_sensor: with(self.off_sensor, other.off_sensor),
            marked_invalid: with(self.marked_invalid, other.marked_invalid),
            triggers: with(self.triggers, other.triggers),
            faults: self.faults.zip(&other.faults, with),
        }
    }
}
