//! Events that no light made.

use super::{Kind, Seed};
use crate::random::Random;
use crate::transform::TransformError;
use crate::{Event, Geometry, Polarity, Sink, Span, WrongGeometry};

/// Parameters of [`NoiseInjection`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct NoiseInjectionParams {
    /// Start of the slice in µs.
    pub t0_us: u64,
    /// End of the slice in µs, exclusive.
    pub t1_us: u64,
    /// Events added per pixel and second; background activity of cameras is 0.1 to 10.
    pub rate_hz: f64,
}

/// Adds events to a slice: time is cut into stretches of 1 / (rate x pixels), and each has one event, at any time of it,
/// at any pixel, of either polarity.
///
/// Output is bounded: events go into a [`Sink`] of the caller's, as those of a decoder do. [`inject`](Self::inject) stops
/// where the sink refuses an event, and tells how many of the slice's were taken: empty the sink and call again with the
/// rest. A slice of n events becomes n + rate x pixels x seconds, [`added_in_all`](Self::added_in_all) tells exactly. An added
/// event goes before the first event that is not older, so that a sorted slice stays sorted.
///
/// ```
/// use lobula_core::{Event, Geometry, Polarity, Sink, Span};
/// use lobula_core::augmentation::{NoiseInjection, NoiseInjectionParams, Seed};
/// let geometry = Geometry::new(10, 10);
/// let params = NoiseInjectionParams { t0_us: 0, t1_us: 1_000_000, rate_hz: 0.1 };
/// let mut noise = NoiseInjection::try_new(geometry, params, Seed { seed: 7, slice: 3 })?;
/// assert_eq!(noise.added_in_all(), 10);
/// let events = [Event::new(500_000, 1, 2, Polarity::On)];
/// let span = Span { t_first: 500_000, t_last: 500_000, geometry, events: &events };
/// let mut memory = [Event::default(); 64];
/// let mut sink = Sink::new(&mut memory);
/// assert_eq!(noise.inject(span, &mut sink)?, 1);
/// assert!(noise.finish(&mut sink));
/// assert_eq!(sink.len(), 11);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct NoiseInjection {
    geometry: Geometry,
    t0: u64,
    /// Length of a stretch, in 2^-20 µs.
    stretch: u64,
    random: Random,
    next: u64,
    end: u64,
}

/// Parts of a µs that stretches are counted in.
const PARTS: u32 = 20;

impl NoiseInjection {
    /// For a slice of a sensor's events.
    pub fn try_new(
        geometry: Geometry,
        params: NoiseInjectionParams,
        seed: Seed,
    ) -> Result<Self, TransformError> {
        let NoiseInjectionParams { t0_us, t1_us, rate_hz } = params;
        let Some(length) = t1_us.checked_sub(t0_us) else {
            return Err(TransformError::OutOfRange { key: "t1_us", range: "no less than t0_us" });
        };
        if !(0.0..=1e6).contains(&rate_hz) {
            return Err(TransformError::OutOfRange { key: "rate_hz", range: "0 to 1000000" });
        }
        let per_us = rate_hz * geometry.pixels() as f64 * 1e-6;
        // No event is a stretch without end; more than a million in a µs are too many to tell.
        let stretch = (((1u64 << PARTS) as f64 / per_us) as u64).max(1);
        let end = (u128::from(length) << PARTS) / u128::from(stretch);
        let end = if per_us > 0.0 { end.min(u128::from(u64::MAX)) as u64 } else { 0 };
        Ok(Self { geometry, t0: t0_us, stretch, random: seed.random(Kind::Noise), next: 0, end })
    }

    /// How many events it adds to the slice.
    pub const fn added_in_all(&self) -> u64 {
        self.end
    }

    /// How many it has added so far.
    pub const fn added(&self) -> u64 {
        self.next
    }

    /// Puts events of the slice, and what is added before each, into `sink`; returns how many of `span` were taken.
    pub fn inject(&mut self, span: Span<'_>, sink: &mut Sink<'_>) -> Result<usize, WrongGeometry> {
        self.geometry.check(span.geometry)?;
        for (taken, event) in span.events.iter().enumerate() {
            let t = span.time(*event);
            if !self.add_until(t, sink) || !sink.push(t, *event) {
                return Ok(taken);
            }
        }
        Ok(span.events.len())
    }

    /// The slice has no more events: puts the rest of what is added into `sink`. False where the sink refused one: empty
    /// it and call again.
    pub fn finish(&mut self, sink: &mut Sink<'_>) -> bool {
        self.add_until(u64::MAX, sink)
    }

    fn add_until(&mut self, t_end: u64, sink: &mut Sink<'_>) -> bool {
        while self.next < self.end {
            let (t, event) = self.event(self.next);
            if t > t_end {
                break;
            }
            if !sink.push(t, event) {
                return false;
            }
            self.next += 1;
        }
        true
    }

    /// Event number `n`, and its full time.
    fn event(&self, n: u64) -> (u64, Event) {
        let mut random = self.random.fork(n);
        let within = (u128::from(random.next()) * u128::from(self.stretch)) >> 64;
        let t = (u128::from(n) * u128::from(self.stretch) + within) >> PARTS;
        let t = self.t0.saturating_add(t as u64);
        let (x, y) = (random.below(self.geometry.width.into()), random.below(self.geometry.height.into()));
        (t, Event::new(t as u32, x as u16, y as u16, Polarity::from_bit(random.next() as u16)))
    }
}
