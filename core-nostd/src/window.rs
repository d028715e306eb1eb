//! Windows of stream time: where a view's tensors begin and end.
//!
//! Windows are half open, `[t0, t1)`, on a grid whose origin is a multiple of the period. The first is the one that
//! holds the first event. What comes out depends on the events (and the times given to [`Slicer::advance`]) alone,
//! never on how the stream was cut into blocks.

use core::num::{NonZeroU32, NonZeroU64};

use crate::{Event, Span, Window};

/// A step back in time by more than this is a restart of the camera's clock and not jitter.
const RESTART_US: u64 = 1 << 29;

/// Events looked at in one go for the first that leaves the window.
const STRIDE: usize = 256;

impl Window {
    /// One that reaches to the time `t` too.
    pub(crate) fn with(self, t: u64) -> Self {
        Self { t0: self.t0.min(t), t1: self.t1.max(t) }
    }

    /// From its start to its end, in µs.
    pub(crate) const fn length_us(self) -> u64 {
        self.t1.saturating_sub(self.t0)
    }
}

/// What a [`Slicer`] hands out, in this order for each window: `Begin`, any number of `Events`, `End`.
#[derive(Clone, Copy, Debug)]
pub enum Piece<'a> {
    /// A window opens. It comes just before the window's first events, or its end when it has none.
    Begin(Window),
    /// Events of the open window, in stream order, never none. Those older than it count at its start.
    Events(Span<'a>),
    /// The window closes.
    End(Closed),
}

/// A window that has closed, and what fell into it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Closed {
    /// The window.
    pub window: Window,
    /// Its events, the late ones included.
    pub events: u64,
    /// Events older than the window: they count at its start.
    pub late: u64,
}

/// Why there can be no slicer of this period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadPeriod {
    /// The period asked for, in µs.
    pub period_us: u32,
}

impl core::fmt::Display for BadPeriod {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "period_us = {} is not a period: give 1 to {} µs", self.period_us, Slicer::PERIOD_US_MAX)
    }
}

impl core::error::Error for BadPeriod {}

#[derive(Clone, Copy, Debug)]
struct Open {
    window: Window,
    /// Whether `Begin` was handed out.
    begun: bool,
    events: u64,
    late: u64,
}

impl Open {
    const fn new(window: Window) -> Self {
        Self { window, begun: false, events: 0, late: 0 }
    }
}

/// Cuts blocks at the grid of a view.
///
/// - The first event, in stream order, at or after the end of the open window closes it.
/// - An event older than the open window counts into it, and in [`late`](Self::late); one that is older by more than
///   2^29 µs tells of a restart of the camera's clock: the window closes and the one that holds the event opens.
/// - A still scene gives windows at the same rate as a busy one; of more than [`EMPTY_MAX`](Self::EMPTY_MAX) empty
///   ones in a row the rest is left out and [counted](Self::skipped).
///
/// ```
/// use lobula_core::{Event, Geometry, Piece, Polarity, Slicer, Span};
/// let events = [1_900, 2_500, 4_100].map(|t| Event::new(t, 0, 0, Polarity::On));
/// let span = Span { t_first: 1_900, t_last: 4_100, geometry: Geometry::new(1, 1), events: &events };
/// let mut slicer = Slicer::try_new(1_000)?;
/// let mut counts = Vec::new();
/// let mut each = |piece: Piece<'_>| {
///     if let Piece::End(closed) = piece {
///         counts.push((closed.window.t0, closed.events));
///     }
/// };
/// slicer.push(span, &mut each);
/// slicer.finish(4_100, &mut each);
/// assert_eq!(counts, [(1_000, 1), (2_000, 1), (3_000, 0), (4_000, 1)]);
/// # Ok::<(), lobula_core::BadPeriod>(())
/// ```
#[derive(Clone, Debug)]
pub struct Slicer {
    period_us: NonZeroU32,
    open: Option<Open>,
    empty_run: u64,
    late: u64,
    skipped: u64,
}

impl Slicer {
    /// The greatest period, in µs.
    pub const PERIOD_US_MAX: u32 = (1 << 30) - 1;

    /// How many empty windows in a row are handed out.
    pub const EMPTY_MAX: u64 = 1024;

    /// How far stream time must be past a window's end before [`advance`](Self::advance) closes it, in µs: more than
    /// cameras' clocks step back between words (11 µs were seen), so that an event just behind is not made late.
    pub const SLACK_US: u64 = 1_000;

    /// A slicer with windows of `period_us`, 1 to [`PERIOD_US_MAX`](Self::PERIOD_US_MAX).
    pub const fn try_new(period_us: u32) -> Result<Self, BadPeriod> {
        match NonZeroU32::new(period_us) {
            Some(period) if period_us <= Self::PERIOD_US_MAX => {
                Ok(Self { period_us: period, open: None, empty_run: 0, late: 0, skipped: 0 })
            }
            _ => Err(BadPeriod { period_us }),
        }
    }

    /// Length of a window in µs.
    pub const fn period_us(&self) -> u32 {
        self.period_us.get()
    }

    /// Events that came after their window had closed, since the start.
    pub const fn late(&self) -> u64 {
        self.late
    }

    /// Empty windows left out, since the start.
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }

    /// The open window, once there was an event.
    pub fn window(&self) -> Option<Window> {
        self.open.map(|open| open.window)
    }

    /// Cuts `span` and hands the pieces to `each`.
    pub fn push(&mut self, span: Span<'_>, mut each: impl FnMut(Piece<'_>)) {
        let mut rest = span.events;
        while let Some(&first) = rest.first() {
            let window = self.enter(span.time(first), &mut each);
            let bounds = Bounds::new(window, span.t_first);
            let (inside, after) = bounds.split(rest);
            self.give(span.with_events(inside), bounds.late(inside), &mut each);
            rest = after;
        }
    }

    /// Stream time has come to `now` µs, also without events: closes the windows whose end lies
    /// [`SLACK_US`](Self::SLACK_US) or more behind. Before the first event it does nothing.
    pub fn advance(&mut self, now: u64, each: impl FnMut(Piece<'_>)) {
        self.close_until(now.saturating_sub(Self::SLACK_US), each);
    }

    /// The stream has ended at `now` µs: closes all windows up to the one that holds `now`, that one included. What
    /// comes out in all is the same whether [`advance`](Self::advance) was called on the way or not. A stream pushed
    /// after it starts anew.
    pub fn finish(&mut self, now: u64, mut each: impl FnMut(Piece<'_>)) {
        self.close_until(now, &mut each);
        if let Some(open) = self.open.take() {
            self.close(open, &mut each);
        }
        self.empty_run = 0;
    }

    /// Makes the window that takes an event of time `t` the open one.
    fn enter(&mut self, t: u64, each: &mut impl FnMut(Piece<'_>)) -> Window {
        let window = match self.open {
            None => self.window_at(t),
            Some(open) if t >= open.window.t1 => {
                self.close_until(t, each);
                self.window_at(t)
            }
            Some(open) if t.saturating_add(RESTART_US) < open.window.t0 => {
                self.close(open, each);
                self.window_at(t)
            }
            Some(open) => return open.window,
        };
        self.open = Some(Open::new(window));
        window
    }

    /// Closes every window that ends at or before `t` and opens the one that holds it.
    fn close_until(&mut self, t: u64, mut each: impl FnMut(Piece<'_>)) {
        let Some(open) = self.open.filter(|open| open.window.t1 <= t) else { return };
        self.close(open, &mut each);
        let target = self.window_at(t);
        let mut t0 = open.window.t1;
        while t0 < target.t0 && self.empty_run < Self::EMPTY_MAX {
            let window = self.window_at(t0);
            self.close(Open::new(window), &mut each);
            t0 = window.t1;
        }
        self.skipped += target.t0.saturating_sub(t0) / NonZeroU64::from(self.period_us);
        self.open = Some(Open::new(target));
    }

    /// Hands out the end of a window, and its beginning if that is still due.
    fn close(&mut self, open: Open, each: &mut impl FnMut(Piece<'_>)) {
        let Open { window, begun, events, late } = open;
        if !begun {
            if self.empty_run >= Self::EMPTY_MAX {
                self.skipped += 1;
                return;
            }
            self.empty_run += 1;
            each(Piece::Begin(window));
        }
        each(Piece::End(Closed { window, events, late }));
    }

    /// Hands out events of the open window.
    fn give(&mut self, span: Span<'_>, late: u64, each: &mut impl FnMut(Piece<'_>)) {
        let Some(open) = &mut self.open else { return };
        if !open.begun {
            open.begun = true;
            each(Piece::Begin(open.window));
        }
        open.events += span.events.len() as u64;
        open.late += late;
        self.late += late;
        self.empty_run = 0;
        each(Piece::Events(span));
    }

    /// The window of the grid that holds `t`.
    fn window_at(&self, t: u64) -> Window {
        let period = NonZeroU64::from(self.period_us);
        let t0 = t - t % period;
        Window { t0, t1: t0.saturating_add(period.get()) }
    }
}

/// A window's bounds as distances from a block's anchor, so that 32 bits are enough for each event.
#[derive(Clone, Copy)]
struct Bounds {
    anchor: u32,
    /// Below it, the clock has restarted.
    restart: i32,
    /// Below it, an event is late.
    first: i32,
    /// Above it, an event is of a later window.
    last: i32,
}

impl Bounds {
    fn new(window: Window, anchor: u64) -> Self {
        let from_anchor = |t: u64| {
            let distance = i128::from(t) - i128::from(anchor);
            distance.clamp(i32::MIN.into(), i32::MAX.into()) as i32
        };
        Self {
            anchor: anchor as u32,
            restart: from_anchor(window.t0.saturating_sub(RESTART_US)),
            first: from_anchor(window.t0),
            last: from_anchor(window.t1.saturating_sub(1)),
        }
    }

    #[inline]
    fn distance(&self, event: Event) -> i32 {
        event.t().wrapping_sub(self.anchor) as i32
    }

    /// Splits before the first event that is not the window's; the first of all was found to be.
    fn split<'a>(&self, events: &'a [Event]) -> (&'a [Event], &'a [Event]) {
        let leaves = |event: &Event| {
            let distance = self.distance(*event);
            distance > self.last || distance < self.restart
        };
        // Most blocks lie in one window whole: a pass without an early exit vectorises, a search does not.
        let stay = |chunk: &&[Event]| !chunk.iter().fold(false, |any, event| any | leaves(event));
        let start = events.chunks(STRIDE).take_while(stay).map(<[Event]>::len).sum::<usize>();
        let end =
            events.iter().skip(start.max(1)).position(leaves).map_or(events.len(), |i| start.max(1) + i);
        events.split_at_checked(end).unwrap_or((events, &[]))
    }

    fn late(&self, events: &[Event]) -> u64 {
        events.iter().map(|event| u64::from(self.distance(*event) < self.first)).sum()
    }
}
