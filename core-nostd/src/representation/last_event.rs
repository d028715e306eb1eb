//! Ages from the newest event: a slice's events are kept until the newest is known, and drawn then.
//!
//! Other libraries count ages from the newest event of a slice, and cut slices by number of events; here the window's end
//! is the reference. Both meet in a window that ends at the newest event.

use crate::representation::{BadRepresentation, Overlap, check};
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Reaches further back than this from the newest event are 2^30 µs.
const WINDOW_US_MAX: u32 = 1 << 30;

/// A slice that ends by no more than this before the one before it did ends where that did: clocks step back so far.
const STEP_BACK_US: u64 = crate::Slicer::SLACK_US;

/// The events of a slice, in bounded memory of the caller's.
///
/// Its window ends at the newest event, and begins `window_us` (1 to 2^30) before it; without that, at the oldest event,
/// at most 2^30 µs before. Older events are dropped and [counted](Self::older), as are those that the memory has no room
/// for ([`overflowed`](Self::overflowed)): they come last and are not the newest then.
///
/// A slice of nothing but late events ends where its window of the grid begins; one that ends up to 1 ms before the one
/// before it did ends where that did, since clocks step back.
#[derive(Clone, Debug)]
pub struct KeptSlice<E> {
    events: E,
    len: usize,
    /// No kept event is older.
    oldest: u64,
    newest: u64,
    /// Where the slice before ended.
    before: u64,
    window_us: Option<u32>,
    older: u64,
    overflowed: u64,
}

impl<E: AsRef<[Event]> + AsMut<[Event]>> KeptSlice<E> {
    /// Over memory for as many events as a slice may have.
    pub fn try_new(window_us: Option<u32>, events: E) -> Result<Self, BadRepresentation> {
        if let Some(bad) = window_us.filter(|us| !(1..=WINDOW_US_MAX).contains(us)) {
            let (found, range) = (u64::from(bad), "1 to 2^30 µs");
            return Err(BadRepresentation::Parameter { key: "window_us", found, range });
        }
        Ok(Self { events, len: 0, oldest: 0, newest: 0, before: 0, window_us, older: 0, overflowed: 0 })
    }

    /// Events older than their window, since the start.
    pub const fn older(&self) -> u64 {
        self.older
    }

    /// Events that there was no room for, since the start.
    pub const fn overflowed(&self) -> u64 {
        self.overflowed
    }

    /// A slice begins: forgets the events of the one before.
    pub fn begin(&mut self) {
        self.len = 0;
    }

    /// Keeps events.
    pub fn push(&mut self, span: Span<'_>) {
        for event in span.events {
            self.keep(span.time(*event), *event);
        }
    }

    fn keep(&mut self, t: u64, event: Event) {
        if self.len == 0 {
            (self.oldest, self.newest) = (t, t);
        }
        // Within 2^31 µs, 32 bits tell all kept events apart.
        if t.saturating_sub(self.oldest) >= u64::from(WINDOW_US_MAX) * 3 / 2 {
            let newest = self.newest.max(t);
            self.drop_older(newest, WINDOW_US_MAX);
            self.oldest = newest.saturating_sub(WINDOW_US_MAX.into());
        }
        if self.newest.saturating_sub(t) > WINDOW_US_MAX.into() {
            self.older += 1;
            return;
        }
        let Some(slot) = self.events.as_mut().get_mut(self.len) else {
            self.overflowed += 1;
            return;
        };
        *slot = event;
        self.len += 1;
        self.newest = self.newest.max(t);
        self.oldest = self.oldest.min(t);
    }

    /// Drops what is older than `newest` by more than `window_us`.
    fn drop_older(&mut self, newest: u64, window_us: u32) {
        let (newest, mut kept) = (newest as u32, 0);
        let events = self.events.as_mut().get_mut(..self.len).unwrap_or_default();
        for at in 0..events.len() {
            let Some(event) = events.get(at).copied() else { break };
            if (newest.wrapping_sub(event.t()) as i32).max(0) as u32 <= window_us {
                if let Some(slot) = events.get_mut(kept) {
                    *slot = event;
                }
                kept += 1;
            }
        }
        self.older += (self.len - kept) as u64;
        self.len = kept;
    }

    /// The slice, which is all there was in the window `grid`, is complete: its window and its events, on a sensor of this
    /// size. Without events it is that window.
    pub fn end(&mut self, grid: Window, geometry: Geometry) -> (Window, Span<'_>) {
        if self.len == 0 {
            self.before = grid.t1;
            return (grid, Span { t_first: grid.t0, t_last: grid.t0, geometry, events: &[] });
        }
        let newest = self.newest.max(grid.t0);
        let steps_back = self.before > newest && self.before - newest <= STEP_BACK_US;
        let t1 = if steps_back { self.before } else { newest };
        self.before = t1;
        self.drop_older(t1, self.window_us.unwrap_or(WINDOW_US_MAX));
        let events = self.events.as_ref().get(..self.len).unwrap_or_default();
        let oldest = events.iter().map(|event| (t1 as u32).wrapping_sub(event.t())).max().unwrap_or_default();
        let t0 = t1.saturating_sub(self.window_us.unwrap_or(oldest).into());
        (Window { t0, t1 }, Span { t_first: t1, t_last: t1, geometry, events })
    }
}

/// A representation with the newest event of each slice as its reference: the window it is given ends there.
///
/// What comes out is a function of the slice's events alone, wherever the window of the grid begins and ends; a slice
/// without events is drawn as the empty window that it is. See [`KeptSlice`] for what is kept.
///
/// ```
/// use lobula_core::representation::{LastEvent, TimeSurface};
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [(800, 0), (900, 1)].map(|(t, x)| Event::new(t, x, 0, Polarity::On));
/// let surface = TimeSurface::<f32, _>::try_new(geometry, 100, [0; 4])?;
/// let mut surface = LastEvent::try_new(surface, geometry, None, [Event::default(); 64])?;
/// let mut out = [f32::NAN; 4]; // whatever was there
/// surface.begin(Window { t0: 0, t1: 1_000 }, &mut out);
/// surface.accumulate(Span { t_first: 800, t_last: 900, geometry, events: &events }, &mut out)?;
/// surface.finish(&mut out);
/// assert_eq!(out, [lobula_core::math::exp(-1.0), 1.0, 0.0, 0.0]);
/// assert_eq!(surface.slice().overflowed(), 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct LastEvent<R, E> {
    inner: R,
    geometry: Geometry,
    window: Window,
    slice: KeptSlice<E>,
}

impl<R: Representation, E: AsRef<[Event]> + AsMut<[Event]>> LastEvent<R, E> {
    /// Of `inner`, which is for a sensor of this size, over memory for as many events as a slice may have. `window_us` is
    /// how far its window reaches back from the newest event, 1 to 2^30; without it, to the oldest.
    pub fn try_new(
        inner: R,
        geometry: Geometry,
        window_us: Option<u32>,
        events: E,
    ) -> Result<Self, BadRepresentation> {
        let slice = KeptSlice::try_new(window_us, events)?;
        Ok(Self { inner, geometry, window: Window { t0: 0, t1: 0 }, slice })
    }

    /// What was kept, with its counts.
    pub const fn slice(&self) -> &KeptSlice<E> {
        &self.slice
    }

    /// The representation.
    pub const fn inner(&self) -> &R {
        &self.inner
    }
}

impl<R: Representation, E: AsRef<[Event]> + AsMut<[Event]>> Representation for LastEvent<R, E> {
    type Pixel = R::Pixel;

    fn shape(&self) -> Shape {
        self.inner.shape()
    }

    fn begin(&mut self, window: Window, _: &mut [R::Pixel]) {
        self.window = window;
        self.slice.begin();
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [R::Pixel]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        self.slice.push(span);
        Ok(())
    }

    fn finish(&mut self, out: &mut [R::Pixel]) {
        let (window, span) = self.slice.end(self.window, self.geometry);
        self.inner.begin(window, out);
        // Only another geometry is refused, and it is the same.
        let _ = self.inner.accumulate(span, out);
        self.inner.finish(out);
    }

    /// The reference moves with the window, so that no sum can go on.
    fn overlap(&self) -> Overlap {
        if self.inner.overlap() == Overlap::Memory { Overlap::Memory } else { Overlap::Anew }
    }
}
