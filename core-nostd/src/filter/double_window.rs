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

use super::{FilterError, in_range};
use crate::compact::compact_all;
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

/// The pixels of a window: columns and rows apart, so that a compiler compares many at once.
struct Window<'a> {
    xs: &'a mut [u16],
    ys: &'a mut [u16],
}

impl<'a> Window<'a> {
    /// A window of so many events in the first of these words; and the words after it.
    #[inline(always)]
    fn split(words: &'a mut [u16], len: usize) -> Option<(Self, &'a mut [u16])> {
        let (xs, words) = words.split_at_mut_checked(len)?;
        let (ys, words) = words.split_at_mut_checked(len)?;
        Some((Self { xs, ys }, words))
    }

    #[inline(always)]
    fn push(&mut self, fill: &mut Fill, (x, y): (u16, u16)) {
        let next = fill.next as usize;
        if let (Some(column), Some(row)) = (self.xs.get_mut(next), self.ys.get_mut(next)) {
            (*column, *row) = (x, y);
        }
        fill.len = fill.len.max(fill.next.saturating_add(1));
        fill.next = if next + 1 < self.xs.len() { fill.next.wrapping_add(1) } else { 0 };
    }

    /// Adds its pixels nearer than `distance` to `pixel`; stops where they are `enough`.
    #[inline(always)]
    fn add_near(&self, mut near: u16, fill: Fill, pixel: (u16, u16), distance: u16, enough: u16) -> u16 {
        let filled = ..fill.len as usize;
        let (xs, ys) = (self.xs.get(filled).unwrap_or_default(), self.ys.get(filled).unwrap_or_default());
        let ((xs, xs_rest), (ys, ys_rest)) = (xs.as_chunks::<STRIDE>(), ys.as_chunks::<STRIDE>());
        for (xs, ys) in xs.iter().zip(ys) {
            if near >= enough {
                return near;
            }
            near = near.saturating_add(count_near(xs, ys, pixel, distance));
        }
        near.saturating_add(count_near(xs_rest, ys_rest, pixel, distance))
    }
}

/// Pixels compared before looking whether they are enough: a register of 128 bits.
const STRIDE: usize = 8;

#[inline(always)]
fn count_near(xs: &[u16], ys: &[u16], (x, y): (u16, u16), distance: u16) -> u16 {
    // A sum beyond 16 bits is as far as any distance asked for.
    let is_near = |(a, b): (&u16, &u16)| (x.abs_diff(*a).saturating_add(y.abs_diff(*b)) < distance) as u16;
    xs.iter().zip(ys).map(is_near).fold(0, u16::wrapping_add)
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> DoubleWindow<S> {
    #[inline(always)]
    fn is_signal(&mut self, event: Event) -> bool {
        self.judge(event).unwrap_or(false)
    }

    #[inline(always)]
    fn judge(&mut self, event: Event) -> Option<bool> {
        let DoubleWindowParams { window, distance_px, support } = self.params;
        let words = bytemuck::try_cast_slice_mut(self.memory.as_mut()).ok()?;
        let (mut signal, words) = Window::split(words, window as usize)?;
        let (mut noise, _) = Window::split(words, window as usize)?;
        let pixel = (event.x(), event.y());
        let near = signal.add_near(0, self.signal, pixel, distance_px, support);
        let near = noise.add_near(near, self.noise, pixel, distance_px, support);
        let is_signal = near >= support;
        if is_signal {
            signal.push(&mut self.signal, pixel);
        } else {
            noise.push(&mut self.noise, pixel);
        }
        Some(is_signal)
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
