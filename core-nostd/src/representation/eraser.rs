//! Erasing a tensor where it was drawn, and nowhere else.
//!
//! To zero 5 bins of 1280x720 is to write 18 MB, where the 25,000 events of a busy millisecond are drawn to 3. A view
//! of short windows in memory of its own therefore keeps a log of what it drew. Never for memory that others may write
//! to, such as samples on loan: what they left would stay.

use bytemuck::Pod;

use crate::prefetch::prefetch;
use crate::representation::index::{Draw, Places, draw_each};
use crate::vector::widest;
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Events that share an entry of the log: few enough that they change few planes.
const EVENTS: usize = 512;

/// Words of an entry: which planes were changed (the low half) and by how many events; then their pixels.
const ENTRY: usize = 1 + EVENTS;

/// How many elements ahead the next to be zeroed is fetched.
const AHEAD: usize = 24;

/// Begins windows in memory that still holds the window before, by erasing what was drawn of it.
///
/// Give it the calls of a [sparse](Representation::is_sparse) representation in the place of its own, always with the
/// same memory, to which nobody else writes. The tensors have the same bits either way. The first window is zeroed
/// whole, and so is one after more events than the log holds, a sixteenth of the sensor's pixels: no more are worth it.
///
/// ```
/// use lobula_core::representation::{Count, Eraser};
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(3, 1);
/// let mut count = Count::<u8>::new(geometry);
/// let mut eraser = Eraser::new(count.shape(), vec![0; Eraser::<Vec<u32>>::state_len(count.shape())]);
/// let mut out = [0xFF; 3]; // whatever was there
/// for x in 0..3 {
///     let events = [Event::new(5, x, 0, Polarity::On)];
///     eraser.begin(&mut count, Window { t0: 0, t1: 10 }, &mut out);
///     eraser.accumulate(&mut count, Span { t_first: 5, t_last: 5, geometry, events: &events }, &mut out)?;
///     count.finish(&mut out);
///     assert_eq!(out.map(usize::from).iter().sum::<usize>(), 1);
/// }
/// # Ok::<(), lobula_core::WrongGeometry>(())
/// ```
#[derive(Clone, Debug)]
pub struct Eraser<S> {
    shape: Shape,
    log: S,
    /// Entries of the log in use; none while the log does not tell all that was drawn.
    entries: Option<usize>,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Eraser<S> {
    /// Elements of the log for tensors of this shape.
    pub const fn state_len(shape: Shape) -> usize {
        (shape.height * shape.width / 16 / EVENTS + 1) * ENTRY
    }

    /// With a log of any length, whatever it holds; best [`state_len`](Self::state_len).
    pub const fn new(shape: Shape, log: S) -> Self {
        Self { shape, log, entries: None }
    }

    /// A window opens: [`Representation::begin`].
    pub fn begin<R: Representation>(&mut self, stage: &mut R, window: Window, out: &mut [R::Pixel]) {
        match self.entries {
            Some(entries) if stage.is_sparse() => {
                self.erase(entries, out);
                stage.begin_blank(window);
            }
            _ => stage.begin(window, out),
        }
        self.entries = stage.is_sparse().then_some(0);
    }

    /// Events of the open window: [`Representation::accumulate`].
    pub fn accumulate<R: Representation>(
        &mut self,
        stage: &mut R,
        span: Span<'_>,
        out: &mut [R::Pixel],
    ) -> Result<(), WrongGeometry> {
        stage.accumulate(span, out)?;
        let mut events = span.events;
        while let Some(entries) = self.entries.filter(|_| !events.is_empty()) {
            let (now, later) = events.split_at(self.room(entries).min(events.len()));
            self.entries = self.note(entries, stage.planes(now), now);
            events = later;
        }
        Ok(())
    }

    /// Whether the next window in this memory will be erased and not zeroed whole.
    pub const fn knows(&self) -> bool {
        self.entries.is_some()
    }

    /// How many more events the last entry takes, or those of a new one.
    fn room(&self, entries: usize) -> usize {
        let entry =
            entries.checked_sub(1).and_then(|last| self.log.as_ref().as_chunks::<ENTRY>().0.get(last));
        let used = entry.map_or(0, |[head, ..]| (head >> 16) as usize);
        if used < EVENTS { EVENTS - used } else { EVENTS }
    }

    /// Adds events to the last entry, or a new one if it is full; returns how many there are now, none if the log is
    /// full.
    fn note(&mut self, entries: usize, planes: u16, events: &[Event]) -> Option<usize> {
        let geometry = Geometry::new(self.shape.width as u16, self.shape.height as u16);
        let log = self.log.as_mut().as_chunks_mut::<ENTRY>().0;
        let last = entries.checked_sub(1).and_then(|last| log.get(last)).map(|[head, ..]| *head);
        let (entry, before) = match last.filter(|head| (head >> 16) < EVENTS as u32) {
            Some(head) => (entries - 1, head),
            None => (entries, 0),
        };
        let [head, pixels @ ..] = log.get_mut(entry)?;
        *head = before | u32::from(planes);
        *head += (events.len() as u32) << 16;
        let mut noting = Noting { next: (before >> 16) as usize };
        widest(
            #[inline(always)]
            || draw_each(events, Places::by_pixel(geometry), pixels, &mut noting),
        );
        Some(entry + 1)
    }

    /// Zeroes what the first `entries` entries tell of.
    fn erase<P: Pod>(&self, entries: usize, out: &mut [P]) {
        let pixels = self.shape.height * self.shape.width;
        // The newest first: what was drawn last is still in the nearer caches.
        let entries = self.log.as_ref().as_chunks::<ENTRY>().0.get(..entries).unwrap_or_default();
        for [head, places @ ..] in entries.iter().rev() {
            let places = places.get(..(head >> 16) as usize).unwrap_or_default();
            for plane in (0..self.shape.channels).filter(|plane| head >> (plane % 16) & 1 == 1) {
                zero(out.get_mut(plane * pixels..).unwrap_or_default(), places);
            }
        }
    }
}

/// Zeroes elements of a plane.
fn zero<P: Pod>(plane: &mut [P], places: &[u32]) {
    let ahead = places.iter().skip(AHEAD).chain(core::iter::repeat(&0));
    for (at, ahead) in places.iter().zip(ahead) {
        prefetch(plane, *ahead as usize);
        if let Some(element) = plane.get_mut(*at as usize) {
            *element = P::zeroed();
        }
    }
}

/// Writes down the pixels of events, one after the other.
struct Noting {
    next: usize,
}

impl Draw for Noting {
    type Pixel = u32;
    type Value = u32;

    #[inline(always)]
    fn prepare(&self, _: Event, at: &mut u32) -> u32 {
        *at
    }

    #[inline(always)]
    fn look_ahead(&self, _: &[u32], _: usize) {}

    #[inline(always)]
    fn draw(&mut self, pixels: &mut [u32], _: usize, at: u32) {
        if let Some(pixel) = pixels.get_mut(self.next) {
            *pixel = at;
        }
        self.next += 1;
    }
}
