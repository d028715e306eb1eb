//! Where events go in a tensor.

use crate::{Event, Geometry};

/// How many indices are worked out together, so that the compiler does so with vectors.
const GROUP: usize = 64;

/// How the elements of a tensor are numbered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Places {
    width: u16,
    /// Where the plane of OFF events begins.
    off: u32,
}

impl Places {
    /// Row-major by pixel. 32 bits hold the index in two planes of the largest sensor.
    #[inline(always)]
    pub(super) fn by_pixel(geometry: Geometry) -> Self {
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

/// Hands the index of each event to `each`, in order.
#[inline(always)]
pub(super) fn for_each(events: &[Event], places: Places, mut each: impl FnMut(usize)) {
    for_each_with(events, places, |_| (), |at, ()| each(at));
}

/// Prepares each event, by groups, then hands what came of it to `each`, in order: the index and a value.
///
/// Indices that are known ahead let the processor wait for many misses of the cache at once.
#[inline(always)]
pub(super) fn for_each_with<T: Copy + Default>(
    events: &[Event],
    places: Places,
    prepare: impl Fn(Event) -> T,
    mut each: impl FnMut(usize, T),
) {
    let (mut indices, mut values) = ([0; GROUP], [T::default(); GROUP]);
    for group in events.chunks(GROUP) {
        group::indices(places, group, &mut indices);
        for (value, event) in values.iter_mut().zip(group) {
            *value = prepare(*event);
        }
        // Slices of one length, so that one counter runs over both.
        let indices = indices.get(..group.len()).unwrap_or_default();
        let values = values.get(..group.len()).unwrap_or_default();
        for (index, value) in indices.iter().zip(values) {
            each(*index as usize, *value);
        }
    }
}

#[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
#[path = "index/sse2.rs"]
mod group;

#[cfg(not(all(target_arch = "x86_64", target_feature = "sse2")))]
mod group {
    use super::{Event, Places};

    #[inline(always)]
    pub(super) fn indices(places: Places, events: &[Event], out: &mut [u32]) {
        for (event, out) in events.iter().zip(out) {
            *out = places.of(*event);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polarity;

    #[test]
    fn groups_give_the_indices_of_their_events() {
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
                let mut found = Vec::new();
                for_each_with(&events, places, |event| event.t(), |index, t| found.push((index as u32, t)));
                let expected: Vec<_> = events.iter().map(|event| (places.of(*event), event.t())).collect();
                assert_eq!(found, expected, "{geometry}");
            }
        }
    }
}
