//! Where numbers of a file become events: what no event can hold is counted or refused, never wrapped.

use crate::byte_cursor::Bad;
use crate::{ErrorKind, OpenOptions};
use lobula_core::vector::widest;
use lobula_core::{Counters, Event, Fault, Geometry, Polarity, Sink};

/// Farthest that events taken together are from the earliest they may be; a power of two.
const ALIKE_US_MAX: u64 = 1 << 29;

/// An event as whole numbers of a file, in words of 64 bits, so that the compiler takes several events at once.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plain {
    /// Its time, not shifted, as an `i64`.
    pub t_us: u64,
    /// x in bits 0 to 15, y in 16 to 31, and 0 or 1 for OFF or ON from bit 32 on: anything else there is no polarity.
    pub pixel: u64,
}

/// Bits that a [`Plain::pixel`] that is on the sensor may have.
const PIXEL_BITS: u64 = 0x1_7FFF_7FFF;
/// A bit above each coordinate of fifteen bits.
const GUARD_BITS: u64 = 0x8000_8000;

/// The last pixel of the sensor, the guard's bits set: what has no other bits than [`PIXEL_BITS`] and is subtracted
/// clears one of them where it is off the sensor. `None` for a sensor without pixels.
fn guard(geometry: Geometry) -> Option<u64> {
    // The polarity is to be subtracted as well.
    let last = |side: u16| side.min(1 << 15).checked_sub(1).map(u64::from);
    Some(1 << 32 | GUARD_BITS | last(geometry.width)? | last(geometry.height)? << 16)
}

/// Checks of events one by one, and the ledger.
#[derive(Clone, Debug)]
pub(crate) struct Intake {
    geometry: Geometry,
    shift_us: i64,
    pub counters: Counters,
}

/// What became of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Taken {
    /// It is in the sink, or counted as off the sensor.
    Yes,
    /// The sink takes no more: give it again.
    Full,
}

impl Intake {
    /// For events on a sensor of this size.
    pub fn new(geometry: Geometry, options: &OpenOptions) -> Self {
        Self { geometry, shift_us: options.time_shift_us, counters: Counters::new() }
    }

    /// The sensor's size.
    pub fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// What is added to every time, in µs.
    pub fn shift_us(&self) -> i64 {
        self.shift_us
    }

    /// Takes an event that `bytes` of the file told.
    ///
    /// # Errors
    /// A time that is negative, after the shift, or beyond 2^63 µs.
    #[inline]
    pub fn push(
        &mut self,
        sink: &mut Sink<'_>,
        t_us: i64,
        (x, y): (i64, i64),
        on: bool,
        bytes: u64,
    ) -> Result<Taken, Bad> {
        let t = self.time(t_us)?;
        let on_sensor = |at: i64, side: u16| (0..i64::from(side)).contains(&at);
        if on_sensor(x, self.geometry.width) && on_sensor(y, self.geometry.height) {
            let event = Event::new(t as u32, x as u16, y as u16, Polarity::from_bit(u16::from(on)));
            if !sink.push(t, event) {
                return Ok(Taken::Full);
            }
        } else {
            self.counters.off_sensor += 1;
        }
        self.counters.events += 1;
        self.counters.bytes_decoded += bytes;
        Ok(Taken::Yes)
    }

    /// Takes as many events as there are records, where all are on the sensor, sound, and near the first in time; else
    /// takes none of them, and they are to be pushed one by one. The hot loop of formats that hold whole numbers: it has
    /// no branch.
    #[inline]
    pub fn push_alike<R>(
        &mut self,
        sink: &mut Sink<'_>,
        bytes_each: u64,
        (first_us, last_us): (i64, i64),
        records: impl ExactSizeIterator<Item = R>,
        read: impl Fn(R) -> Plain,
    ) -> bool {
        let n = records.len();
        let Ok(t_first) = self.time(first_us) else { return false };
        let late = t_first.min(ALIKE_US_MAX / 2);
        let Some(guard) = guard(self.geometry) else { return false };
        if n > sink.room() || !sink.admits(t_first - late) || !sink.admits(t_first + ALIKE_US_MAX) {
            return false;
        }
        let origin = first_us.wrapping_sub(late as i64) as u64;
        let (shift, spare) = (self.shift_us as u32, sink.spare());
        let (far, near, seen) = widest(
            #[inline(always)]
            || {
                let (mut far, mut near, mut seen) = (0, GUARD_BITS, 0);
                for (slot, record) in spare.iter_mut().zip(records) {
                    let Plain { t_us, pixel } = read(record);
                    far |= t_us.wrapping_sub(origin);
                    near &= guard.wrapping_sub(pixel);
                    seen |= pixel;
                    let t = u64::from((t_us as u32).wrapping_add(shift));
                    *slot = Event::from_word(t | pixel << 32 | pixel << 31 & 1 << 63);
                }
                (far, near, seen)
            },
        );
        // The bound is a power of two: a time beyond it has a bit that no time within it has.
        if far >= ALIKE_US_MAX || near & GUARD_BITS != GUARD_BITS || seen & !PIXEL_BITS != 0 {
            return false;
        }
        sink.commit(n, t_first, t_first.wrapping_add_signed(last_us.wrapping_sub(first_us)));
        self.counters.events += n as u64;
        self.counters.bytes_decoded += n as u64 * bytes_each;
        true
    }

    /// The time of an event, shifted.
    #[inline]
    pub fn time(&self, t_us: i64) -> Result<u64, Bad> {
        let t = t_us.checked_add(self.shift_us).and_then(|t| u64::try_from(t).ok());
        t.ok_or_else(|| negative(t_us, self.shift_us))
    }

    /// Counts bytes that are no event and nothing wrong.
    pub fn other(&mut self, bytes: u64) {
        self.counters.bytes_decoded += bytes;
    }

    /// Counts the bytes of a record that the end of the file cuts, if there are any.
    pub fn cut_short(&mut self, unread: &[u8]) {
        if !unread.is_empty() {
            self.fault(Fault::CutShort, unread.len() as u64);
        }
    }

    /// Counts bytes that cannot be read.
    pub fn fault(&mut self, fault: Fault, bytes: u64) {
        self.counters.faults.count(fault);
        self.counters.bytes_faulty = self.counters.bytes_faulty.saturating_add(bytes);
    }
}

/// The offset is the caller's to add.
#[cold]
fn negative(t_us: i64, shift_us: i64) -> Bad {
    let shifted = if shift_us == 0 { String::new() } else { format!(", shifted by {shift_us} µs") };
    Bad {
        offset: 0,
        kind: ErrorKind::NeedsOption,
        what: format!("has an event at {t_us} µs{shifted}, and no event can be before 0 or past 2^63 µs"),
        remedy: "give what to add to every time with --time-shift MICROSECONDS".into(),
    }
}
