//! Events that share a word and its mask, as EVT 2.1 and 4.0 write them.

use super::carry::Steps;
use super::time_high;
use crate::{Event, Refused};

/// Events still to be sent together: of one time, row and polarity, by rising x, within 32 columns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vector {
    pub t: u64,
    /// The event of bit 0, whether there is one or not.
    pub first: Event,
    pub mask: u32,
}

impl Vector {
    /// Of one event; bit 0 is at most 31 columns left of it.
    const fn new(t: u64, event: Event, first_x: u16) -> Self {
        let first = Event::new(t as u32, first_x, event.y(), event.polarity());
        Self { t, first, mask: 1 << (event.x().wrapping_sub(first_x) & 31) }
    }

    /// With the event, if it may join: order is kept, so only to the right.
    #[inline]
    fn joined(self, t: u64, event: Event) -> Option<Self> {
        let alike = self.t == t && self.first.y() == event.y() && self.first.is_on() == event.is_on();
        let column = u32::from(event.x().checked_sub(self.first.x())?);
        let bit = 1u32.checked_shl(column)?;
        (alike && self.mask < bit).then_some(Self { mask: self.mask | bit, ..self })
    }
}

/// An encoder that makes vectors.
pub(super) trait Vectors: Steps {
    fn open(&mut self) -> &mut Option<Vector>;

    /// Column of bit 0 of a vector that begins with an event at this one.
    fn first_x(x: u16) -> u16;
}

/// [`Steps::step`] for one: the event joins the open vector or opens one, or a word before it is held to be sent.
#[inline]
pub(super) fn step<E: Vectors>(encoder: &mut E, t: u64, event: Event) -> Result<bool, Refused> {
    time_high::check_pixel(event)?;
    if let Some(joined) = encoder.open().and_then(|open| open.joined(t, event)) {
        *encoder.open() = Some(joined);
        return Ok(true);
    }
    let ready = encoder.ready(t)?;
    if ready {
        *encoder.open() = Some(Vector::new(t, event, E::first_x(event.x())));
    }
    Ok(ready)
}
