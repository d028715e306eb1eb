//! Double window filter: denoising in memory that does not grow with the sensor, for microcontrollers (Guo and
//! Delbruck, "Low Cost and Latency Event Camera Background Activity Denoising", TPAMI 2022).
//!
//! Rule: two windows hold the pixels of the last `window` events called signal and of the last `window` called noise.
//! An event is signal if at least `support` events of both windows together lie nearer than `distance_px` to it
//! (`|dx| + |dy| < distance_px`, its own pixel included), whatever their times and polarities; it then joins the window
//! of its kind and pushes the oldest out. Signal is kept. Two windows and not one, so that a flood of noise cannot push
//! the signal out.
//!
//! Windows that are not full yet hold fewer events, so the first event of a stream is noise. Time plays no part: no
//! silence and no restart of the clock empties a window.

use super::{FilterError, compact::compact_all, in_range};
use crate::{Block, Event, Filter, Geometry, WrongGeometry};

/// Parameters of [`DoubleWindow`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default)
)]
pub struct DoubleWindowParams {
    /// Events in each of the two windows, 1 at least. By default 64; the paper uses some hundreds, and every event is
    /// compared with up to twice as many.
    pub window: u16,
    /// Sum of the horizontal and the vertical distance in pixels below which events are near. By default 5.
    pub distance_px: u16,
    /// How many events must be near, 1 at least. By default 1.
    pub support: u16,
}

impl Default for DoubleWindowParams {
    fn default() -> Self {
        Self { window: 64, distance_px: 5, support: 1 }
    }
}

/// Drops events that are far from the last ones.
///
/// ```
/// use lobula_core::{Event, Filter, Geometry, Polarity, filter::{DoubleWindow, DoubleWindowParams}};
/// let params = DoubleWindowParams { window: 64, distance_px: 5, support: 1 };
/// let memory = [0u32; DoubleWindow::<()>::required_len(64)];
/// let mut filter = DoubleWindow::try_new(Geometry::new(640, 480), params, memory)?;
/// let mut keep = |x, y| filter.keep(Event::new(0, x, y, Polarity::On));
/// assert!(!keep(100, 100)); // the first
/// assert!(keep(102, 102)); // 4 away from it
/// assert!(!keep(105, 104)); // 5 away from the second
/// # Ok::<(), lobula_core::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct DoubleWindow<S> {
    geometry: Geometry,
    params: DoubleWindowParams,
    signal: Fill,
    noise: Fill,
    memory: S,
}

impl<S> DoubleWindow<S> {
    /// Words of memory it needs for windows of `window` events each, on a sensor of any size.
    pub const fn required_len(window: u16) -> usize {
        2 * window as usize
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> DoubleWindow<S> {
    /// A filter for events of this sensor, in `memory` of at least [`required_len`](Self::required_len) words, whatever
    /// they hold.
    pub fn try_new(geometry: Geometry, params: DoubleWindowParams, memory: S) -> Result<Self, FilterError> {
        in_range("window", params.window as u32, (1, u16::MAX as u32))?;
        in_range("distance_px", params.distance_px as u32, (1, u16::MAX as u32))?;
        in_range("support", params.support as u32, (1, u16::MAX as u32))?;
        let (needed, found) = (Self::required_len(params.window), memory.as_ref().len());
        if found < needed {
            return Err(FilterError::MemoryTooShort { needed, found });
        }
        Ok(Self { geometry, params, signal: Fill::default(), noise: Fill::default(), memory })
    }
}

/// How much of a window's memory is used, and where the next event goes: its oldest once it is full.
#[derive(Clone, Copy, Debug, Default)]
struct Fill {
    len: u16,
    next: u16,
}

impl Fill {
    #[inline(always)]
    fn push(&mut self, window: &mut [u32], pixel: u32) {
        if let Some(slot) = window.get_mut(self.next as usize) {
            *slot = pixel;
        }
        self.len = self.len.max(self.next.saturating_add(1));
        self.next = self.next.wrapping_add(1);
        if self.next as usize >= window.len() {
            self.next = 0;
        }
    }
}

/// A pixel as one word of a window.
#[inline(always)]
const fn packed(event: Event) -> u32 {
    event.x() as u32 | (event.y() as u32) << 16
}

/// Words compared before looking whether they are enough: few for a core that does one at a time, one or two
/// registers for one that does many.
const STRIDE: usize = 8;

/// Adds the pixels of `window` nearer than `distance` to `pixel`; stops where they are `enough`.
#[inline(always)]
fn add_near(mut near: u32, window: &[u32], pixel: u32, distance: u32, enough: u32) -> u32 {
    let is_near = |other: &u32| {
        let dx = (pixel & 0xFFFF).abs_diff(other & 0xFFFF);
        let dy = (pixel >> 16).abs_diff(other >> 16);
        (dx + dy < distance) as u32
    };
    for words in window.chunks(STRIDE) {
        if near >= enough {
            break;
        }
        near += words.iter().map(is_near).sum::<u32>();
    }
    near
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> DoubleWindow<S> {
    #[inline(always)]
    fn is_signal(&mut self, event: Event) -> bool {
        let DoubleWindowParams { window, distance_px, support } = self.params;
        let memory = self.memory.as_mut().get_mut(..Self::required_len(window)).unwrap_or_default();
        let Some((signal, noise)) = memory.split_at_mut_checked(window as usize) else { return false };
        let (pixel, distance, enough) = (packed(event), distance_px as u32, support as u32);
        let mut near = 0;
        for (window, fill) in [(&*signal, self.signal), (&*noise, self.noise)] {
            let filled = window.get(..fill.len as usize).unwrap_or_default();
            near = add_near(near, filled, pixel, distance, enough);
        }
        let is_signal = near >= enough;
        if is_signal {
            self.signal.push(signal, pixel)
        } else {
            self.noise.push(noise, pixel)
        }
        is_signal
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Filter for DoubleWindow<S> {
    fn keep(&mut self, event: Event) -> bool {
        self.is_signal(event)
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        self.geometry.check(block.geometry)?;
        let kept = compact_all(block.events_mut(), |event| self.is_signal(event));
        block.truncate(kept);
        Ok(kept)
    }
}
