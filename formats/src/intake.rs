//! Where numbers of a file become events: what no event can hold is counted or refused, never wrapped.

use crate::byte_cursor::Bad;
use crate::{ErrorKind, OpenOptions};
use lobula_core::{Counters, Event, Fault, Geometry, Polarity, Sink};

/// Farthest that events taken together are from the earliest they may be; a power of two.
const ALIKE_US_MAX: u64 = 1 << 29;

/// An event as whole numbers of a file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plain {
    pub t_us: i64,
    pub x: u16,
    pub y: u16,
    pub on: bool,
    /// Whether it is none.
    pub bad: bool,
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

    /// Takes `n` events that are all on the sensor, sound, and near the first in time; else takes none of them, and
    /// they are to be pushed one by one. The hot loop of formats that hold whole numbers: it has no branch.
    #[inline]
    pub fn push_alike(
        &mut self,
        sink: &mut Sink<'_>,
        n: usize,
        bytes_each: u64,
        (first_us, last_us): (i64, i64),
        events: impl Iterator<Item = Plain>,
    ) -> bool {
        let Ok(t_first) = self.time(first_us) else { return false };
        let late = t_first.min(ALIKE_US_MAX / 2);
        let sides = [self.geometry.width, self.geometry.height].map(|side| u32::from(side).checked_sub(1));
        let [Some(x_max), Some(y_max)] = sides else { return false };
        if n > sink.room() || !sink.admits(t_first - late) || !sink.admits(t_first + ALIKE_US_MAX) {
            return false;
        }
        let origin = first_us.wrapping_sub(late as i64);
        let (mut far, mut off) = (0, 0);
        for (event, slot) in events.zip(sink.spare().iter_mut()).take(n) {
            let Plain { t_us, x, y, on, bad } = event;
            far |= t_us.wrapping_sub(origin) as u64;
            off |= x_max.wrapping_sub(x.into()) | y_max.wrapping_sub(y.into()) | u32::from(bad) << 31;
            let t = (t_us as u32).wrapping_add(self.shift_us as u32);
            *slot = Event::new(t, x, y, Polarity::from_bit(u16::from(on)));
        }
        // The bound is a power of two: a time beyond it has a bit that no time within it has.
        if far >= ALIKE_US_MAX || off >> 31 != 0 {
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
