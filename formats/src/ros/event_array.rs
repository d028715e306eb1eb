//! `dvs_msgs/EventArray`: an array of events, as the drivers of ROS 1 send it; `prophesee_event_msgs` and
//! `dv_ros_msgs` have the same under their own names.
//!
//! Spec: <https://github.com/uzh-rpg/rpg_dvs_ros/tree/master/dvs_msgs/msg>
//!
//! ```text
//! header, u32 height, u32 width, u32 count, events
//! event, ROS 1   u16 x, u16 y, u32 s, u32 ns, u8 p: 13 bytes
//! event, CDR     the same, x at even bytes, s at multiples of 4: 13 bytes the first, 16 with padding each after it
//! ```

#[cfg(target_arch = "x86_64")]
mod avx2;
/// No kernel.
#[cfg(not(target_arch = "x86_64"))]
mod avx2 {
    use super::{Alike, Event};

    #[derive(Clone, Copy, Debug)]
    pub(super) enum Cpu {}

    impl Cpu {
        pub fn detect() -> Option<Self> {
            None
        }

        pub fn events<const STRIDE: usize, const PAD: usize>(
            self,
            _: &Alike,
            _: &[[u8; STRIDE]],
            _: &mut [Event],
        ) -> (usize, bool) {
            match self {}
        }
    }
}

use super::fields::{CDR_TAIL_BYTES_MAX, Fields, Wire};
use crate::byte_cursor::{Bad, Step};
use crate::intake::{Intake, Taken};
use avx2::Cpu;
use lobula_core::{Event, Fault, Geometry, Polarity, SPAN_MAX_US, Sink};

/// Bytes of an event, without padding.
const EVENT_BYTES: usize = 13;
/// Bytes of an event of CDR with the padding before it.
const PADDED_BYTES: usize = 16;

/// What comes before the events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Head {
    /// Columns and rows of the sensor.
    pub size: [u32; 2],
    /// Number of events.
    pub events: u32,
    /// Bytes of the head.
    pub bytes: usize,
}

impl Head {
    pub fn parse(message: &[u8], wire: Wire) -> Option<Self> {
        let mut fields = Fields::new(message, wire)?;
        fields.header()?;
        let (height, width) = (fields.u32()?, fields.u32()?);
        let events = fields.u32()?;
        Some(Self { size: [width, height], events, bytes: fields.offset() })
    }
}

/// Decodes the events of one message after the other.
#[derive(Clone, Debug)]
pub(crate) struct EventArrays {
    pub intake: Intake,
    shift_us: i64,
    wire: Wire,
    /// Events of this message still to come.
    left: u32,
    /// Whether the next is the first of its message.
    first: bool,
    /// For the kernel, where the CPU has what it needs.
    cpu: Option<Cpu>,
}

impl EventArrays {
    pub fn new(intake: Intake, shift_us: i64, wire: Wire) -> Self {
        Self { intake, shift_us, wire, left: 0, first: false, cpu: Cpu::detect() }
    }

    /// Begins with the events of a message of `bytes` bytes; false where these are not as many as it says.
    pub fn begin(&mut self, head: Head, bytes: u64) -> bool {
        let events = u64::from(head.events);
        let body = bytes.saturating_sub(head.bytes as u64);
        let fits = match self.wire {
            Wire::Ros1 => body == events * EVENT_BYTES as u64,
            Wire::Cdr => {
                let rest = events.saturating_sub(1) * PADDED_BYTES as u64;
                let first = if events > 0 { EVENT_BYTES as u64 } else { 0 };
                body.checked_sub(first + rest).is_some_and(|behind| behind <= CDR_TAIL_BYTES_MAX)
            }
        };
        if fits {
            (self.left, self.first) = (head.events, true);
            self.intake.other(head.bytes as u64);
        }
        fits
    }

    /// Decodes events; bytes of one that is cut, or come after the last, are left.
    pub fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        let mut taken = 0;
        while self.left > 0 {
            let rest = bytes.get(taken..).unwrap_or_default();
            let (done, stride) = match self.wire == Wire::Cdr && !self.first {
                false => (self.run::<EVENT_BYTES, 0>(rest, sink), EVENT_BYTES),
                true => (self.run::<PADDED_BYTES, 3>(rest, sink), PADDED_BYTES),
            };
            if done > 0 {
                self.took(done, stride);
                taken += done * stride;
                continue;
            }
            let Some(event) = rest.get(..stride) else { break };
            let raw = match stride {
                EVENT_BYTES => Raw::of::<0>(event),
                _ => Raw::of::<3>(event),
            };
            let Some(raw) = raw else { break };
            let pushed = self.intake.push(sink, raw.us(), (raw.x.into(), raw.y.into()), raw.p != 0, 0);
            if pushed.map_err(|bad| Bad { offset: taken, ..bad })? == Taken::Full {
                return Ok(Step { taken, full: true });
            }
            self.left -= 1;
            self.first = false;
            self.intake.other(stride as u64);
            taken += stride;
        }
        Ok(Step { taken, full: false })
    }

    fn took(&mut self, events: usize, stride: usize) {
        self.left -= events as u32;
        self.first = false;
        self.intake.counters.events += events as u64;
        self.intake.other((events * stride) as u64);
    }

    /// Takes events as long as they lie on the sensor and near the first of the sink, and both have room; how many.
    /// `PAD` bytes of padding come before y of each of `STRIDE` bytes, one of them before x.
    #[inline]
    fn run<const STRIDE: usize, const PAD: usize>(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> usize {
        let most = if self.wire == Wire::Cdr && self.first { 1 } else { self.left as usize };
        let (events, _) = bytes.as_chunks::<STRIDE>();
        let events = events.get(..most.min(sink.room())).unwrap_or(events);
        let time = |event: &[u8; STRIDE]| {
            let t = Raw::of::<PAD>(event)?.us().checked_add(self.shift_us)?;
            u64::try_from(t).ok()
        };
        let Some(first) = events.first().and_then(time) else { return 0 };
        let anchor = if sink.is_empty() { first } else { sink.t_first() };
        let Some(near) = Near::new(anchor, self.shift_us, self.intake.geometry()) else { return 0 };
        let mut done = 0;
        for (slots, events) in sink.spare().chunks_mut(BATCH).zip(events.chunks(BATCH)) {
            let good = near.events::<STRIDE, PAD>(events, slots, self.cpu);
            done += good;
            if good < events.len() {
                break;
            }
        }
        let last = done.checked_sub(1).and_then(|last| events.get(last)).and_then(time);
        sink.commit(done, first, last.unwrap_or(first));
        done
    }
}

/// Events checked at once.
const BATCH: usize = 256;
/// Low bits of the seconds that may differ within a block: 1024 s are near in any case.
const NEAR_BITS: u32 = 10;
const _: () = assert!((1 << NEAR_BITS) * 1_000_000 + u32::MAX as u64 / 1000 < SPAN_MAX_US);

/// What a block takes without further looking.
#[derive(Clone, Copy)]
struct Near {
    /// A second near all of them.
    s: u32,
    shift_us: i64,
    geometry: Geometry,
}

impl Near {
    /// Near a time in µs. `None` where a time near it could be negative: those are looked at one by one.
    fn new(anchor: u64, shift_us: i64, geometry: Geometry) -> Option<Self> {
        let unshifted = i64::try_from(anchor).ok()?.checked_sub(shift_us)?;
        let s = u32::try_from(unshifted / 1_000_000).ok()?;
        let least = i64::from(s >> NEAR_BITS << NEAR_BITS) * 1_000_000;
        (least.checked_add(shift_us)? >= 0).then_some(Self { s, shift_us, geometry })
    }

    /// Writes events as long as each is near and on the sensor; how many.
    #[inline(always)]
    fn events<const STRIDE: usize, const PAD: usize>(
        &self,
        events: &[[u8; STRIDE]],
        slots: &mut [Event],
        cpu: Option<Cpu>,
    ) -> usize {
        let first = events.first().and_then(|event| Raw::of::<PAD>(event));
        let alike = first.filter(|first| self.is_near(first.s)).and_then(|first| Alike::new(first.s, self));
        match alike {
            Some(alike) if alike.events::<STRIDE, PAD>(events, slots, cpu) => events.len(),
            _ => self.each::<STRIDE, PAD>(events, slots),
        }
    }

    /// The same, one by one.
    #[cold]
    fn each<const STRIDE: usize, const PAD: usize>(
        &self,
        events: &[[u8; STRIDE]],
        slots: &mut [Event],
    ) -> usize {
        let good = |raw: &Raw| self.is_near(raw.s) && self.geometry.contains(raw.x, raw.y);
        let good = events.iter().map_while(|event| Raw::of::<PAD>(event).filter(good));
        let pairs = slots.iter_mut().zip(good);
        pairs.map(|(slot, raw)| *slot = raw.event(self.shift_us)).count()
    }

    fn is_near(&self, s: u32) -> bool {
        (s ^ self.s) >> NEAR_BITS == 0
    }
}

/// What nearly all events that stand together are: of one second, and on the sensor.
#[derive(Clone, Copy, Debug)]
struct Alike {
    s: u32,
    /// The time of its start, shifted, in µs modulo 2^32.
    start: u32,
    x_max: u16,
    y_max: u16,
}

impl Alike {
    /// `None` where the sensor has no pixel.
    fn new(s: u32, near: &Near) -> Option<Self> {
        let start = s.wrapping_mul(1_000_000).wrapping_add(near.shift_us as u32);
        let Geometry { width, height } = near.geometry;
        // An event has 15 bits for y.
        Some(Self { s, start, x_max: width.checked_sub(1)?, y_max: height.checked_sub(1)?.min(0x7FFF) })
    }

    /// Writes events; false where one is not alike, and what was written is to be thrown away.
    #[inline(always)]
    fn events<const STRIDE: usize, const PAD: usize>(
        &self,
        events: &[[u8; STRIDE]],
        slots: &mut [Event],
        cpu: Option<Cpu>,
    ) -> bool {
        let (done, good) = cpu.map_or((0, true), |cpu| cpu.events::<STRIDE, PAD>(self, events, slots));
        let (events, slots) = (events.get(done..), slots.get_mut(done..));
        good && self.portable::<STRIDE, PAD>(events.unwrap_or_default(), slots.unwrap_or_default())
    }

    /// The same for every CPU, without a branch.
    #[inline(always)]
    fn portable<const STRIDE: usize, const PAD: usize>(
        &self,
        events: &[[u8; STRIDE]],
        slots: &mut [Event],
    ) -> bool {
        let (mut other, mut off) = (0, 0);
        for (slot, event) in slots.iter_mut().zip(events) {
            let Some(raw) = Raw::of::<PAD>(event) else { return false };
            other |= raw.s ^ self.s;
            off |= u32::from(self.x_max).wrapping_sub(raw.x.into());
            off |= u32::from(self.y_max).wrapping_sub(raw.y.into());
            let t = self.start.wrapping_add(raw.ns / 1000);
            *slot = Event::new(t, raw.x, raw.y, Polarity::from_bit(u16::from(raw.p != 0)));
        }
        other == 0 && off >> 31 == 0
    }
}

/// An event as it stands in a message.
#[derive(Clone, Copy)]
struct Raw {
    x: u16,
    y: u16,
    s: u32,
    ns: u32,
    p: u8,
}

impl Raw {
    /// `PAD` is 0 without padding; 3 is one byte before x and two after y.
    #[inline(always)]
    fn of<const PAD: usize>(bytes: &[u8]) -> Option<Self> {
        let x = PAD.min(1);
        let u16_at = |at: usize| Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?));
        let u32_at = |at: usize| Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?));
        let (s, ns, p) = (u32_at(PAD + 4)?, u32_at(PAD + 8)?, *bytes.get(PAD + 12)?);
        Some(Self { x: u16_at(x)?, y: u16_at(x + 2)?, s, ns, p })
    }

    fn event(self, shift_us: i64) -> Event {
        let t = self.s.wrapping_mul(1_000_000).wrapping_add(self.ns / 1000).wrapping_add(shift_us as u32);
        Event::new(t, self.x, self.y, Polarity::from_bit(u16::from(self.p != 0)))
    }

    /// Time in whole µs, rounded down. ROS 2 has signed seconds, which differ only after 2038.
    #[inline(always)]
    fn us(self) -> i64 {
        i64::from(self.s) * 1_000_000 + i64::from(self.ns / 1000)
    }
}

impl EventArrays {
    /// The message ends after these bytes that were not taken.
    pub fn finish(&mut self, unread: u64) {
        match (self.left, unread) {
            (0, unread) => self.intake.other(unread),
            (_, 0) => {}
            _ => self.intake.fault(Fault::CutShort, unread),
        }
        self.left = 0;
    }
}

#[cfg(test)]
mod tests;
