//! Where events go in a tensor.

use crate::{Event, Geometry};

/// How many indices are worked out together, so that the compiler does so with vectors.
const GROUP: usize = 64;

/// Row-major index of an event's pixel. 32 bits hold it in two planes of the largest sensor.
#[inline(always)]
pub(super) fn by_pixel(geometry: Geometry, event: Event) -> u32 {
    u32::from(event.y()).wrapping_mul(geometry.width.into()).wrapping_add(event.x().into())
}

/// Index of an event's element in planes ON, OFF.
#[inline(always)]
pub(super) fn by_polarity(geometry: Geometry, event: Event) -> u32 {
    let plane = geometry.pixels() as u32 & !event.on_mask();
    plane.wrapping_add(by_pixel(geometry, event))
}

/// Prepares each event, by groups, then hands what came of it to `each`, in order: the index and a value.
///
/// Indices that are known ahead let the processor wait for many misses of the cache at once.
#[inline(always)]
pub(super) fn for_each<T: Copy + Default>(
    events: &[Event],
    prepare: impl Fn(Event) -> (u32, T),
    mut each: impl FnMut(usize, T),
) {
    let (mut indices, mut values) = ([0; GROUP], [T::default(); GROUP]);
    for group in events.chunks(GROUP) {
        for ((index, value), event) in indices.iter_mut().zip(&mut values).zip(group) {
            (*index, *value) = prepare(*event);
        }
        for (index, value) in indices.iter().zip(&values).take(group.len()) {
            each(*index as usize, *value);
        }
    }
}
