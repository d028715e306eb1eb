//! Where events go in a tensor, and how many are on their way there at once.

use core::marker::PhantomData;

use crate::prefetch::prefetch;
use crate::vector::SMALL_CORE;
use crate::{Event, Geometry};

/// Events whose indices are worked out together: with vectors, and few enough that no loop is left of it.
const GROUP: usize = 16;

/// Groups whose elements are fetched before the first of them is drawn.
///
/// Nearly every event goes to another cache line. With this many on their way polarity histograms took 0.7 and voxel
/// grids 0.83 of the time of one group of 64 drawn at once; 32 to 128 events are alike (Sapphire Rapids, 1280x720,
/// 2026-11).
const AHEAD: usize = 4;

/// How far ahead events are fetched themselves, which counts where no decoder has just written them: 0.93 of the time of
/// counting 1.22 million of them (the same machine).
const EVENTS_AHEAD: usize = 256;

/// Events of a cache line.
const LINE: usize = 64 / size_of::<Event>();

/// How the elements of a tensor are numbered.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Places {
    width: u16,
    /// Where the plane of OFF events begins.
    off: u32,
}

impl Places {
    /// Row-major by pixel. 32 bits hold the index in two planes of the largest sensor.
    #[inline(always)]
    pub(crate) fn by_pixel(geometry: Geometry) -> Self {
        Self { width: geometry.width, off: 0 }
    }

    /// In planes ON, OFF, each row-major.
    #[inline(always)]
    pub(super) fn by_polarity(geometry: Geometry) -> Self {
        Self { width: geometry.width, off: geometry.pixels() as u32 }
    }

    /// Index of an event's element.
    #[inline(always)]
    fn of(self, event: Event) -> u32 {
        let pixel = u32::from(event.y()).wrapping_mul(self.width.into()).wrapping_add(event.x().into());
        pixel.wrapping_add(self.off & !event.on_mask())
    }
}

/// What an event does to a tensor.
pub(super) trait Draw {
    /// An element of the tensor.
    type Pixel;
    /// What is known of an event before the tensor is touched.
    type Value: Copy + Default;

    /// Works that out. `at` is the index of the event's element, and may be moved to another plane.
    fn prepare(&self, event: Event, at: &mut u32) -> Self::Value;

    /// Says what [`draw`](Self::draw) will touch: the element and no other, if nothing else is said.
    #[inline(always)]
    fn look_ahead(&self, out: &[Self::Pixel], at: usize) {
        prefetch(out, at);
    }

    /// Changes the tensor. `at` may lie beyond it.
    fn draw(&mut self, out: &mut [Self::Pixel], at: usize, value: Self::Value);
}

/// Draws events, in order.
#[inline(always)]
pub(super) fn draw_each<D: Draw>(events: &[Event], places: Places, out: &mut [D::Pixel], drawing: &mut D) {
    let (groups, rest) = events.as_chunks::<GROUP>();
    let (first, others) = groups.split_at_checked(AHEAD).unwrap_or((groups, &[]));
    let mut queue = [Group::<D::Value>::default(); AHEAD];
    for (waiting, group) in queue.iter_mut().zip(first) {
        waiting.prepare(group, places, out, drawing);
    }
    for groups in others.chunks(AHEAD) {
        for (waiting, group) in queue.iter_mut().zip(groups) {
            waiting.draw(out, drawing);
            waiting.prepare(group, places, out, drawing);
        }
    }
    let (newer, older) = queue.split_at(others.len() % AHEAD);
    for waiting in older.iter().chain(newer).take(first.len()) {
        waiting.draw(out, drawing);
    }
    for event in rest {
        let mut at = places.of(*event);
        let value = drawing.prepare(*event, &mut at);
        drawing.draw(out, at as usize, value);
    }
}

/// Changes the element of each event, in order, knowing its index and nothing else.
#[inline(always)]
pub(crate) fn change_each<P>(
    places: Places,
    events: &[Event],
    out: &mut [P],
    change: impl FnMut(&mut P, usize),
) {
    draw_each(events, places, out, &mut Changing { change, pixel: PhantomData });
}

struct Changing<P, F> {
    change: F,
    pixel: PhantomData<P>,
}

impl<P, F: FnMut(&mut P, usize)> Draw for Changing<P, F> {
    type Pixel = P;
    type Value = ();

    #[inline(always)]
    fn prepare(&self, _: Event, _: &mut u32) {}

    #[inline(always)]
    fn draw(&mut self, out: &mut [P], at: usize, (): ()) {
        if let Some(pixel) = out.get_mut(at) {
            (self.change)(pixel, at);
        }
    }
}

/// Events on their way: where they go, and what is known of them.
#[derive(Clone, Copy, Default)]
struct Group<T> {
    indices: [u32; GROUP],
    values: [T; GROUP],
}

impl<T: Copy + Default> Group<T> {
    #[inline(always)]
    fn prepare<D: Draw<Value = T>>(
        &mut self,
        events: &[Event; GROUP],
        places: Places,
        out: &[D::Pixel],
        drawing: &D,
    ) {
        for line in (0..GROUP).step_by(LINE) {
            prefetch(events, EVENTS_AHEAD + line);
        }
        if !SMALL_CORE {
            let [times, pixels] = halves(events);
            indices(places, &pixels, &mut self.indices);
            let known = self.values.iter_mut().zip(&mut self.indices);
            for ((value, at), (t, pixel)) in known.zip(times.iter().zip(&pixels)) {
                *value = drawing.prepare(event(*t, *pixel), at);
            }
        } else {
            // As they are, which takes a fifth fewer instructions there.
            for (at, event) in self.indices.iter_mut().zip(events) {
                *at = places.of(*event);
            }
            for (value, (at, event)) in self.values.iter_mut().zip(self.indices.iter_mut().zip(events)) {
                *value = drawing.prepare(*event, at);
            }
        }
        for at in self.indices {
            drawing.look_ahead(out, at as usize);
        }
    }

    #[inline(always)]
    fn draw<D: Draw<Value = T>>(&self, out: &mut [D::Pixel], drawing: &mut D) {
        for (at, value) in self.indices.iter().zip(&self.values) {
            drawing.draw(out, *at as usize, *value);
        }
    }
}

#[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
#[path = "index/sse2.rs"]
mod sse2;
#[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
use sse2::indices;

#[cfg(not(all(target_arch = "x86_64", target_feature = "sse2")))]
use index_of_each as indices;

/// The event of these halves of its word.
#[inline(always)]
fn event(t: u32, pixel: u32) -> Event {
    Event::from_word(u64::from(t) | u64::from(pixel) << 32)
}

/// The times of events, and the other halves of their words. Apart they are vectors to the compiler, and so is what is computed
/// of them: Tencode takes 0.6 of the time (Zen 5, 2026-11).
#[inline(always)]
fn halves(events: &[Event; GROUP]) -> [[u32; GROUP]; 2] {
    [events.map(Event::t), events.map(|event| (event.word() >> 32) as u32)]
}

/// Writes the index of each event to `out`, of which `pixels` holds the column below row and polarity.
#[inline(always)]
fn index_of_each(places: Places, pixels: &[u32; GROUP], out: &mut [u32; GROUP]) {
    for (pixel, out) in pixels.iter().zip(out) {
        *out = places.of(event(0, *pixel));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polarity;

    /// Writes down where events go and when.
    struct Trace(Vec<(u32, u32)>);

    impl Draw for Trace {
        type Pixel = ();
        type Value = u32;

        fn prepare(&self, event: Event, _: &mut u32) -> u32 {
            event.t()
        }

        fn draw(&mut self, _: &mut [()], at: usize, t: u32) {
            self.0.push((at as u32, t));
        }
    }

    #[test]
    fn events_are_drawn_in_order_at_their_indices() {
        for (width, height) in [(1, 1), (5, 3), (1280, 720), (32767, 32768), (40000, 32768), (65535, 32768)] {
            let geometry = Geometry::new(width, height);
            let at = |i: u32| {
                let random = i.wrapping_mul(0x9E37_79B1);
                let (x, y) = ((random >> 7) % u32::from(width), (random >> 3) % u32::from(height));
                Event::new(i, x as u16, y as u16, Polarity::from_bit((random >> 31) as u16))
            };
            let corners = [0, width - 1].into_iter().flat_map(|x| [0, height - 1].map(|y| (x, y)));
            let corners =
                corners.flat_map(|(x, y)| [Polarity::On, Polarity::Off].map(|p| Event::new(0, x, y, p)));
            let events: Vec<Event> = corners.chain((0..333).map(at)).collect();
            for places in [Places::by_pixel(geometry), Places::by_polarity(geometry)] {
                for len in (0..=2 * GROUP * (AHEAD + 1)).chain([events.len()]) {
                    let events = &events[events.len() - len..];
                    let mut trace = Trace(Vec::new());
                    draw_each(events, places, &mut [], &mut trace);
                    let expected: Vec<_> =
                        events.iter().map(|event| (places.of(*event), event.t())).collect();
                    assert_eq!(trace.0, expected, "{geometry}, {len} events");
                }
            }
        }
    }
}
