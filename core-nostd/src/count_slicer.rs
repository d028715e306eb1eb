//! Slices of so many events: where tensors begin and end that do not go by the clock.

use core::num::NonZeroU32;

use crate::{Closed, Piece, Slicer, Span, Window};

/// Cuts a stream every so many events.
///
/// A slice's window is from its oldest event to its newest, known when it ends; that of its beginning is its first
/// event's time. No slice is empty, and none is longer than a window of a [`Slicer`] may be
/// ([`PERIOD_US_MAX`](Slicer::PERIOD_US_MAX), 18 minutes): it ends with fewer events before one that would make it so, after a
/// long silence or a restart of the camera's clock. What comes out does not depend on how the stream was cut into blocks.
///
/// ```
/// use lobula_core::{CountSlicer, Event, Geometry, Piece, Polarity, Span, Window};
/// let events = [100, 250, 400].map(|t| Event::new(t, 0, 0, Polarity::On));
/// let span = Span { t_first: 100, t_last: 400, geometry: Geometry::new(1, 1), events: &events };
/// let mut slicer = CountSlicer::try_new(2).ok_or("no slice is empty")?;
/// let mut windows = Vec::new();
/// let mut each = |piece: Piece<'_>| {
///     if let Piece::End(closed) = piece {
///         windows.push((closed.window, closed.events));
///     }
/// };
/// slicer.push(span, &mut each);
/// slicer.finish(&mut each);
/// assert_eq!(windows, [(Window { t0: 100, t1: 250 }, 2), (Window { t0: 400, t1: 400 }, 1)]);
/// # Ok::<(), &str>(())
/// ```
#[derive(Clone, Debug)]
pub struct CountSlicer {
    events: NonZeroU32,
    open: Option<Closed>,
}

impl CountSlicer {
    /// With slices of so many events, 1 at least.
    pub const fn try_new(events: u32) -> Option<Self> {
        match NonZeroU32::new(events) {
            Some(events) => Some(Self { events, open: None }),
            None => None,
        }
    }

    /// Cuts `span` and hands the pieces to `each`.
    pub fn push(&mut self, span: Span<'_>, mut each: impl FnMut(Piece<'_>)) {
        let mut rest = span.events;
        while let Some(first) = rest.first() {
            let mut open = self.open.take().unwrap_or_else(|| {
                let t = span.time(*first);
                let window = Window { t0: t, t1: t };
                each(Piece::Begin(window));
                Closed { window, events: 0, late: 0 }
            });
            let room = u64::from(self.events.get()).saturating_sub(open.events) as usize;
            let (next, _) = rest.split_at(room.min(rest.len()));
            let (joined, window) = fitting(open.window, span.with_events(next));
            let (inside, after) = rest.split_at_checked(joined).unwrap_or((rest, &[]));
            open.window = window;
            open.events += inside.len() as u64;
            if !inside.is_empty() {
                each(Piece::Events(span.with_events(inside)));
            }
            if inside.len() == room || inside.len() < next.len() {
                each(Piece::End(open));
            } else {
                self.open = Some(open);
            }
            rest = after;
        }
    }

    /// The stream has ended: closes the slice that is not full.
    pub fn finish(&mut self, mut each: impl FnMut(Piece<'_>)) {
        if let Some(open) = self.open.take() {
            each(Piece::End(open));
        }
    }
}

/// How many of the first events a slice that has this window can have beside its own, and its window then.
fn fitting(window: Window, span: Span<'_>) -> (usize, Window) {
    let fits = |window: &Window| window.length_us() <= Slicer::PERIOD_US_MAX.into();
    let mut longer = window;
    for event in span.events {
        longer = longer.with(span.time(*event));
    }
    // Nearly always: without a way out, the loop above is short.
    if fits(&longer) {
        return (span.events.len(), longer);
    }
    let each = span.events.iter().scan(window, |window, event| {
        *window = window.with(span.time(*event));
        Some(*window)
    });
    each.take_while(fits).fold((0, window), |(events, _), window| (events + 1, window))
}
