//! Windows that overlap: where a view's tensors begin and end that come more often than a window is long.
//!
//! The stream is cut into strides, by a [`Slicer`] at a grid of time or by a [`CountSlicer`] every so many events; a window
//! is so many strides in a row. The events of a window are kept, so that each window can be drawn from the one before or,
//! where its definition does not allow that, anew: see [`Sliding`](crate::representation::Sliding).

use crate::representation::Overlap;
use crate::{BadPeriod, Closed, CountSlicer, Event, Geometry, Piece, Slicer, Span, Window, WrongGeometry};

/// How long windows are, and how far apart they begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grid {
    /// By stream time: windows begin at multiples of the stride.
    Time {
        /// Length of a window in µs, 1 to [`Slicer::PERIOD_US_MAX`].
        period_us: u32,
        /// From the start of one window to that of the next, in µs. It divides `period_us`.
        stride_us: u32,
    },
    /// By number: the first window begins with the first event.
    Events {
        /// Events of a window, 1 at least.
        slice_events: u32,
        /// From the first event of one window to that of the next. It divides `slice_events`.
        stride_events: u32,
    },
}

impl Grid {
    /// The most strides in a window: as many empty ones as a slicer hands out, so that no window is left out but empty
    /// ones.
    pub const STRIDES_MAX: u32 = Slicer::EMPTY_MAX as u32;

    /// How many strides a window has, 1 to [`STRIDES_MAX`](Self::STRIDES_MAX).
    pub const fn strides(self) -> Result<usize, BadGrid> {
        let (window, stride) = match self {
            Self::Time { period_us, .. } if period_us == 0 || period_us > Slicer::PERIOD_US_MAX => {
                return Err(BadGrid::Period(BadPeriod { period_us }));
            }
            Self::Time { period_us, stride_us } => (period_us, stride_us),
            Self::Events { slice_events, stride_events } => (slice_events, stride_events),
        };
        match (window.checked_rem(stride), window.checked_div(stride)) {
            (Some(0), Some(strides @ 1..=Self::STRIDES_MAX)) => Ok(strides as usize),
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
            Self::Stride(grid) => {
                let (key, stride, window, unit) = match grid {
                    Grid::Time { period_us, stride_us } => ("stride_us", stride_us, period_us, "µs"),
                    Grid::Events { slice_events, stride_events } => {
                        ("stride_events", stride_events, slice_events, "events")
                    }
                };
                let most = Grid::STRIDES_MAX;
                write!(
                    f,
                    "{key} = {stride} is no stride of windows of {window} {unit}: give a whole part of them, \
                     1/{most} at least"
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
    /// Its start, or where it is one of events the time of the oldest.
    t0: u64,
    /// Events that came in it.
    events: u64,
    /// How many of them are kept.
    kept: usize,
}

/// Cuts a stream into windows that overlap.
///
/// - The first window begins with the stride of the first event, and the last is the first that reaches the stream's
///   end: as many as there are strides, less those of a window, and one. Of a stream shorter than a window there is one.
/// - An event belongs to the stride that was open when it came, and to every window that has that stride; in one of time
///   that begins after it, it counts at its start. [`Closed::late`] tells each event that came after its stride had closed
///   once, in the first window that has it.
/// - A window of events is from its oldest event to its newest, but ends no sooner than the one before it. The last has
///   fewer events if they do not fill its stride.
/// - The events of a window are kept in memory of the caller's. Those that there is no room for are in no window, but in
///   [`Closed::events`]; they are [counted](Self::overflowed).
/// - A restart of the camera's clock ends the windows, and new ones begin; so does a silence after which a window of events
///   would be longer than [`Slicer::PERIOD_US_MAX`]. Of a long silence the rest of the empty strides is left out and
///   [counted](Self::skipped).
///
/// A stride as long as the window gives the windows of a [`Slicer`] or a [`CountSlicer`], handed out at their ends.
///
/// ```
/// use lobula_core::{Event, Geometry, Grid, Polarity, Slide, SlidingSlicer, Span, Stride};
/// let geometry = Geometry::new(1, 1);
/// let events = [1_900, 2_500, 4_100].map(|t| Event::new(t, 0, 0, Polarity::On));
/// let span = Span { t_first: 1_900, t_last: 4_100, geometry, events: &events };
/// let grid = Grid::Time { period_us: 2_000, stride_us: 1_000 };
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
    strides: Strides,
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
        Ok(Self { strides: Strides::try_new(grid)?, kept: Kept::new(grid, geometry, strides, events) })
    }

    /// Events that came after their stride had closed, since the start.
    pub const fn late(&self) -> u64 {
        self.strides.late()
    }

    /// Empty windows left out, since the start.
    pub const fn skipped(&self) -> u64 {
        self.strides.skipped()
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
        self.strides.push(span, |piece| self.kept.take(piece, &mut each));
        Ok(())
    }

    /// Stream time has come to `now` µs, also without events: see [`Slicer::advance`].
    pub fn advance(&mut self, now: u64, mut each: impl FnMut(&Slide<'_>)) {
        self.strides.advance(now, |piece| self.kept.take(piece, &mut each));
    }

    /// The stream has ended at `now` µs: hands out the windows up to the first that reaches `now`. A stream pushed after
    /// it starts anew.
    pub fn finish(&mut self, now: u64, mut each: impl FnMut(&Slide<'_>)) {
        self.strides.finish(now, |piece| self.kept.take(piece, &mut each));
        self.kept.cut(&mut each);
    }
}

/// Cuts a stream into pieces one after the other.
#[derive(Clone, Debug)]
pub(crate) enum Strides {
    Time(Slicer),
    Events(CountSlicer),
}

impl Strides {
    fn try_new(grid: Grid) -> Result<Self, BadGrid> {
        match grid {
            Grid::Time { stride_us, .. } => {
                Slicer::try_new(stride_us).map(Self::Time).map_err(BadGrid::Period)
            }
            Grid::Events { stride_events, .. } => {
                CountSlicer::try_new(stride_events).map(Self::Events).ok_or(BadGrid::Stride(grid))
            }
        }
    }

    pub(crate) fn push(&mut self, span: Span<'_>, each: impl FnMut(Piece<'_>)) {
        match self {
            Self::Time(slicer) => slicer.push(span, each),
            Self::Events(slicer) => slicer.push(span, each),
        }
    }

    /// Those of events know no time.
    pub(crate) fn advance(&mut self, now: u64, each: impl FnMut(Piece<'_>)) {
        if let Self::Time(slicer) = self {
            slicer.advance(now, each);
        }
    }

    pub(crate) fn finish(&mut self, now: u64, each: impl FnMut(Piece<'_>)) {
        match self {
            Self::Time(slicer) => slicer.finish(now, each),
            Self::Events(slicer) => slicer.finish(each),
        }
    }

    pub(crate) const fn late(&self) -> u64 {
        match self {
            Self::Time(slicer) => slicer.late(),
            Self::Events(_) => 0,
        }
    }

    pub(crate) const fn skipped(&self) -> u64 {
        match self {
            Self::Time(slicer) => slicer.skipped(),
            Self::Events(_) => 0,
        }
    }
}

/// What is called with each window: not a type parameter, so that what is below is compiled once.
type Each<'a> = &'a mut dyn FnMut(&Slide<'_>);

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
    /// End of the last complete one, or of the latest of them.
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
    fn take(&mut self, piece: Piece<'_>, each: Each<'_>) {
        match (piece, self.grid) {
            // The clock has restarted.
            (Piece::Begin(stride), Grid::Time { .. }) if stride.t0 < self.t1 => self.cut(each),
            (Piece::Begin(_), _) => {}
            (Piece::Events(span), _) => self.keep(span.events),
            (Piece::End(closed), Grid::Events { .. }) if !self.reaches(closed.window) => {
                self.cut(&mut *each);
                self.end(closed, each);
            }
            (Piece::End(closed), _) => self.end(closed, each),
        }
    }

    /// Whether a window can have this stride of events beside those that are complete: 32 bits tell its times apart then.
    fn reaches(&self, stride: Window) -> bool {
        let t0 = self.oldest_time().map_or(stride.t0, |oldest| oldest.min(stride.t0));
        Window { t0, t1: self.t1.max(stride.t1) }.length_us() <= Slicer::PERIOD_US_MAX.into()
    }

    /// The start of the complete stride that begins first.
    fn oldest_time(&self) -> Option<u64> {
        let (before, from) = self.strides.as_ref().split_at_checked(self.oldest)?;
        from.iter().chain(before).take(self.complete).map(|stride| stride.t0).min()
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
    fn end(&mut self, closed: Closed, each: Each<'_>) {
        let Closed { window: stride, events, late } = closed;
        let newest = Stride { t0: stride.t0, events, kept: core::mem::take(&mut self.open) };
        let strides = self.strides.as_mut();
        let all = strides.len();
        if let Some(slot) = strides.get_mut(wrapped(self.oldest + self.complete, all)) {
            *slot = newest;
        }
        self.complete += 1;
        self.len += newest.kept;
        self.came += newest.events;
        self.late += late;
        self.t1 = self.t1.max(stride.t1);
        if self.complete < all {
            return;
        }
        let oldest = self.strides.as_ref().get(self.oldest).copied().unwrap_or_default();
        self.hand_out(newest.kept, oldest.kept, each);
        self.oldest = wrapped(self.oldest + 1, all);
        self.complete -= 1;
        self.start = wrapped(self.start + oldest.kept, self.events.as_ref().len());
        self.len -= oldest.kept.min(self.len);
        self.came -= oldest.events.min(self.came);
    }

    /// No stride follows: if there was no window yet, what there is of the first one is it. Forgets everything.
    /// Events of the open stride stay.
    fn cut(&mut self, each: Each<'_>) {
        if self.is_first && self.complete > 0 {
            self.hand_out(self.len, 0, each);
        }
        (self.oldest, self.complete, self.t1) = (0, 0, 0);
        self.start = wrapped(self.start + self.len, self.events.as_ref().len());
        (self.len, self.came) = (0, 0);
        self.is_first = true;
    }

    /// That of the complete strides, of which there is one at least.
    fn window(&self) -> Window {
        match self.grid {
            Grid::Time { period_us, stride_us } => {
                let t0 = self.t1.saturating_sub(self.complete as u64 * u64::from(stride_us));
                Window { t0, t1: t0.saturating_add(period_us.into()) }
            }
            Grid::Events { .. } => Window { t0: self.oldest_time().unwrap_or(self.t1), t1: self.t1 },
        }
    }

    fn hand_out(&mut self, newest: usize, leave: usize, each: Each<'_>) {
        let window = self.window();
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
        // The window's end is within 2^31 µs of every event in it, the latest and the oldest of them too.
        let (t1, geometry) = (self.closed.window.t1, self.geometry);
        [straight, rest].map(|events| Span { t_first: t1, t_last: t1, geometry, events })
    }
}
