//! Where numbers of a file become events: what no event can hold is counted or refused, never wrapped.

use crate::byte_cursor::Bad;
use crate::{ErrorKind, OpenOptions};
use lobula_core::{Counters, Event, Fault, Geometry, Polarity, Sink};

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
