//! Where numbers of a file become events: what no event can hold is counted or refused, never wrapped.

use crate::byte_cursor::Bad;
use crate::{ErrorKind, OpenOptions};
use lobula_core::vector::in_order;
use lobula_core::{Counters, Event, Fault, Geometry, Polarity, Sink};

/// Events taken together are of one stretch of so many µs, counted from 0; a power of two.
const STRETCH_US: u64 = 1 << 29;

/// An event as whole numbers of a file, in words of 64 bits, so that the compiler takes several events at once.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plain {
    /// Its time, not shifted, as an `i64`.
    pub t_us: u64,
    /// As in an [`Event`], but for the polarity: x in bits 32 to 47, y in 48 to 63, and 0 or 1 for OFF or ON in bits 0 to
    /// 31, where anything else is no polarity.
    pub pixel: u64,
}

impl Plain {
    /// Of an x in bits 0 to 15, y in 16 to 31, and the polarity above.
    #[inline(always)]
    pub const fn of(t_us: u64, xyp: u64) -> Self {
        Self { t_us, pixel: xyp.rotate_left(32) }
    }

    /// Has bits that are not [`SOUND`](Self::SOUND) where the pixel is beyond the `last`, or the polarity is none.
    #[inline(always)]
    const fn beyond(self, last: u64) -> u64 {
        // What is beyond by less than half the range of a coordinate borrows the bit that is not sound; by more, has it.
        last.wrapping_sub(self.pixel) | self.pixel
    }

    const SOUND: u64 = 0x7FFF_7FFF_0000_0001;
}

/// The last pixel of the sensor and ON, as a [`Plain::pixel`]. `None` for a sensor without pixels.
fn last_pixel(geometry: Geometry) -> Option<u64> {
    let last = |side: u16| side.min(1 << 15).checked_sub(1).map(u64::from);
    Some(1 | last(geometry.width)? << 32 | last(geometry.height)? << 48)
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

    /// Takes as many events as there are records, where all are on the sensor, sound, and of the first one's stretch of
    /// time; else takes none of them, and they are to be pushed one by one. The hot loop of formats that hold whole
    /// numbers: it has no branch.
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
        let (Ok(t_first), Some(last_pixel)) = (self.time(first_us), last_pixel(self.geometry)) else {
            return false;
        };
        let start = t_first & !(STRETCH_US - 1);
        if n > sink.room() || !sink.admits(start) || !sink.admits(start + (STRETCH_US - 1)) {
            return false;
        }
        let (shift, spare) = (self.shift_us as u64, sink.spare());
        let (far, wrong) = in_order(
            #[inline(always)]
            move || {
                let (mut far, mut wrong) = (0, 0);
                for (slot, record) in spare.iter_mut().zip(records) {
                    let plain = read(record);
                    let t = plain.t_us.wrapping_add(shift);
                    far |= t ^ start;
                    wrong |= plain.beyond(last_pixel);
                    let pixel = plain.pixel & (u64::MAX << 32) | plain.pixel << 63;
                    *slot = Event::from_word(t & u64::from(u32::MAX) | pixel);
                }
                (far, wrong)
            },
        );
        if far >= STRETCH_US || wrong & !Plain::SOUND != 0 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// t, x, y, p as a file tells them.
    type Told = (i64, u16, u16, u32);

    /// What a sink holds after these events: by [`Intake::push_alike`], or one by one; `None` where not all were taken.
    fn taken(
        events: &[Told],
        geometry: Geometry,
        shift_us: i64,
        alike: bool,
    ) -> Option<(Vec<(u64, Event)>, Counters)> {
        let options = OpenOptions { time_shift_us: shift_us, ..OpenOptions::default() };
        let mut intake = Intake::new(geometry, &options);
        let mut memory = [Event::default(); Sink::LEN_MIN];
        let mut sink = Sink::new(&mut memory);
        if alike {
            let (first, last) = (events.first()?, events.last()?);
            let plain = |(t, x, y, p): &Told| {
                Plain::of(*t as u64, u64::from(*x) | u64::from(*y) << 16 | u64::from(*p) << 32)
            };
            if !intake.push_alike(&mut sink, 8, (first.0, last.0), events.iter(), plain) {
                return None;
            }
        } else {
            for (t, x, y, p) in events {
                let xy = (i64::from(*x), i64::from(*y));
                if *p > 1 || intake.push(&mut sink, *t, xy, *p == 1, 8).ok()? == Taken::Full {
                    return None;
                }
            }
        }
        let block = sink.block(geometry);
        let span = block.span();
        Some((span.events.iter().map(|event| (span.time(*event), *event)).collect(), intake.counters))
    }

    const SIDES: [u16; 6] = [1, 2, 240, 1280, 1 << 15, u16::MAX];

    proptest! {
        #[test]
        fn taken_together_is_taken_one_by_one(
            origin in prop::sample::select(vec![0, 5, STRETCH_US as i64 - 3, 1 << 32, i64::MAX - 40, -9]),
            shift_us in prop::sample::select(vec![0, 7, -7, 1 << 33]),
            (width, height) in (prop::sample::select(SIDES.to_vec()), prop::sample::select(SIDES.to_vec())),
            steps in prop::collection::vec((0..9i64, any::<u16>(), any::<u16>(), 0..2u32), 1..40),
            odd in prop::option::weighted(0.5, (0..40usize, any::<(i64, u16, u16)>(), any::<u32>())),
        ) {
            let geometry = Geometry::new(width, height);
            let mut events: Vec<Told> = steps
                .iter()
                .map(|(t, x, y, p)| (origin.wrapping_add(*t), x % width, y % height, *p))
                .collect();
            let len = events.len();
            if let Some((at, (t, x, y), p)) = odd {
                events[at % len] = match at % 4 {
                    0 => (t, x % width, y % height, 1),
                    1 => (origin, x, y % height, 1),
                    2 => (origin, x % width, y, 0),
                    _ => (origin, x % width, y % height, p),
                };
            }
            if let Some(together) = taken(&events, geometry, shift_us, true) {
                prop_assert_eq!(Some(together), taken(&events, geometry, shift_us, false));
            }
        }

        #[test]
        fn events_of_one_stretch_on_the_sensor_are_taken_together(
            times in prop::collection::vec(0..STRETCH_US as i64, 2..40),
            (width, height) in (1..=1u16 << 15, 1..=1u16 << 15),
        ) {
            let events: Vec<Told> =
                times.iter().map(|t| (*t, (t % i64::from(width)) as u16, height - 1, (*t & 1) as u32)).collect();
            prop_assert!(taken(&events, Geometry::new(width, height), 0, true).is_some());
            let last = events.len() - 1;
            for wrong in [(0, width, 0, 0), (0, 0, height, 0), (0, 0, 0, 2), (-1, 0, 0, 0), (1 << 29, 0, 0, 0)] {
                let mut events = events.clone();
                events[last] = wrong;
                prop_assert!(taken(&events, Geometry::new(width, height), 0, true).is_none(), "{wrong:?}");
            }
        }
    }
}
