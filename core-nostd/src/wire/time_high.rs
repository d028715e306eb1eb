//! What EVT 2.0, 2.1 and 4.0 share: where a word has its fields, and the time. That is 34 bits of µs, of which a TIME_HIGH
//! word tells the upper 28 and each event the lower 6. 34 bits wrap after 4 h 46 min; [`Unwrap`] makes them 64.

use crate::{Counters, Event, Fault, Polarity, Refused, Sink, Trigger, Unwrap, full_time};

/// Bits of the time that each event carries.
pub(super) const LOW_BITS: u32 = 6;
/// Bits of the time that a TIME_HIGH word carries.
pub(super) const HIGH_BITS: u32 = 28;
/// Latest time of the first event: beyond it time is of an epoch, and thousands of wraps would have to be told.
const START_MAX_US: u64 = 1 << 40;

/// Largest coordinate of 11 bits.
const COORDINATE_MAX: u16 = 0x7FF;
/// Largest number of a trigger input.
const CHANNEL_MAX: u8 = 0x1F;

const fn low(t: u64) -> u32 {
    (t as u32 & 0x3F) << 22
}

/// The low bits of a word's time.
#[inline(always)]
pub(super) const fn time_low(word: u32) -> u32 {
    word >> 22 & 0x3F
}

/// Whether an event's pixel can be told.
#[inline(always)]
pub(super) const fn check_pixel(event: Event) -> Result<(), Refused> {
    let (x, y) = (event.x(), event.y());
    if x > COORDINATE_MAX || y > COORDINATE_MAX {
        return Err(Refused::OffFormat { x, y });
    }
    Ok(())
}

/// The word of this type for the event's pixel, which can be told, at time `t`.
#[inline(always)]
pub(super) const fn event_word(kind: u32, t: u64, event: Event) -> u32 {
    kind << 28 | low(t) | (event.x() as u32) << 11 | event.y() as u32
}

/// The word of this type for a trigger.
#[inline(always)]
pub(super) const fn trigger_word(kind: u32, trigger: Trigger) -> Result<u32, Refused> {
    let Trigger { t, channel, edge, .. } = trigger;
    if channel > CHANNEL_MAX {
        return Err(Refused::NoChannel { channel });
    }
    Ok(kind << 28 | low(t) | (channel as u32) << 8 | edge as u32)
}

/// What a decoder knows of the time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Known {
    /// Nothing yet; the next TIME_HIGH goes on from the last.
    No,
    /// Nothing since bytes were lost, but where it must be near.
    Near(u64),
    Yes,
}

/// The TIME_HIGH words from the last on that change nothing but the time's lower 32 bits: none wraps, and a sink takes
/// every time that they tell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    /// The first such word (of EVT 2.1 its upper half): that of the last reading.
    pub first: u32,
    /// How many readings there are.
    pub count: u32,
}

impl Reach {
    /// Readings at most: 67 s, so that sinks seldom have less.
    const COUNT_MAX: u64 = 1 << 20;
    /// TIME_HIGH among the types of words, in place.
    const KIND: u32 = 0x8 << HIGH_BITS;

    #[inline(always)]
    pub(super) const fn contains(self, word: u32) -> bool {
        self.mask(word) != 0
    }

    /// All bits set if it contains the word, else none. By the borrow of a subtraction: of a comparison the compiler
    /// makes a branch.
    #[inline(always)]
    pub(super) const fn mask(self, word: u32) -> u32 {
        let told = word.wrapping_sub(self.first);
        ((told as u64).wrapping_sub(self.count as u64) >> 32) as u32
    }
}

/// After how many µs the time wraps.
pub(super) const WRAP_US: u64 = 1 << (LOW_BITS + HIGH_BITS);

/// After how many words time is known whole: up to an event after a TIME_HIGH. Of each word: whether it is the one or
/// the other.
pub(super) fn settled(words: impl Iterator<Item = (bool, bool)>) -> Option<usize> {
    let mut high = false;
    let mut words = words;
    let last = words.position(|(is_high, is_event)| {
        high |= is_high;
        high && is_event
    });
    last.map(|last| last + 1)
}

/// The decoder's clock.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    high: Unwrap<HIGH_BITS>,
    known: Known,
    now: u64,
}

impl Clock {
    pub(super) const fn new() -> Self {
        Self { high: Unwrap::near(0), known: Known::No, now: 0 }
    }

    /// A TIME_HIGH word. One that repeats the last keeps the low bits of [`now`](Self::now).
    #[inline]
    pub(super) fn time_high(&mut self, reading: u64) {
        let high = match self.known {
            Known::Near(near) => self.high.resume(reading, near >> LOW_BITS),
            _ => self.high.push(reading),
        };
        self.known = Known::Yes;
        if self.now >> LOW_BITS != high {
            self.now = high << LOW_BITS;
        }
    }

    /// Time in µs of a word with low bits 0; `None` before it is known.
    #[inline]
    pub(super) fn base(&self) -> Option<u64> {
        (self.known == Known::Yes).then_some(self.high.value() << LOW_BITS)
    }

    /// Takes the trigger of a word; false when the sink takes no more.
    pub(super) fn trigger(
        &mut self,
        word: u32,
        counters: &mut Counters,
        sink: &mut Sink<'_>,
    ) -> Result<bool, Fault> {
        let t = self.base().ok_or(Fault::BeforeTime)? | u64::from(time_low(word));
        let trigger = Trigger {
            t,
            ordinal: counters.events - counters.off_sensor,
            channel: (word >> 8) as u8 & CHANNEL_MAX,
            edge: Polarity::from_bit(word as u16),
        };
        if !sink.push_trigger(trigger) {
            return Ok(false);
        }
        counters.triggers += 1;
        self.now = t;
        Ok(true)
    }

    /// What kernels may take, `None` if nothing.
    #[inline]
    pub(super) fn reach(&self, sink: &Sink<'_>) -> Option<Reach> {
        let base = self.base()?;
        let reading = self.high.value() & ((1 << HIGH_BITS) - 1);
        let count = Reach::COUNT_MAX.min((1 << HIGH_BITS) - reading);
        let latest = base + (count << LOW_BITS) - 1;
        (sink.admits(base) && sink.admits(latest))
            .then_some(Reach { first: Reach::KIND | reading as u32, count: count as u32 })
    }

    /// An event came whose 32-bit time is `t`, after any TIME_HIGH words within [`reach`](Self::reach). Its full time.
    #[inline]
    pub(super) fn reached(&mut self, t: u32) -> u64 {
        let t = full_time(self.high.value() << LOW_BITS, t);
        self.high.push(t >> LOW_BITS);
        self.now = t;
        t
    }

    /// An event of this time came.
    #[inline]
    pub(super) fn set_now(&mut self, t: u64) {
        self.now = t;
    }

    pub(super) const fn now(&self) -> u64 {
        self.now
    }

    /// Forgets the time until the next TIME_HIGH.
    pub(super) fn gap(&mut self, near: Option<u64>) {
        self.known = near.map_or(Known::No, Known::Near);
    }
}

/// The encoder's clock: the value a decoder of the words so far has.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClockOut {
    high: Unwrap<HIGH_BITS>,
    /// Time of the last event asked for; `None` before the first.
    t: Option<u64>,
    /// Whether a TIME_HIGH was sent.
    told: bool,
}

impl ClockOut {
    pub(super) const fn new() -> Self {
        Self { high: Unwrap::near(0), t: None, told: false }
    }

    /// The reading of the TIME_HIGH word to send next, so that an event of time `t` can follow; `None` when it can
    /// now. Refused where no words tell that time.
    #[inline]
    pub(super) fn toward(&mut self, t: u64) -> Result<Option<u64>, Refused> {
        if self.t.is_none() && t > START_MAX_US {
            return Err(Refused::StartTooLate { t });
        }
        let high = t >> LOW_BITS;
        if self.told && self.high.value() == high {
            self.t = Some(t);
            return Ok(None);
        }
        let from = self.t.unwrap_or(0);
        let reading = self.high.toward(high).ok_or(Refused::StepBack { from, to: t })?;
        self.high.push(reading);
        self.told = true;
        self.t = self.t.or(Some(0));
        Ok(Some(reading))
    }
}
