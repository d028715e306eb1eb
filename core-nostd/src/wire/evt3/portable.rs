//! Steady stretches without branches on the type of a word, which alternates almost at random: a branch there is
//! mispredicted every few words, at 15 to 20 cycles each.
//!
//! The event that is next is kept as 64 bits, `t | x << 32 | y << 48 | on << 63`. Every word does the same: a mask by
//! type clears the fields that it tells, a multiplication moves its payload there, the event is stored, and the end of
//! the output moves on by 1 for ADDR_X, else by 0. The words left to a branch are vectors, taken whole where they come
//! as cameras send them (a base and 12 + 12 + 8 columns), and whatever ends the stretch.
//!
//! A vector costs as much as fifteen other words, since where it begins is mispredicted: the path back to the loop is
//! short, and has no second branch that depends on the data.
#![allow(unsafe_code)] // one store: 3 to 4 % of the time (Sapphire Rapids, 2026-11)

use super::kernel::Steady;
use super::{
    ADDR_X, ADDR_Y, CONTINUED_4, CONTINUED_12, COORDINATE, OTHERS, PAYLOAD, POLARITY_SHIFT, TIME_LOW, VECT_8,
    VECT_12, VECT_BASE_X, WORD_EVENTS_MAX,
};
use crate::vector::widest;
use crate::wire::kernel::Done;
use crate::{Event, Geometry, Polarity};

const X_SHIFT: u32 = 32;
const Y_SHIFT: u32 = 48;
const ON_SHIFT: u32 = 63;
const X: u64 = 0xFFFF << X_SHIFT;
const Y: u64 = 0x7FFF << Y_SHIFT;
const ON: u64 = 1 << ON_SHIFT;
const TIME: u64 = u32::MAX as u64;

/// The upper bits of a word that say what it does: its type and the bit after it, which in ADDR_X is the polarity.
const CLASS_SHIFT: u32 = POLARITY_SHIFT;
const CLASSES: usize = 1 << (u16::BITS - CLASS_SHIFT);

/// What a word of each class does to the event that is next: `event & kept + (word * spread + told)`. An array each,
/// and not an array of these: so they are found without arithmetic.
struct Effects {
    /// The bits of the event that stay.
    kept: [u64; CLASSES],
    /// A power of 2 moves the payload to its field.
    spread: [u64; CLASSES],
    /// What the class itself tells (ON, the upper bit of a time), less what its bits become when they are moved.
    told: [u64; CLASSES],
    /// How many events it completes: at most one.
    adds: [usize; CLASSES],
}

static EFFECTS: Effects = Effects::new();

impl Effects {
    const fn new() -> Self {
        let mut effects =
            Self { kept: [0; CLASSES], spread: [0; CLASSES], told: [0; CLASSES], adds: [0; CLASSES] };
        let mut class = 0;
        while class < CLASSES {
            let (kind, bit) = (class as u16 >> 1, class as u64 & 1);
            let (kept, shift, told) = match kind {
                ADDR_Y => (TIME, Y_SHIFT, 0),
                ADDR_X => (TIME | Y, X_SHIFT, bit << ON_SHIFT),
                TIME_LOW => (!(PAYLOAD as u64), 0, bit << POLARITY_SHIFT),
                _ => (u64::MAX, u64::BITS, 0),
            };
            effects.kept[class] = kept;
            if let Some(spread) = 1u64.checked_shl(shift) {
                effects.spread[class] = spread;
                effects.told[class] = told.wrapping_sub(spread.wrapping_mul((class as u64) << CLASS_SHIFT));
            }
            effects.adds[class] = (kind == ADDR_X) as usize;
            class += 1;
        }
        effects
    }
}

/// For each class the first word that is not for the branch-free path: 0 sends all of them to [`Vectors`], or ends the
/// stretch.
pub(super) fn limits(geometry: Geometry) -> [u64; CLASSES] {
    core::array::from_fn(|class| {
        let first = (class as u64) << CLASS_SHIFT;
        let pixels = |n: u16| first + u64::from(n).min(1 << CLASS_SHIFT);
        match class as u16 >> 1 {
            ADDR_Y => pixels(geometry.height),
            ADDR_X => pixels(geometry.width),
            TIME_LOW | OTHERS | CONTINUED_4 | CONTINUED_12 => u64::MAX,
            _ => 0,
        }
    })
}

pub(super) fn pack(time: u32, x: u16, y: u16, polarity: Polarity) -> u64 {
    u64::from(time) | u64::from(x) << X_SHIFT | u64::from(y) << Y_SHIFT | (polarity as u64) << ON_SHIFT
}

fn x_of(event: u64) -> u16 {
    (event >> X_SHIFT) as u16
}

pub(super) fn y_of(event: u64) -> u16 {
    (event >> Y_SHIFT) as u16 & !Event::ON_BIT
}

fn polarity_of(event: u64) -> Polarity {
    Polarity::from_bit((event >> ON_SHIFT) as u16)
}

fn unpack(event: u64) -> Event {
    Event::new(event as u32, x_of(event), y_of(event), polarity_of(event))
}

/// See [`run`](super::kernel::run).
pub fn run(state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
    let limits = limits(state.geometry);
    widest(
        #[inline(always)]
        || stretch(state, words, out, |words, event, _, out| scalars(words, &limits, event, out)),
    )
}

/// Goes through a stretch: `scalars` takes words between vectors, and whole vectors if it
/// can, with the event that is next.
#[inline(always)]
pub(super) fn stretch(
    state: &mut Steady,
    words: &[[u8; 2]],
    out: &mut [Event],
    scalars: impl Fn(&[[u8; 2]], &mut u64, &mut Vectors, &mut [Event]) -> Done,
) -> Done {
    if state.row >= state.geometry.height {
        return Done::default(); // columns alone are compared with the limits
    }
    let mut vectors = Vectors::new(state);
    let mut event = pack(state.time, 0, state.row, Polarity::Off);
    let mut events = 0;
    let mut rest = words;
    while let Some(spare) = out.get_mut(events..) {
        let taken = scalars(rest, &mut event, &mut vectors, spare);
        events += taken.events;
        let (Some(left), Some(spare)) = (rest.get(taken.words..), out.get_mut(events..)) else { break };
        rest = left;
        if let Some((n, left)) = vectors.take_whole(rest, event, spare) {
            events += n;
            rest = left;
            continue;
        }
        let between = match rest {
            [bytes, ..] if u16::from_le_bytes(*bytes) == state.repeated => Some(Done { words: 1, events: 0 }),
            _ => vectors.take_one(rest, event, spare),
        };
        let Some(between) = between else { break };
        rest = rest.get(between.words..).unwrap_or_default();
        events += between.events;
    }
    state.time = event as u32;
    state.row = y_of(event);
    state.base = vectors.base.map(|base| (x_of(base), polarity_of(base)));
    Done { words: words.len() - rest.len(), events }
}

/// Takes words up to the first that a branch is for, or as many as `out` has room for.
#[inline(always)]
pub(super) fn scalars(
    words: &[[u8; 2]],
    limits: &[u64; CLASSES],
    event: &mut u64,
    out: &mut [Event],
) -> Done {
    let words = words.get(..out.len()).unwrap_or(words);
    let mut next = *event;
    let mut done = Done::default();
    let mut take = |bytes: &[u8; 2]| {
        let word = u64::from(u16::from_le_bytes(*bytes));
        let class = (word >> CLASS_SHIFT) as usize & (CLASSES - 1);
        if word >= limits[class] {
            return false;
        }
        let told = word.wrapping_mul(EFFECTS.spread[class]).wrapping_add(EFFECTS.told[class]);
        next = next & EFFECTS.kept[class] | told;
        // SAFETY: the words before this one added one event each or none, and `out` has a slot for each of `words`.
        unsafe { *out.get_unchecked_mut(done.events) = unpack(next) };
        done.events += EFFECTS.adds[class];
        done.words += 1;
        true
    };
    let (fours, rest) = words.as_chunks();
    let all = fours.iter().all(|[a, b, c, d]| take(a) && take(b) && take(c) && take(d));
    if all {
        rest.iter().all(take);
    }
    *event = next;
    done
}

/// The base of the vectors, packed as an event's column and polarity.
pub(super) struct Vectors {
    base: Option<u64>,
    width: u16,
}

impl Vectors {
    /// Bases beyond are left to the decoder, so that the next one fits the field.
    const BASE_MAX: u16 = 0xF000;
    /// Types of the words that make a whole vector, and of a whole vector's columns how many.
    const WHOLE: u64 = whole([VECT_BASE_X, VECT_12, VECT_12, VECT_8]);
    const WHOLE_COLUMNS: u32 = 12 + 12 + 8;

    fn new(state: &Steady) -> Self {
        let base = state.base.map(|(x, polarity)| pack(0, x, 0, polarity));
        Self { base, width: state.geometry.width.min(Self::BASE_MAX) }
    }

    /// Takes the four words of a vector at the front, as cameras send them, and returns how many events it has and the
    /// words after it. `None`, and nothing is done, when there are others, or no room, or not all columns are on the
    /// sensor.
    #[inline(always)]
    pub fn take_whole<'w>(
        &mut self,
        words: &'w [[u8; 2]],
        event: u64,
        out: &mut [Event],
    ) -> Option<(usize, &'w [[u8; 2]])> {
        let (words, rest) = words.split_first_chunk::<4>()?;
        let words = u64::from_le(bytemuck::cast(*words));
        let slots = out.first_chunk_mut()?;
        let x = words as u32 & u32::from(COORDINATE);
        if words & whole([0xF; 4]) != Self::WHOLE || x + Self::WHOLE_COLUMNS > self.width.into() {
            return None;
        }
        let payload = u64::from(PAYLOAD);
        let mask = words >> 16 & payload | words >> 20 & payload << 12 | words >> 24 & 0xFF << 24;
        let base = u64::from(x) << X_SHIFT | words >> POLARITY_SHIFT << ON_SHIFT;
        let events = expand::<32>(mask as u32, event & !(X | ON) | base, slots);
        self.base = Some(base + (u64::from(Self::WHOLE_COLUMNS) << X_SHIFT));
        Some((events, rest))
    }

    /// Takes one word of a vector. `None`, and nothing is done, when it is none, lacks a base or room, or reaches
    /// beyond the sensor.
    #[inline(never)] // rare: away from the registers of the others
    fn take_one(&mut self, words: &[[u8; 2]], event: u64, out: &mut [Event]) -> Option<Done> {
        let word = u16::from_le_bytes(*words.first()?);
        let (mask, columns) = match word >> 12 {
            VECT_BASE_X => {
                self.base = Some(pack(0, word & COORDINATE, 0, Polarity::from_bit(word >> POLARITY_SHIFT)));
                return Some(Done { words: 1, events: 0 });
            }
            VECT_12 => (word & PAYLOAD, 12),
            VECT_8 => (word & 0xFF, 8),
            _ => return None,
        };
        let end = |base: u64| u32::from(x_of(base)) + u16::BITS - mask.leading_zeros();
        let base = self.base.filter(|base| end(*base) <= self.width.into())?;
        let events = expand::<WORD_EVENTS_MAX>(mask.into(), event & !(X | ON) | base, out.first_chunk_mut()?);
        self.base = Some(base + (columns << X_SHIFT));
        Some(Done { words: 1, events })
    }
}

/// Words of these types and no payload, the first in the lowest bits.
const fn whole(kinds: [u16; 4]) -> u64 {
    let [a, b, c, d] = kinds;
    (a as u64) << 12 | (b as u64) << 28 | (c as u64) << 44 | (d as u64) << 60
}

/// Writes `first` moved by `i` columns for each bit `i` of `mask`, and returns how many. Two are written in any case:
/// nine of ten vectors have as many, and to ask for fewer costs more than to write them.
#[inline(always)]
fn expand<const N: usize>(mask: u32, first: u64, slots: &mut [Event; N]) -> usize {
    let at = |mask: u32| unpack(first.wrapping_add(u64::from(mask.trailing_zeros()) << X_SHIFT));
    let next = |mask: u32| mask & mask.wrapping_sub(1);
    let mut left = mask;
    let mut n = 0;
    for slot in slots.iter_mut().take(2) {
        *slot = at(left);
        n += usize::from(left != 0);
        left = next(left);
    }
    for slot in slots.iter_mut().skip(2) {
        if left == 0 {
            break;
        }
        *slot = at(left);
        n += 1;
        left = next(left);
    }
    n
}
