//! Steady stretches without branches on the type of a word, which alternates almost at random: a branch there is
//! mispredicted every few words, at 15 to 20 cycles each.
//!
//! The event that is next is kept as 64 bits, `t | x << 32 | y << 48 | on << 63`. Every word does the same: a
//! multiplication spreads its payload to the fields, a mask by type says which of them are taken over, the event is
//! stored, and the end of the output moves on by 1 for ADDR_X, else by 0. The words left to a branch are vectors
//! (well predicted, since they come in threes) and whatever ends the stretch.

use super::kernel::{Done, Steady};
use super::{
    ADDR_X, ADDR_Y, CONTINUED_4, CONTINUED_12, COORDINATE, OTHERS, PAYLOAD, POLARITY_SHIFT, TIME_LOW, VECT_8,
    VECT_12, VECT_BASE_X, WORD_EVENTS_MAX,
};
use crate::{Event, Geometry, Polarity};

const X_SHIFT: u32 = 32;
const Y_SHIFT: u32 = 48;
const ON_SHIFT: u32 = 63;
const X: u64 = 0xFFFF << X_SHIFT;
const ON: u64 = 1 << ON_SHIFT;

/// What each type of word does to the event that is next. An array each, and not an array of these: so they are
/// found without arithmetic.
struct Effects {
    /// Where the payload goes: a factor is a sum of shifts.
    spread: [u64; 16],
    /// Which bits of the event it replaces.
    taken: [u64; 16],
    /// How many events it completes.
    adds: [usize; 16],
    /// The first coordinate that is not for the branch-free path: 0 sends every word of the type to [`Vectors`], or
    /// ends the stretch.
    limit: [usize; 16],
}

impl Effects {
    fn new(geometry: Geometry) -> Self {
        const ALWAYS: usize = COORDINATE as usize + 1;
        const COORDINATE_64: u64 = COORDINATE as u64;
        let mut effects = Self { spread: [0; 16], taken: [0; 16], adds: [0; 16], limit: [0; 16] };
        effects.set(ADDR_Y, geometry.height.into(), 1 << Y_SHIFT, COORDINATE_64 << Y_SHIFT);
        let single = 1 << X_SHIFT | 1 << (ON_SHIFT - POLARITY_SHIFT);
        effects.set(ADDR_X, geometry.width.into(), single, COORDINATE_64 << X_SHIFT | ON);
        effects.set(TIME_LOW, ALWAYS, 1, PAYLOAD.into());
        effects.set(OTHERS, ALWAYS, 0, 0);
        effects.set(CONTINUED_4, ALWAYS, 0, 0);
        effects.set(CONTINUED_12, ALWAYS, 0, 0);
        effects.adds[usize::from(ADDR_X)] = 1;
        effects
    }

    #[inline(always)]
    fn set(&mut self, kind: u16, limit: usize, spread: u64, taken: u64) {
        let kind = usize::from(kind & 15);
        self.limit[kind] = limit;
        self.spread[kind] = spread;
        self.taken[kind] = taken;
    }
}

fn pack(time: u32, x: u16, y: u16, polarity: Polarity) -> u64 {
    u64::from(time) | u64::from(x) << X_SHIFT | u64::from(y) << Y_SHIFT | (polarity as u64) << ON_SHIFT
}

fn x_of(event: u64) -> u16 {
    (event >> X_SHIFT) as u16
}

fn y_of(event: u64) -> u16 {
    (event >> Y_SHIFT) as u16 & !Event::ON_BIT
}

fn polarity_of(event: u64) -> Polarity {
    Polarity::from_bit((event >> ON_SHIFT) as u16)
}

fn unpack(event: u64) -> Event {
    Event::new(event as u32, x_of(event), y_of(event), polarity_of(event))
}

/// See [`Chosen::run`](super::kernel::Chosen).
pub fn run(state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
    if state.row >= state.geometry.height {
        return Done::default(); // columns alone are compared with the limits
    }
    let effects = Effects::new(state.geometry);
    let mut vectors = Vectors::new(state);
    let mut event = pack(state.time, 0, state.row, Polarity::Off);
    let mut events = 0;
    let mut rest = words;
    while let [bytes, tail @ ..] = rest {
        let Some(slot) = out.get_mut(events) else { break };
        let word = u16::from_le_bytes(*bytes);
        let kind = usize::from(word >> 12);
        if usize::from(word & COORDINATE) >= effects.limit[kind] {
            if word != state.repeated && !vectors.take(word, event, out, &mut events) {
                break;
            }
        } else {
            event ^= (event ^ u64::from(word).wrapping_mul(effects.spread[kind])) & effects.taken[kind];
            *slot = unpack(event);
            events += effects.adds[kind];
        }
        rest = tail;
    }
    state.time = event as u32;
    state.row = y_of(event);
    state.base = vectors.base.map(|base| (x_of(base), polarity_of(base)));
    Done { words: words.len() - rest.len(), events }
}

/// The base of the vectors, packed as an event's column and polarity.
struct Vectors {
    base: Option<u64>,
    width: u16,
}

impl Vectors {
    /// Bases beyond are left to the decoder, so that the next one fits the field.
    const BASE_MAX: u16 = 0xF000;

    fn new(state: &Steady) -> Self {
        let base = state.base.map(|(x, polarity)| pack(0, x, 0, polarity));
        Self { base, width: state.geometry.width.min(Self::BASE_MAX) }
    }

    /// Takes a word of a vector. False, and nothing is done, when it is none, lacks a base or room, or reaches beyond
    /// the sensor.
    #[inline]
    fn take(&mut self, word: u16, event: u64, out: &mut [Event], events: &mut usize) -> bool {
        let (mask, columns) = match word >> 12 {
            VECT_BASE_X => {
                self.base = Some(pack(0, word & COORDINATE, 0, Polarity::from_bit(word >> POLARITY_SHIFT)));
                return true;
            }
            VECT_12 => (word & PAYLOAD, 12),
            VECT_8 => (word & 0xFF, 8),
            _ => return false,
        };
        let end = |base: u64| u32::from(x_of(base)) + u16::BITS - mask.leading_zeros();
        let Some(base) = self.base.filter(|base| end(*base) <= self.width.into()) else { return false };
        let Some(slots) = out.get_mut(*events..).and_then(|out| out.first_chunk_mut()) else { return false };
        *events += expand(mask, event & !(X | ON) | base, slots);
        self.base = Some(base + (columns << X_SHIFT));
        true
    }
}

/// Writes `first` moved by `i` columns for each bit `i` of `mask`, and returns how many. Two are written in any case:
/// more are rare, and to ask for fewer costs more than to write them.
#[inline]
fn expand(mask: u16, first: u64, slots: &mut [Event; WORD_EVENTS_MAX]) -> usize {
    let at = |mask: u32| unpack(first + (u64::from(mask.trailing_zeros() & 15) << X_SHIFT));
    let mask = u32::from(mask);
    let second = mask & mask.wrapping_sub(1);
    let mut third = second & second.wrapping_sub(1);
    slots[0] = at(mask);
    slots[1] = at(second);
    let mut n = usize::from(mask != 0) + usize::from(second != 0);
    while third != 0
        && let Some(slot) = slots.get_mut(n)
    {
        *slot = at(third);
        third &= third - 1;
        n += 1;
    }
    n
}
