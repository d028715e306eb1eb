//! ECF (filter 0x8ECF): Prophesee's codec of events, up to 65535 to a chunk.
//!
//! ```text
//! u32: count << 2, then bit 1: y, x, p packed, bit 0: x, p packed       all little-endian
//! u64: time of the first event, then until there are times for all events, bytes
//!   1111dddd ...          four more bits of a step in time, the lowest first; the next byte that is none ends it
//!   ttttcccc              the time steps by t < 15; c events have it, or if c = 15, as the next u16 says
//! y, x, p packed: four events in three u32, 24 bits each from the top, y 12, x 11, p 1
//! else y: u16 runs  yyyyyyyyyyyccccc, c events have it, or if c = 31, as the next u16 says
//!   x, p packed: four events in three u16, 12 bits each from the top, x 11, p 1
//!   else x: u16  xxxxxxxxxxxmmmmm, an event at x, then one at x + 1 .. x + 5 for each bit of m from the top
//!        p: bytes  pccccccc, c events have it, or if c = 127, as the next u16 says
//! ```
//!
//! The events come out as Prophesee's programs keep them: u16 x, u16 y, i16 p, 2 bytes of nothing, i64 t.

/// Most events of a chunk.
const EVENTS_MAX: usize = 65535;
/// Bytes of an event as it comes out.
const EVENT_BYTES: usize = 16;

pub(super) fn undo(input: &[u8], output: &mut Vec<u8>, max: usize) -> Option<usize> {
    let mut bytes = Bytes(input);
    let info = bytes.u32()?;
    let count = (info >> 2) as usize;
    if count > EVENTS_MAX || count * EVENT_BYTES > max {
        return None;
    }
    // What is between the numbers is zero.
    output.clear();
    output.resize(count * EVENT_BYTES, 0);
    let (events, _) = output.as_chunks_mut::<EVENT_BYTES>();
    times(&mut bytes, events)?;
    match info & 3 {
        0 => {
            rows(&mut bytes, events)?;
            columns(&mut bytes, events)?;
            polarities(&mut bytes, events)?;
        }
        1 => {
            rows(&mut bytes, events)?;
            columns_and_polarities(&mut bytes, events)?;
        }
        _ => everything(&mut bytes, events)?,
    }
    Some(output.len())
}

type Event = [u8; EVENT_BYTES];

fn set_x(event: &mut Event, x: u16) {
    event[..2].copy_from_slice(&x.to_le_bytes());
}

fn set_y(event: &mut Event, y: u16) {
    event[2..4].copy_from_slice(&y.to_le_bytes());
}

fn set_on(event: &mut Event, on: u8) {
    event[4] = on;
}

fn set_time(event: &mut Event, t: u64) {
    event[8..].copy_from_slice(&t.to_le_bytes());
}

fn times(bytes: &mut Bytes<'_>, mut events: &mut [Event]) -> Option<()> {
    let mut t = bytes.u64()?;
    let (mut step, mut shift) = (0u64, 0);
    while !events.is_empty() {
        let byte = bytes.u8()?;
        let low = u64::from(byte & 15);
        if byte >> 4 == 15 {
            step |= low.checked_shl(shift).unwrap_or(0);
            shift = shift.saturating_add(4);
            continue;
        }
        t = t.wrapping_add(step).wrapping_add((byte >> 4).into());
        (step, shift) = (0, 0);
        let count = if low == 15 { bytes.u16()?.into() } else { low as usize };
        events = run(events, count, |event| set_time(event, t))?;
    }
    Some(())
}

fn rows(bytes: &mut Bytes<'_>, mut events: &mut [Event]) -> Option<()> {
    while !events.is_empty() {
        let word = bytes.u16()?;
        let count = if word & 31 == 31 { bytes.u16()? } else { word & 31 };
        events = run(events, count.into(), |event| set_y(event, word >> 5))?;
    }
    Some(())
}

fn polarities(bytes: &mut Bytes<'_>, mut events: &mut [Event]) -> Option<()> {
    while !events.is_empty() {
        let byte = bytes.u8()?;
        let count = if byte & 127 == 127 { bytes.u16()? } else { u16::from(byte & 127) };
        events = run(events, count.into(), |event| set_on(event, byte >> 7))?;
    }
    Some(())
}

/// Sets the first `count` events; the others.
fn run(events: &mut [Event], count: usize, set: impl Fn(&mut Event)) -> Option<&mut [Event]> {
    let (these, others) = events.split_at_mut_checked(count)?;
    these.iter_mut().for_each(set);
    Some(others)
}

fn columns(bytes: &mut Bytes<'_>, events: &mut [Event]) -> Option<()> {
    let mut events = events.iter_mut();
    while let Some(event) = events.next() {
        let word = bytes.u16()?;
        let x = word >> 5;
        set_x(event, x);
        for next in (1..=5).filter(|next| word >> (5 - next) & 1 == 1) {
            // Bits for more events than there are mean nothing: the encoder looks beyond the last one.
            let Some(event) = events.next() else { break };
            set_x(event, x + next);
        }
    }
    Some(())
}

fn columns_and_polarities(bytes: &mut Bytes<'_>, events: &mut [Event]) -> Option<()> {
    for four in events.chunks_mut(4) {
        let [a, b, c] = [bytes.u16()?, bytes.u16()?, bytes.u16()?];
        let values = [a >> 4, (a & 0xF) | b >> 8 << 4, (b & 0xFF) | c >> 12 << 8, c & 0xFFF];
        for (event, value) in four.iter_mut().zip(values) {
            set_x(event, value >> 1);
            set_on(event, (value & 1) as u8);
        }
    }
    Some(())
}

fn everything(bytes: &mut Bytes<'_>, events: &mut [Event]) -> Option<()> {
    for four in events.chunks_mut(4) {
        let [a, b, c] = [bytes.u32()?, bytes.u32()?, bytes.u32()?];
        let values = [a >> 8, (a & 0xFF) | b >> 16 << 8, (b & 0xFFFF) | c >> 24 << 16, c & 0xFF_FFFF];
        for (event, value) in four.iter_mut().zip(values) {
            set_y(event, (value >> 12 & 0x7FF) as u16);
            set_x(event, (value >> 1 & 0x7FF) as u16);
            set_on(event, (value & 1) as u8);
        }
    }
    Some(())
}

/// Numbers one after the other; `None` where the bytes end before.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn u8(&mut self) -> Option<u8> {
        self.0.split_off_first().copied()
    }

    fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(*self.0.split_off(..2)?.first_chunk()?))
    }

    fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(*self.0.split_off(..4)?.first_chunk()?))
    }

    fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(*self.0.split_off(..8)?.first_chunk()?))
    }
}
