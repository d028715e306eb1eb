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

/// Something for each type of word.
type ByType<T> = [T; 16];

/// Where the payload goes: a factor is a sum of shifts.
const SPREAD: ByType<u64> = by_type([
    (ADDR_Y, 1 << Y_SHIFT),
    (ADDR_X, 1 << X_SHIFT | 1 << (ON_SHIFT - POLARITY_SHIFT)),
    (TIME_LOW, 1),
]);
/// Which bits of the event it replaces.
const TAKEN: ByType<u64> = by_type([
    (ADDR_Y, (COORDINATE as u64) << Y_SHIFT),
    (ADDR_X, (COORDINATE as u64) << X_SHIFT | ON),
    (TIME_LOW, PAYLOAD as u64),
]);
const KEPT: ByType<u64> = {
    let mut kept = TAKEN;
    let mut i = 0;
    while i < kept.len() {
        kept[i] = !kept[i];
        i += 1;
    }
    kept
};
/// How many events it completes.
const ADDS: ByType<u64> = by_type([(ADDR_X, 1), (ADDR_Y, 0), (TIME_LOW, 0)]);

const fn by_type(entries: [(u16, u64); 3]) -> ByType<u64> {
    let mut table = [0; 16];
    let mut i = 0;
    while i < entries.len() {
        table[entries[i].0 as usize] = entries[i].1;
        i += 1;
    }
    table
}

/// The first coordinate that is not for the branch-free path: 0 sends every word of a type to [`exceptional`].
fn limits(geometry: Geometry) -> ByType<u16> {
    let mut limits = [0; 16];
    let always = COORDINATE + 1;
    for (kind, limit) in [
        (ADDR_Y, geometry.height),
        (ADDR_X, geometry.width),
        (TIME_LOW, always),
        (OTHERS, always),
        (CONTINUED_4, always),
        (CONTINUED_12, always),
    ] {
        if let Some(entry) = limits.get_mut(usize::from(kind)) {
            *entry = limit;
        }
    }
    limits
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

/// See [`Kernel::run`](super::Kernel).
pub(super) fn run(state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
    if state.row >= state.geometry.height {
        return Done::default(); // columns alone are compared with the limits
    }
    let limits = limits(state.geometry);
    let mut vectors = Vectors::new(state);
    let mut event = pack(state.time, 0, state.row, Polarity::Off);
    let mut events = 0;
    let mut rest = words;
    while let [bytes, tail @ ..] = rest {
        let Some(slot) = out.get_mut(events) else { break };
        let word = u16::from_le_bytes(*bytes);
        let kind = usize::from(word >> 12);
        if word & COORDINATE >= limits[kind] {
            if word != state.repeated && !vectors.take(word, event, out, &mut events) {
                break;
            }
        } else {
            event = event & KEPT[kind] | u64::from(word).wrapping_mul(SPREAD[kind]) & TAKEN[kind];
            *slot = unpack(event);
            events += ADDS[kind] as usize;
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
    fn new(state: &Steady) -> Self {
        let base = state.base.map(|(x, polarity)| pack(0, x, 0, polarity));
        Self { base, width: state.geometry.width }
    }

    /// Takes a word of a vector. False, and nothing is done, when it is none, lacks a base or room, or may reach
    /// beyond the sensor.
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
        let Some(base) = self.base.filter(|base| u32::from(x_of(*base)) + columns <= self.width.into())
        else {
            return false;
        };
        let Some(slots) = out.get_mut(*events..).and_then(|out| out.first_chunk_mut::<WORD_EVENTS_MAX>())
        else {
            return false;
        };
        *events += expand(mask, event & !(X | ON) | base, slots);
        self.base = Some(base + (u64::from(columns) << X_SHIFT));
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
