//! When each pixel last fired, and before that, and before: the logarithms of the ages of its last events.
//!
//! Source: Baldwin et al., Time-Ordered Recent Event (TORE) Volumes for Event Cameras, TPAMI 2022, with the scaling of
//! the authors' code.

use crate::math::ln;
use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::stamps::{AGE_US_MAX, Stamps};
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, check};
use crate::vector::{in_order, widest};
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// The greatest depth.
const DEPTH_MAX: usize = 16;

/// Time-ordered recent events (TORE): 2 depth x H x W of f32, the newest first, all of ON and then all of OFF.
///
/// Plane `k` holds `max(0, ln(min(age, age_max) + 1) - ln(age_min + 1))` of the pixel's last event but `k`, the ages in
/// µs from the window's end; an event that never was is `age_max` old. Events are ordered as in the stream; one older
/// than its window counts at its start.
///
/// The surface remembers across windows, in `2 depth x H x W` elements of u32. A window that ends before the one before
/// it did is a restart of the clock and forgets everything. By default the depth is 4, age_min 150 µs and age_max 5 s.
///
/// ```
/// use lobula_core::representation::Tore;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(1, 1);
/// let events = [900, 990].map(|t| Event::new(t, 0, 0, Polarity::On));
/// let mut out = [f32::NAN; 4]; // whatever was there
/// let mut tore = Tore::try_new(geometry, 2, 9, 999, [0; 4])?;
/// tore.begin(Window { t0: 0, t1: 1_000 }, &mut out);
/// tore.accumulate(Span { t_first: 900, t_last: 990, geometry, events: &events }, &mut out)?;
/// tore.finish(&mut out);
/// let expected = [11.0f32, 101.0, 1_000.0, 1_000.0].map(|age| (age / 10.0).ln());
/// assert!(out.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-5));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Tore<S> {
    geometry: Geometry,
    depth: u16,
    age_max: f32,
    ln_min: f32,
    stamps: Stamps<S>,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Tore<S> {
    /// The greatest depth.
    pub const DEPTH_MAX: u16 = DEPTH_MAX as u16;

    /// Elements of the state.
    pub const fn state_len(geometry: Geometry, depth: u16) -> usize {
        2 * geometry.pixels() * depth as usize
    }

    /// For a sensor of this size, 1 to [`DEPTH_MAX`](Self::DEPTH_MAX) events a pixel and polarity, ages of less than
    /// `age_max_us`, 2^30 at most, and state of [`state_len`](Self::state_len) elements, whatever they hold.
    pub fn try_new(
        geometry: Geometry,
        depth: u16,
        age_min_us: u32,
        age_max_us: u32,
        state: S,
    ) -> Result<Self, BadRepresentation> {
        let bad = |key, found: u32, range| BadRepresentation::Parameter { key, found: found.into(), range };
        if depth == 0 || depth > Self::DEPTH_MAX {
            return Err(bad("depth", depth.into(), "1 to 16 events"));
        }
        if age_max_us == 0 || age_max_us > AGE_US_MAX {
            return Err(bad("age_max_us", age_max_us, "1 to 2^30 µs"));
        }
        if age_min_us >= age_max_us {
            return Err(bad("age_min_us", age_min_us, "less than age_max_us"));
        }
        let stamps = Stamps::try_new(Self::state_len(geometry, depth), state)?;
        let ln_min = ln(age_min_us as f32 + 1.0);
        Ok(Self { geometry, depth, age_max: age_max_us as f32, ln_min, stamps })
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for Tore<S> {
    type Pixel = f32;

    fn shape(&self) -> Shape {
        Shape {
            channels: 2 * usize::from(self.depth),
            height: self.geometry.height.into(),
            width: self.geometry.width.into(),
        }
    }

    fn begin(&mut self, window: Window, _: &mut [f32]) {
        self.stamps.begin(window);
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [f32]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let (window, map) = self.stamps.map_mut();
        let length = window.t1.saturating_sub(window.t0).min(AGE_US_MAX.into()) as i32;
        let mut queueing = Queueing { t0: window.t0 as u32, length, depth: self.depth.into() };
        widest(
            #[inline(always)]
            || draw_each(span.events, Places::by_polarity(self.geometry), map, &mut queueing),
        );
        Ok(())
    }

    fn finish(&mut self, out: &mut [f32]) {
        let (now, map) = self.stamps.ages();
        let (age_max, ln_min, depth) = (self.age_max, self.ln_min, usize::from(self.depth));
        let of_polarity = (self.geometry.pixels() * depth).max(1);
        for (queues, planes) in map.chunks(of_polarity).zip(out.chunks_mut(of_polarity)) {
            in_order(
                #[inline(always)]
                || scale(now, queues, depth, age_max, ln_min, planes),
            );
        }
    }

    fn overlap(&self) -> Overlap {
        Overlap::Memory
    }
}

/// Pixels whose queues are read at once.
const RUN: usize = 64;

/// The depth that most take, which the compiler knows how to read and to shift.
const USUAL: usize = 4;

/// The scaled logarithms of the ages in queues, to as many planes as a queue is long. A run of pixels is written to all
/// planes before the next is read, so that the queues pass through the caches once.
#[inline(always)]
fn scale(now: u32, queues: &[u32], depth: usize, age_max: f32, ln_min: f32, planes: &mut [f32]) {
    let never = scaled(AGE_US_MAX, age_max, ln_min);
    let depth = depth.clamp(1, DEPTH_MAX);
    let pixels = queues.len() / depth;
    // All of a run, whose length the compiler knows: with vectors.
    let (mut ages, mut values) = ([[AGE_US_MAX; RUN]; DEPTH_MAX], [0.0f32; RUN]);
    for (start, queues) in (0..pixels).step_by(RUN).zip(queues.chunks(RUN * depth)) {
        spread(now, queues, depth, &mut ages);
        for (k, ages) in ages.iter().take(depth).enumerate() {
            // Most pixels have had no event for long, and its logarithm is known.
            if ages.iter().fold(u32::MAX, |least, age| least.min(*age)) as f32 >= age_max {
                values = [never; RUN];
            } else {
                for (value, age) in values.iter_mut().zip(ages) {
                    *value = scaled(*age, age_max, ln_min);
                }
            }
            let plane = planes.get_mut(k * pixels + start..).unwrap_or_default();
            match plane.first_chunk_mut::<RUN>() {
                Some(plane) if queues.len() == RUN * depth => *plane = values,
                _ => plane
                    .iter_mut()
                    .take(queues.len() / depth)
                    .zip(values)
                    .for_each(|(pixel, value)| *pixel = value),
            }
        }
    }
}

/// The scaled logarithm of an age in µs.
#[inline(always)]
fn scaled(age: u32, age_max: f32, ln_min: f32) -> f32 {
    let age = (age.min(AGE_US_MAX) as i32 as f32).min(age_max);
    (ln(age + 1.0) - ln_min).max(0.0)
}

/// The ages in queues, the newest of all pixels first.
#[inline(always)]
fn spread(now: u32, queues: &[u32], depth: usize, ages: &mut [[u32; RUN]; DEPTH_MAX]) {
    if let (Some(queues), [first, second, third, fourth, ..]) =
        (queues.as_chunks::<USUAL>().0.first_chunk::<RUN>().filter(|_| depth == USUAL), &mut *ages)
    {
        for (i, queue) in queues.iter().enumerate() {
            let [a, b, c, d] = queue.map(|time| now.wrapping_sub(time));
            (first[i], second[i], third[i], fourth[i]) = (a, b, c, d);
        }
        return;
    }
    for (k, ages) in ages.iter_mut().take(depth).enumerate() {
        for (age, time) in ages.iter_mut().zip(queues.iter().skip(k).step_by(depth)) {
            *age = now.wrapping_sub(*time);
        }
    }
}

/// Puts the times of events in front of their queues; the oldest falls out.
struct Queueing {
    t0: u32,
    length: i32,
    depth: u32,
}

impl Draw for Queueing {
    type Pixel = u32;
    type Value = u32;

    #[inline(always)]
    fn prepare(&self, event: Event, at: &mut u32) -> u32 {
        *at = at.wrapping_mul(self.depth);
        let since = (event.t().wrapping_sub(self.t0) as i32).max(0).min(self.length);
        self.t0.wrapping_add(since as u32)
    }

    #[inline(always)]
    fn draw(&mut self, map: &mut [u32], at: usize, stamp: u32) {
        let queue = map.get_mut(at..).unwrap_or_default();
        if let Some(queue) = queue.first_chunk_mut::<USUAL>().filter(|_| self.depth as usize == USUAL) {
            let [a, b, c, _] = *queue;
            *queue = [stamp, a, b, c];
            return;
        }
        let mut moved = stamp;
        for time in queue.iter_mut().take(self.depth as usize) {
            core::mem::swap(time, &mut moved);
        }
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for Tore<S> {
    fn state_len(parameters: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry, parameters.depth)
    }

    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        let Parameters { depth, age_min_us, age_max_us, .. } = *parameters;
        Self::try_new(geometry, depth, age_min_us, age_max_us, state)
    }
}
