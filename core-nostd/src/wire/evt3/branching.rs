//! Steady stretches with a branch on the type of every word: for small cores, which lose a cycle or two where they branch
//! and have 32 bits. Half the instructions of [`portable`](super::portable) there (see `tests/firmware`).

use super::kernel::Steady;
use super::{
    ADDR_X, ADDR_Y, CONTINUED_4, CONTINUED_12, COORDINATE, OTHERS, PAYLOAD, POLARITY_SHIFT, TIME_LOW, VECT_8,
    VECT_12, VECT_BASE_X, WORD_EVENTS_MAX, ones,
};
use crate::event::packed::pack;
use crate::wire::kernel::Done;
use crate::{Event, Geometry, Polarity};

/// Where a row stands in a packed pixel.
const ROW_SHIFT: u32 = 16;
/// From the polarity in a word to that in a packed pixel.
const ON_SHIFT: u32 = 31 - POLARITY_SHIFT;
const ON: u32 = 1 << POLARITY_SHIFT;
/// Bases beyond are left to the decoder, so that the next one fits 16 bits.
const BASE_MAX: u16 = 0xF000;

/// See [`run`](super::kernel::run).
pub fn run(state: &mut Steady, words: &[[u8; 2]], out: &mut [Event]) -> Done {
    let Geometry { width, height } = state.geometry;
    if state.row >= height {
        return Done::default(); // columns alone are compared
    }
    let room = out.len();
    let mut slots = out.iter_mut();
    let mut left = words.len();
    let (mut time, mut row) = (state.time, u32::from(state.row) << ROW_SHIFT);
    for bytes in words {
        let word = u16::from_le_bytes(*bytes);
        match word >> 12 {
            ADDR_X if word & COORDINATE < width => {
                let Some(slot) = slots.next() else { break };
                let word = u32::from(word);
                let pixel = row | (word & u32::from(COORDINATE)) | (word & ON) << ON_SHIFT;
                *slot = bytemuck::cast(pack(time, pixel));
            }
            ADDR_Y if word & COORDINATE < height => row = u32::from(word & COORDINATE) << ROW_SHIFT,
            TIME_LOW => time = time & !u32::from(PAYLOAD) | u32::from(word & PAYLOAD),
            VECT_BASE_X => {
                state.base = Some((word & COORDINATE, Polarity::from_bit(word >> POLARITY_SHIFT)));
            }
            VECT_12 | VECT_8 => {
                let (mask, columns) =
                    if word >> 12 == VECT_12 { (word & PAYLOAD, 12) } else { (word & 0xFF, 8) };
                let Some((x, polarity)) = state.base else { break };
                let end = u32::from(x) + u16::BITS - mask.leading_zeros();
                if end > u32::from(width.min(BASE_MAX)) || slots.len() < WORD_EVENTS_MAX {
                    break;
                }
                let first = row | u32::from(x) | u32::from(polarity as u16) << 31;
                for (i, slot) in ones(mask.into()).zip(&mut slots) {
                    *slot = bytemuck::cast(pack(time, first + i));
                }
                state.base = Some((x + columns, polarity));
            }
            OTHERS | CONTINUED_4 | CONTINUED_12 => {}
            _ if word == state.repeated => {}
            _ => break,
        }
        left -= 1;
    }
    state.time = time;
    state.row = (row >> ROW_SHIFT) as u16;
    Done { words: words.len() - left, events: room - slots.len() }
}
