//! Windows that overlap: where a view's tensors begin and end that come more often than a window is long.
//!
//! Stream time is cut at a grid of strides by a [`Slicer`]; a window is so many strides in a row. The events of a
//! window are kept, so that each window can be drawn from the one before or, where its definition does not allow that,
//! anew: see [`Sliding`](crate::representation::Sliding).

use crate::representation::Overlap;
use crate::{BadPeriod, Closed, Event, Geometry, Piece, Slicer, Span, Window, WrongGeometry};

/// How long windows are, and how far apart they begin: at multiples of `stride_us`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Length of a window in µs, 1 to [`Slicer::PERIOD_US_MAX`].
    pub period_us: u32,
    /// From the start of one window to that of the next, in µs. It divides `period_us`.
    pub stride_us: u32,
}

impl Grid {
    /// The most strides in a window: as many empty ones as a slicer hands out, so that no window is left out but empty
    /// ones.
    pub const STRIDES_MAX: u32 = Slicer::EMPTY_MAX as u32;

    /// How many strides a window has, 1 to [`STRIDES_MAX`](Self::STRIDES_MAX).
    pub const fn strides(self) -> Result<usize, BadGrid> {
        let Self { period_us, stride_us } = self;
        if period_us == 0 || period_us > Slicer::PERIOD_US_MAX {
            return Err(BadGrid::Period(BadPeriod { period_us }));
        }
        match period_us.checked_rem(stride_us) {
            Some(0) if period_us / stride_us <= Self::STRIDES_MAX => Ok((period_us / stride_us) as usize),
            _ => Err(BadGrid::Stride(self)),
        }
    }
}

/// Why there can be no windows of this grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadGrid {
    /// The length of a window.
    Period(BadPeriod),
    /// The stride does not divide the window, or is too short for it.
    Stride(Grid),
    /// The memory of the strides has another length than [`Grid::strides`].
    StridesLen {
        /// Strides of a window.
        expected: usize,
        /// Strides given.
        found: usize,
    },
}

impl core::fmt::Display for BadGrid {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Period(error) => error.fmt(f),
            Self::Stride(Grid { period_us, stride_us }) => {
                let most = Grid::STRIDES_MAX;
                write!(
                    f,
                    "stride_us = {stride_us} is no stride of windows of {period_us} µs: give a whole part of \
                     them, 1/{most} at least"
                )
            }
            Self::StridesLen { expected, found } => {
                write!(f, "memory of {found} strides was given where {expected} are needed")
            }
        }
    }
}

impl core::error::Error for BadGrid {}

/// What is known of a complete stride: memory of a [`SlidingSlicer`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Stride {
    /// Events that came in it.
    events: u64,
    /// How many of them are kept.
    kept: usize,
}

/// Cuts a stream into windows that overlap.
///
/// - The first window begins with the stride of the first event, and the last is the first that reaches the stream's
///   end: as many as there are strides, less those of a window, and one. Of a stream shorter than a window there is one.
/// - An event belongs to the stride that was open when it came, as with a [`Slicer`], and to every window that has that
///   stride; in one that begins after it, it counts at its start. [`Closed::late`] tells each event that came after its
///   stride had closed once, in the first window that has it.
/// - The events of a window are kept in memory of the caller's. Those that there is no room for are in no window, but in
///   [`Closed::events`]; they are [counted](Self::overflowed).
/// - A restart of the camera's clock ends the windows, and new ones begin. Of a long silence the rest of the empty strides
///   is left out and [counted](Self::skipped).
///
/// A stride as long as the window gives the windows of a [`Slicer`], handed out at their ends.
///
/// ```
/// use lobula_core::{Event, Geometry, Grid, Polarity, Slide, SlidingSlicer, Span, Stride};
/// let geometry = Geometry::new(1, 1);
/// let events = [1_900, 2_500, 4_100].map(|t| Event::new(t, 0, 0, Polarity::On));
/// let span = Span { t_first: 1_900, t_last: 4_100, geometry, events: &events };
/// let grid = Grid { period_us: 2_000, stride_us: 1_000 };
/// let mut slicer = SlidingSlicer::try_new(grid, geometry, [Stride::default(); 2], [Event::default(); 64])?;
/// let mut counts = Vec::new();
/// let mut each = |slide: &Slide<'_>| counts.push((slide.closed.window.t0, slide.closed.events));
/// slicer.push(span, &mut each)?;
/// slicer.finish(4_100, &mut each);
/// assert_eq!(counts, [(1_000, 2), (2_000, 1), (3_000, 1)]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SlidingSlicer<S, E> {
    slicer: Slicer,
    kept: Kept<S, E>,
}

impl<S: AsRef<[Stride]> + AsMut<[Stride]>, E: AsRef<[Event]> + AsMut<[Event]>> SlidingSlicer<S, E> {
    /// For a sensor of this size, over memory for the [strides](Grid::strides) of a window and for as many events as a
    /// window may have, whatever they hold.
    pub fn try_new(grid: Grid, geometry: Geometry, strides: S, events: E) -> Result<Self, BadGrid> {
        let (expected, found) = (grid.strides()?, strides.as_ref().len());
        if expected != found {
            return Err(BadGrid::StridesLen { expected, found });
        }
        let slicer = Slicer::try_new(grid.stride_us).map_err(BadGrid::Period)?;
        Ok(Self { slicer, kept: Kept::new(grid, geometry, strides, events) })
    }

    /// Events that came after their stride had closed, since the start.
    pub const fn late(&self) -> u64 {
        self.slicer.late()
    }

    /// Empty windows left out, since the start.
    pub const fn skipped(&self) -> u64 {
        self.slicer.skipped()
    }

    /// Events that there was no room for, since the start.
    pub const fn overflowed(&self) -> u64 {
        self.kept.overflowed
    }

    /// Keeps the events of `span` and hands each window that ends to `each`.
    pub fn push(&mut self, span: Span<'_>, mut each: impl FnMut(&Slide<'_>)) -> Result<(), WrongGeometry> {
        let (expected, found) = (self.kept.geometry, span.geometry);
        if expected != found {
            return Err(WrongGeometry { expected, found });
        }
        self.slicer.push(span, |piece| self.kept.take(piece, &mut each));
        Ok(())
    }

    /// Stream time has come to `now` µs, also without events: see [`Slicer::advance`].
    pub fn advance(&mut self, now: u64, mut each: impl FnMut(&Slide<'_>)) {
        self.slicer.advance(now, |piece| self.kept.take(piece, &mut each));
    }

    /// The stream has ended at `now` µs: hands out the windows up to the first that reaches `now`. A stream pushed after
    /// it starts anew.
    pub fn finish(&mut self, now: u64, mut each: impl FnMut(&Slide<'_>)) {
        self.slicer.finish(now, |piece| self.kept.take(piece, &mut each));
        self.kept.cut(&mut each);
    }
}

/// The strides of the window to come, with their events: the oldest first, each in a ring.
#[derive(Clone, Debug)]
struct Kept<S, E> {
    grid: Grid,
    geometry: Geometry,
    strides: S,
    /// Place of the oldest stride.
    oldest: usize,
    /// How many are complete.
    complete: usize,
    /// End of the last complete one.
    t1: u64,
    events: E,
    /// Place of the oldest event.
    start: usize,
    /// Events kept of the complete strides.
    len: usize,
    /// Events kept of the open one; they are behind the others.
    open: usize,
    /// Events that came in the complete strides.
    came: u64,
    /// Events that came late since the window before ended.
    late: u64,
    /// Whether no window was handed out since the start.
    is_first: bool,
    overflowed: u64,
}

impl<S: AsRef<[Stride]> + AsMut<[Stride]>, E: AsRef<[Event]> + AsMut<[Event]>> Kept<S, E> {
    fn new(grid: Grid, geometry: Geometry, strides: S, events: E) -> Self {
        Self {
            grid,
            geometry,
            strides,
            oldest: 0,
            complete: 0,
            t1: 0,
            events,
            start: 0,
            len: 0,
            open: 0,
            came: 0,
            late: 0,
            is_first: true,
            overflowed: 0,
        }
    }

    /// A piece of a stride.
    fn take(&mut self, piece: Piece<'_>, each: &mut impl FnMut(&Slide<'_>)) {
        match piece {
            // The clock has restarted.
            Piece::Begin(stride) if stride.t0 < self.t1 => self.cut(each),
            Piece::Begin(_) => {}
            Piece::Events(span) => self.keep(span.events),
            Piece::End(closed) => self.end(closed, each),
        }
    }

    fn keep(&mut self, events: &[Event]) {
        let ring = self.events.as_mut();
        let used = self.len + self.open;
        let (kept, beyond) = events.split_at(events.len().min(ring.len().saturating_sub(used)));
        let (end, begin) = ring.split_at_mut(wrapped(self.start + used, ring.len()).min(ring.len()));
        let (straight, rest) = kept.split_at(kept.len().min(begin.len()));
        for (part, place) in [(straight, begin), (rest, end)] {
            place.iter_mut().zip(part).for_each(|(slot, event)| *slot = *event);
        }
        self.open += kept.len();
        self.overflowed += beyond.len() as u64;
    }

    /// The open stride is complete, and with it a window, if it has them all.
    fn end(&mut self, closed: Closed, each: &mut impl FnMut(&Slide<'_>)) {
        let newest = Stride { events: closed.events, kept: core::mem::take(&mut self.open) };
        let strides = self.strides.as_mut();
        let all = strides.len();
        if let Some(slot) = strides.get_mut(wrapped(self.oldest + self.complete, all)) {
            *slot = newest;
        }
        self.complete += 1;
        self.len += newest.kept;
        self.came += newest.events;
        self.late += closed.late;
        self.t1 = closed.window.t1;
        if self.complete < all {
            return;
        }
        let oldest = self.strides.as_ref().get(self.oldest).copied().unwrap_or_default();
        let window = Window { t0: self.t1.saturating_sub(self.grid.period_us.into()), t1: self.t1 };
        self.hand_out(window, newest.kept, oldest.kept, each);
        self.oldest = wrapped(self.oldest + 1, all);
        self.complete -= 1;
        self.start = wrapped(self.start + oldest.kept, self.events.as_ref().len());
        self.len -= oldest.kept.min(self.len);
        self.came -= oldest.events.min(self.came);
    }

    /// No stride follows: if there was no window yet, what there is of the first one is it. Forgets everything.
    fn cut(&mut self, each: &mut impl FnMut(&Slide<'_>)) {
        if self.is_first && self.complete > 0 {
            let t0 = self.t1.saturating_sub(self.complete as u64 * u64::from(self.grid.stride_us));
            let window = Window { t0, t1: t0.saturating_add(self.grid.period_us.into()) };
            self.hand_out(window, self.len, 0, each);
        }
        (self.oldest, self.complete, self.t1) = (0, 0, 0);
        (self.start, self.len, self.open, self.came) = (0, 0, 0, 0);
        self.is_first = true;
    }

    fn hand_out(&mut self, window: Window, newest: usize, leave: usize, each: &mut impl FnMut(&Slide<'_>)) {
        let is_first = core::mem::replace(&mut self.is_first, false);
        let late = core::mem::take(&mut self.late);
        each(&Slide {
            closed: Closed { window, events: self.came, late },
            is_first,
            geometry: self.geometry,
            ring: self.events.as_ref(),
            start: self.start,
            len: self.len,
            come: if is_first { self.len } else { newest },
            leave,
        });
    }
}

/// A place in a ring of `len`, of a number that may be one turn ahead.
const fn wrapped(at: usize, len: usize) -> usize {
    if at < len { at } else { at - len }
}

/// A window that has closed, one of several that overlap, with its events.
#[derive(Clone, Copy, Debug)]
pub struct Slide<'a> {
    /// The window, and what fell into it.
    pub closed: Closed,
    is_first: bool,
    geometry: Geometry,
    ring: &'a [Event],
    start: usize,
    len: usize,
    come: usize,
    leave: usize,
}

impl<'a> Slide<'a> {
    /// Whether it does not follow from the window handed out before it: after a start or a restart.
    pub const fn is_first(&self) -> bool {
        self.is_first
    }

    /// How many events it has that were kept.
    pub const fn len(&self) -> usize {
        self.len
    }

    /// Whether it has none.
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Its events in stream order, in two parts. Those older than it count at its start.
    pub fn events(&self) -> [Span<'a>; 2] {
        self.part(0, self.len)
    }

    /// The newest of them: those that the window before did not have.
    pub fn coming(&self) -> [Span<'a>; 2] {
        self.part(self.len.saturating_sub(self.come), self.come)
    }

    /// The oldest of them: those that the next window will not have.
    pub fn leaving(&self) -> [Span<'a>; 2] {
        self.part(0, self.leave)
    }

    /// The pieces to draw it from, as a [`Slicer`] would hand them out: all of its events, or those that come where the
    /// others are remembered.
    pub fn pieces(&self, overlap: Overlap, mut each: impl FnMut(Piece<'_>)) {
        let events = if overlap == Overlap::Memory { self.coming() } else { self.events() };
        each(Piece::Begin(self.closed.window));
        for span in events.into_iter().filter(|span| !span.events.is_empty()) {
            each(Piece::Events(span));
        }
        each(Piece::End(self.closed));
    }

    fn part(&self, from: usize, len: usize) -> [Span<'a>; 2] {
        let behind = self.ring.get(wrapped(self.start + from, self.ring.len())..).unwrap_or_default();
        let straight = behind.get(..len.min(behind.len())).unwrap_or_default();
        let rest = self.ring.get(..len - straight.len()).unwrap_or_default();
        // The window's end is within 2^31 µs of every event in it, the latest of them too.
        let (t1, geometry) = (self.closed.window.t1, self.geometry);
        [straight, rest].map(|events| Span { t_first: t1, t_last: t1, geometry, events })
    }
}
