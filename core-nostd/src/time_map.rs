//! Last-timestamp maps: when each pixel fired last, in few bits and without ever mistaking an old time for a new one.
//!
//! A map holds `u32` µs or `u16` ticks of 2^shift µs, both modulo their width. Ages taken by a wrapping subtraction
//! stay right because of three rules, all functions of stream time alone (never of packets or counts):
//!
//! 1. **Cells.** Stream time is cut into cells of 2^(BITS-3) ticks. When the newest time seen enters another cell,
//!    entries more than 3 cells older than its start are set to that age, which is more than any parameter.
//! 2. **Parameters** are below 2 cells (2^30 µs for `u32`); constructors refuse others.
//! 3. **Clock restart.** A time more than one cell behind the newest seen is a restart of the camera's clock: the map
//!    forgets everything.
//!
//! So a pixel that never fired is one that fired infinitely long ago, and every verdict equals that of a map of 64-bit
//! times, however long the silence: the tests hold this.
//!
//! The map has a border of one pixel, shared by the ends of neighbouring rows, that never fires: the neighbours of an
//! edge pixel need no test of their own.

use crate::compact::compact;
use crate::prefetch::prefetch;
use crate::vector::SMALL_CORE;
use crate::{Block, Event, Geometry, WrongGeometry, full_time};
use bytemuck::Pod;
use core::cell::Cell;
use core::marker::PhantomData;

mod sealed {
    pub trait Sealed {}
    impl Sealed for u16 {}
    impl Sealed for u32 {}
}

/// An entry of a time map: a time in ticks, modulo its width.
pub trait Stamp: Copy + Pod + Default + PartialEq + core::fmt::Debug + sealed::Sealed {
    /// Width.
    const BITS: u32;
    /// Largest shift from µs to ticks.
    const SHIFT_MAX: u8;
    /// Ticks in a cell; also the largest step back that is not a restart of the clock.
    const CELL: u64 = 1 << (Self::BITS - 3);
    /// Age given to entries that are older.
    const AGE_MAX: u64 = 3 * Self::CELL;
    /// Parameters in ticks are below this.
    const DT_MAX: u64 = 2 * Self::CELL;

    /// The low bits of a time in ticks.
    fn of(ticks: u64) -> Self;

    /// The stamp of an event's 32-bit time.
    fn stamp(clock: &Clock<Self>, t_us: u32) -> Self;

    /// Sets entries that are more than [`AGE_MAX`](Self::AGE_MAX) old at `start` to that age. None is 2^BITS old: they
    /// were less than four cells old by the newest time seen, and `start` is at most three after it.
    fn clamp(entries: &mut [Self], start: u64);

    /// Ticks since `then`; negative where time stepped back.
    fn age(self, then: Self) -> i32;

    /// How far within `dt` of this time `then` is: negative (all but the sign is noise) if it is longer ago.
    ///
    /// So that of several, one at least is recent if their bitwise `and` is not negative.
    fn margin(self, dt: i32, then: Self) -> i32;

    /// One of its bits, for stages that use words as sets of flags; `place` is below [`BITS`](Self::BITS).
    fn bit(self, place: u32) -> bool;

    /// The same word with one bit set to `bit`.
    fn with_bit(self, place: u32, bit: bool) -> Self;

    /// Three bits that follow each other, from bit `place` of this word on, of it and the `next`.
    fn three_bits(self, next: Self, place: u32) -> u32;

    /// 1 if `then` is longer ago than this time less `dt`, as `floor` tells: the sign of its margin.
    fn is_before(self, floor: Self) -> Self;

    /// Sum of a few small numbers.
    fn plus(self, other: Self) -> Self;

    /// The same number.
    fn number(self) -> u32;

    /// This time less `dt`.
    fn less(self, dt: i32) -> Self;
}

/// The words differ in their width, their longest tick, and how an event's time becomes one.
macro_rules! stamp {
    ($word:ident, $signed:ident, $shift_max:literal, |$clock:pat_param, $t_us:ident| $stamp:expr) => {
        impl Stamp for $word {
            const BITS: u32 = $word::BITS;
            const SHIFT_MAX: u8 = $shift_max;

            #[inline]
            fn of(ticks: u64) -> Self {
                ticks as Self
            }

            #[inline]
            fn stamp($clock: &Clock<Self>, $t_us: u32) -> Self {
                $stamp
            }

            #[inline]
            fn clamp(entries: &mut [Self], start: u64) {
                let start = Self::of(start);
                for entry in entries {
                    *entry = start.wrapping_sub(start.wrapping_sub(*entry).min(Self::AGE_MAX as Self));
                }
            }

            #[inline]
            fn age(self, then: Self) -> i32 {
                self.wrapping_sub(then) as $signed as i32
            }

            #[inline(always)]
            fn margin(self, dt: i32, then: Self) -> i32 {
                then.wrapping_sub(self.wrapping_sub(dt as Self)) as $signed as i32
            }

            #[inline]
            fn bit(self, place: u32) -> bool {
                self.wrapping_shr(place) & 1 == 1
            }

            #[inline]
            fn with_bit(self, place: u32, bit: bool) -> Self {
                (self & !Self::wrapping_shl(1, place)) | Self::wrapping_shl(bit as Self, place)
            }

            #[inline(always)]
            fn three_bits(self, next: Self, place: u32) -> u32 {
                let both = self as u64 | (next as u64) << Self::BITS;
                (both.wrapping_shr(place) & 7) as u32
            }

            #[inline(always)]
            fn is_before(self, floor: Self) -> Self {
                self.wrapping_sub(floor) >> (Self::BITS - 1)
            }

            #[inline(always)]
            fn plus(self, other: Self) -> Self {
                self.wrapping_add(other)
            }

            #[inline(always)]
            fn number(self) -> u32 {
                self as u32
            }

            #[inline(always)]
            fn less(self, dt: i32) -> Self {
                self.wrapping_sub(dt as Self)
            }
        }
    };
}

stamp!(u32, i32, 0, |_, t_us| t_us);
// A cell of 2^13 ticks must be no longer than 2^31 µs, the most that a block spans: hence ticks of 2^18 µs at most.
stamp!(u16, i16, 18, |clock, t_us| clock
    .origin
    .wrapping_add((t_us.wrapping_sub(clock.origin_us) >> clock.shift) as u16));

/// What turns an event's 32-bit time into a stamp, valid within one run of events.
#[derive(Clone, Copy, Debug)]
pub struct Clock<T> {
    /// One cell before the open one, in µs modulo 2^32.
    origin_us: u32,
    /// The same as a stamp.
    origin: T,
    shift: u32,
}

/// Why a map cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeMapError {
    /// The memory is too short.
    MemoryTooShort {
        /// Entries needed: [`TimeMap::required_len`].
        needed: usize,
        /// Entries given.
        found: usize,
    },
    /// Ticks of 2^shift µs are too long (or of a `u32` map: they are 1 µs).
    ShiftTooLarge {
        /// The shift given.
        shift: u8,
        /// The largest.
        shift_max: u8,
    },
    /// A time parameter is too long for the map's width.
    DtTooLong {
        /// The parameter in µs.
        dt_us: u32,
        /// The longest in µs.
        dt_us_max: u32,
    },
    /// A time parameter is shorter than the map's tick.
    DtBelowTick {
        /// The parameter in µs.
        dt_us: u32,
        /// The tick in µs.
        tick_us: u32,
    },
}

impl core::fmt::Display for TimeMapError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::MemoryTooShort { needed, found } => {
                write!(f, "memory of {found} entries is too short: give {needed}")
            }
            Self::ShiftTooLarge { shift, shift_max } => {
                write!(f, "ticks of 2^{shift} µs are too long for the map: at most 2^{shift_max}")
            }
            Self::DtTooLong { dt_us, dt_us_max } => {
                write!(f, "{dt_us} µs is too long for the map: at most {dt_us_max}")
            }
            Self::DtBelowTick { dt_us, tick_us } => {
                write!(f, "{dt_us} µs is less than the map's tick of {tick_us} µs: use a smaller shift")
            }
        }
    }
}

impl core::error::Error for TimeMapError {}

/// When each pixel of a sensor fired last, in the caller's memory.
///
/// ```
/// use lobula_core::{Geometry, time_map::TimeMap};
/// let geometry = Geometry::new(640, 480);
/// let memory = vec![0u16; TimeMap::<u16, ()>::required_len(geometry)];
/// let map = TimeMap::<u16, _>::try_new(geometry, 4, memory)?; // ticks of 16 µs
/// assert!(TimeMap::<u32, _>::try_new(geometry, 0, [0u32; 7]).is_err());
/// # Ok::<(), lobula_core::time_map::TimeMapError>(())
/// ```
#[derive(Clone, Debug)]
pub struct TimeMap<T, S> {
    stamps: S,
    geometry: Geometry,
    shift: u8,
    /// Newest time seen in ticks, and whether there was any.
    high: u64,
    started: bool,
    stamp: PhantomData<T>,
}

impl<T, S> TimeMap<T, S> {
    /// Entries of memory that a map of this sensor needs: its pixels and a border.
    pub const fn required_len(geometry: Geometry) -> usize {
        let rows = geometry.height as usize + 2;
        rows.saturating_mul(stride(geometry)).saturating_add(1)
    }

    /// The sensor's size.
    pub const fn geometry(&self) -> Geometry {
        self.geometry
    }
}

/// Entries from one row to the next: the pixels and one of the border.
const fn stride(geometry: Geometry) -> usize {
    geometry.width as usize + 1
}

impl<T: Stamp, S: AsRef<[T]> + AsMut<[T]>> TimeMap<T, S> {
    /// A map in `memory` of at least [`required_len`](Self::required_len) entries, whatever they hold, with ticks of
    /// 2^`shift` µs (0 for `u32`).
    pub fn try_new(geometry: Geometry, shift: u8, mut memory: S) -> Result<Self, TimeMapError> {
        if shift > T::SHIFT_MAX {
            return Err(TimeMapError::ShiftTooLarge { shift, shift_max: T::SHIFT_MAX });
        }
        let needed = Self::required_len(geometry);
        let found = memory.as_ref().len();
        // Fresh pages are touched here, at start-up, and not by the first events.
        memory
            .as_mut()
            .get_mut(..needed)
            .ok_or(TimeMapError::MemoryTooShort { needed, found })?
            .fill(T::default());
        Ok(Self { stamps: memory, geometry, shift, high: 0, started: false, stamp: PhantomData })
    }

    /// A time parameter in the map's ticks, rounded down.
    pub fn ticks(&self, dt_us: u32) -> Result<i32, TimeMapError> {
        let ticks = dt_us >> self.shift;
        if ticks as u64 >= T::DT_MAX {
            let dt_us_max = ((T::DT_MAX << self.shift) - 1).min(u32::MAX as u64) as u32;
            return Err(TimeMapError::DtTooLong { dt_us, dt_us_max });
        }
        if ticks == 0 && dt_us > 0 {
            return Err(TimeMapError::DtBelowTick { dt_us, tick_us: 1 << self.shift });
        }
        Ok(ticks as i32)
    }

    /// Stream time is at `t_us`, although no pixel fired.
    pub fn advance(&mut self, t_us: u64) {
        self.advance_ticks(t_us >> self.shift);
    }

    /// Refuses the block of another sensor, then keeps the events for which `keep` says so, in place and in order;
    /// returns how many are left. `keep` gets the pixels, the event's place among them, the event and its stamp.
    #[inline(always)]
    pub fn retain(
        &mut self,
        block: &mut Block<'_>,
        reach: Reach,
        keep: impl FnMut(&Pixels<'_, T>, usize, Event, T) -> bool,
    ) -> Result<usize, WrongGeometry> {
        self.geometry.check(block.geometry)?;
        let kept = self.thin(block.t_first, block.events_mut(), reach, keep);
        block.truncate(kept);
        Ok(kept)
    }

    /// The verdict for one event, for callers who have no block; its time is taken nearest to the newest seen.
    #[inline]
    pub fn keep(&mut self, event: Event, keep: impl FnMut(&Pixels<'_, T>, usize, Event, T) -> bool) -> bool {
        // At first any time will do whose low bits are these, but one that may step back.
        let near = if self.started { self.high << self.shift } else { (1 << 32) | event.t() as u64 };
        let t = full_time(near, event.t());
        self.thin(t, &mut [event], Reach::Pixel, keep) == 1
    }

    /// Thins events whose full times are near `anchor`; returns how many are left at the start of `events`.
    #[inline(always)]
    fn thin(
        &mut self,
        anchor: u64,
        events: &mut [Event],
        reach: Reach,
        mut keep: impl FnMut(&Pixels<'_, T>, usize, Event, T) -> bool,
    ) -> usize {
        let events = Cell::from_mut(events).as_slice_of_cells();
        let mut rest = events;
        let mut kept = 0;
        while !rest.is_empty() {
            let n = self.open(anchor, rest);
            let Some((run, after)) = rest.split_at_checked(n) else { break };
            rest = after;
            let clock = self.clock();
            let Some(pixels) = self.pixels() else { break };
            if SMALL_CORE {
                for event in run {
                    let (event, place) = (event.get(), pixels.place(event.get()) as usize);
                    if keep(&pixels, place, event, T::stamp(&clock, event.t())) {
                        if let Some(slot) = events.get(kept) {
                            slot.set(event);
                        }
                        kept += 1;
                    }
                }
                continue;
            }
            for batch in run.chunks(BATCH) {
                let mut places = [0; BATCH];
                for (place, event) in places.iter_mut().zip(batch) {
                    *place = pixels.place(event.get());
                    pixels.prefetch(*place as usize, reach);
                }
                let batch = batch.iter().map(Cell::get).zip(places.iter().copied());
                kept = compact(events, kept, batch, |event, place| {
                    keep(&pixels, place as usize, event, T::stamp(&clock, event.t()))
                });
            }
        }
        kept
    }

    /// Makes the map ready for as many of the events as share a cell, and returns how many (at least one).
    #[inline]
    fn open(&mut self, anchor: u64, events: &[Cell<Event>]) -> usize {
        if self.open_all(anchor, events) { events.len() } else { self.open_some(anchor, events) }
    }

    /// Opens all the events if they lie in the cell that is open; the one test that almost every block passes.
    #[inline]
    fn open_all(&mut self, anchor: u64, events: &[Cell<Event>]) -> bool {
        let start_us = self.cell() << self.shift;
        let cell_us = T::CELL << self.shift;
        if !self.started || anchor.wrapping_sub(start_us) >= cell_us {
            return false;
        }
        let (mut union, mut newest) = (0u32, 0i32);
        for event in events {
            let offset = event.get().t().wrapping_sub(start_us as u32);
            union |= offset;
            newest = newest.max(offset as i32);
        }
        // A cell is a power of two: if no offset has a bit above it, each lies in it.
        let all = (union as u64) < cell_us;
        if all {
            self.high = self.high.max(start_us.wrapping_add(newest as u64) >> self.shift);
        }
        all
    }

    #[cold]
    fn open_some(&mut self, anchor: u64, events: &[Cell<Event>]) -> usize {
        let mut times = events.iter().map(|event| full_time(anchor, event.get().t()) >> self.shift);
        let Some(first) = times.next() else { return 0 };
        let mut high = self.high_after(first);
        let end = cell_of::<T>(high).saturating_add(T::CELL);
        let mut n = 1;
        for t in times {
            if t >= end || t.saturating_add(T::CELL) < high {
                break;
            }
            high = high.max(t);
            n += 1;
        }
        self.advance_ticks(first);
        self.high = high;
        n
    }

    /// The newest time seen once a time `t` in ticks has been.
    fn high_after(&self, t: u64) -> u64 {
        if self.restarts(t) { t } else { self.high.max(t) }
    }

    fn restarts(&self, t: u64) -> bool {
        !self.started || t.saturating_add(T::CELL) < self.high
    }

    fn advance_ticks(&mut self, t: u64) {
        let start = cell_of::<T>(t);
        if self.restarts(t) || start.saturating_sub(self.high) > T::AGE_MAX {
            self.entries().fill(T::of(start.wrapping_sub(T::AGE_MAX)));
            self.high = t;
            self.started = true;
        } else if start > self.cell() {
            T::clamp(self.entries(), start);
        }
        self.high = self.high.max(t);
    }

    fn cell(&self) -> u64 {
        cell_of::<T>(self.high)
    }

    fn entries(&mut self) -> &mut [T] {
        self.stamps.as_mut().get_mut(..Self::required_len(self.geometry)).unwrap_or_default()
    }

    fn clock(&self) -> Clock<T> {
        let origin = self.cell().wrapping_sub(T::CELL);
        Clock { origin_us: (origin << self.shift) as u32, origin: T::of(origin), shift: self.shift as u32 }
    }

    /// The pixels, to read and write; none on a sensor without pixels.
    #[inline(always)]
    pub(crate) fn pixels(&mut self) -> Option<Pixels<'_, T>> {
        Pixels::new(Cell::from_mut(self.stamps.as_mut()).as_slice_of_cells(), self.geometry)
    }
}

fn cell_of<T: Stamp>(ticks: u64) -> u64 {
    ticks & !(T::CELL - 1)
}

/// Events whose places are looked up ahead of their verdicts, so that the memory is there when it is needed.
const BATCH: usize = 32;

/// What of a map an event's verdict needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// The entry of its pixel.
    Pixel,
    /// Those of its neighbours too.
    Neighbourhood,
}

/// The pixels of a map and their neighbours, to read and write within one run of events.
///
/// Three views of the same length, each a row further: one bounds check covers a neighbourhood.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a, T: Stamp> {
    stride: u32,
    above: &'a [Cell<T>],
    level: &'a [Cell<T>],
    below: &'a [Cell<T>],
    spare: &'a [Cell<T>],
}

impl<'a, T: Stamp> Pixels<'a, T> {
    #[inline(always)]
    fn new(words: &'a [Cell<T>], geometry: Geometry) -> Option<Self> {
        let stride = stride(geometry);
        let (entries, spare) = words.split_at_checked(TimeMap::<T, ()>::required_len(geometry))?;
        let len = entries.len().checked_sub(2 * stride)?;
        Some(Self {
            stride: stride as u32,
            above: entries.get(..len)?,
            level: entries.get(stride..stride + len)?,
            below: entries.get(2 * stride..2 * stride + len)?,
            spare,
        })
    }

    /// Where the event's pixel is; beyond all for a row off the sensor.
    #[inline(always)]
    pub(crate) fn place(&self, event: Event) -> u32 {
        (event.y() as u32).wrapping_mul(self.stride).wrapping_add(event.x() as u32)
    }

    #[inline(always)]
    fn prefetch(&self, place: usize, reach: Reach) {
        prefetch(self.level, place + 1);
        if let Reach::Neighbourhood = reach {
            prefetch(self.above, place + 1);
            prefetch(self.below, place + 1);
        }
    }

    /// The entry of the pixel at a place.
    #[inline(always)]
    pub fn pixel(&self, place: usize) -> Option<&'a Cell<T>> {
        self.level.get(place + 1)
    }

    /// The entry of the pixel at a place, and what those of its eight neighbours hold: the four beside it first.
    #[inline(always)]
    pub fn neighbourhood(&self, place: usize) -> Option<(&'a Cell<T>, [T; 8])> {
        let three = |row: &'a [Cell<T>]| row.get(place..)?.first_chunk::<3>();
        let [nw, n, ne] = three(self.above)?;
        let [w, pixel, e] = three(self.level)?;
        let [sw, s, se] = three(self.below)?;
        Some((pixel, [n, w, e, s, nw, ne, sw, se].map(Cell::get)))
    }

    /// Entries from one row to the next.
    #[inline(always)]
    pub(crate) fn stride(&self) -> usize {
        self.stride as usize
    }

    /// The memory behind the map, for what else a stage keeps.
    #[inline(always)]
    pub fn spare(&self) -> &'a [Cell<T>] {
        self.spare
    }
}
