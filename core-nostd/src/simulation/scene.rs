//! The events of one loop of the scene, and which of them are true.

use super::noise::{NoiseRates, noise};
use super::object::Object;
use super::pixels::{Crossing, FRAMES, Pixels, TICKS};
use super::spec::{SceneSpec, SpecError};
use super::texture::Texture;
use crate::random::Random;
use crate::{Event, Geometry, Polarity};
use alloc::vec::Vec;

/// A loop lasts a multiple of this, one step of EVT3's TIME_HIGH, so that only those words change from loop to loop.
pub(super) const PERIOD_STEP_US: u32 = 4096;

/// Longest loop, well within the 8.4 s of silence that EVT3 can tell.
const PERIOD_US_MAX: u32 = 1024 * PERIOD_STEP_US;

/// Rows are read out in turn, each once in this time; its events then carry that time, as a real readout's do.
const READOUT_US: u32 = 32;

/// Stretch of time in which an event is looked for.
const BUCKET_US: u32 = 64;

/// Objects that move by themselves.
const OBJECTS: u32 = 3;

/// Events of one shape of the texture in one loop, and of one object, roughly.
const SHAPE_EVENTS: u64 = 35_000;
const OBJECT_EVENTS: u64 = 55_000;

/// Where an event comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
#[repr(u8)]
pub enum Label {
    /// The scene: a change of brightness.
    Signal = 0,
    /// A pixel's reference that leaked away.
    Leak = 1,
    /// Shot noise.
    Shot = 2,
    /// A pixel that fires all the time.
    Hot = 3,
}

impl Label {
    /// All labels, in the order of their values.
    pub const ALL: [Self; 4] = [Self::Signal, Self::Leak, Self::Shot, Self::Hot];

    const fn from_bits(bits: u64) -> Self {
        match bits & 3 {
            0 => Self::Signal,
            1 => Self::Leak,
            2 => Self::Shot,
            _ => Self::Hot,
        }
    }
}

/// Numbers of events by [`Label`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LabelCounts([u64; 4]);

impl LabelCounts {
    /// Counts one more.
    pub fn count(&mut self, label: Label) {
        if let Some(n) = self.0.get_mut(label as usize) {
            *n += 1;
        }
    }

    /// How many with this label.
    pub fn get(&self, label: Label) -> u64 {
        self.0.get(label as usize).copied().unwrap_or_default()
    }

    /// Events of the scene.
    pub fn signal(&self) -> u64 {
        self.get(Label::Signal)
    }

    /// Events of leak, shot noise and hot pixels.
    pub fn noise(&self) -> u64 {
        self.total() - self.signal()
    }

    /// All events.
    pub fn total(&self) -> u64 {
        self.0.iter().sum()
    }

    /// These and those.
    pub fn plus(&self, other: &Self) -> Self {
        let mut sum = *self;
        sum.0.iter_mut().zip(other.0).for_each(|(n, m)| *n += m);
        sum
    }

    fn times(&self, n: u64) -> Self {
        Self(self.0.map(|count| count * n))
    }

    /// These without those, of which there are no more than of these.
    pub fn minus(&self, other: &Self) -> Self {
        let mut rest = *self;
        rest.0.iter_mut().zip(other.0).for_each(|(n, m)| *n = n.saturating_sub(m));
        rest
    }
}

/// One loop of a synthetic scene: its events in the order of the sensor's readout, each with its label.
///
/// ```
/// use lobula_core::{Geometry, simulation::{Label, Scene, SceneSpec}};
/// let spec = SceneSpec { geometry: Geometry::new(64, 48), rate_evs: 100_000, ..SceneSpec::default() };
/// let scene = Scene::try_new(&spec)?;
/// let first = scene.events()[0];
/// // The same event of the tenth loop is what it is in the first.
/// let t = 10 * scene.period_us() + first.t() as u64;
/// assert_eq!(scene.label(t, first), Some(scene.labels()[0]));
/// assert_eq!(scene.counts(0, scene.period_us()).total(), scene.events().len() as u64);
/// # Ok::<(), lobula_core::simulation::SpecError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Scene {
    geometry: Geometry,
    period_us: u32,
    events: Vec<Event>,
    labels: Vec<Label>,
    buckets: Vec<Bucket>,
}

/// What comes before a stretch of [`BUCKET_US`].
#[derive(Clone, Copy, Debug, Default)]
struct Bucket {
    first: usize,
    before: LabelCounts,
}

impl Scene {
    /// Renders the scene: 0.5 s for 1280x720 at 1 Mev/s, 1.2 s at 30, and 9 bytes for each event of a loop.
    ///
    /// # Errors
    /// Where a number of the spec is out of its range.
    pub fn try_new(spec: &SceneSpec) -> Result<Self, SpecError> {
        spec.check()?;
        let rates = NoiseRates::of(spec);
        let signal_evs = (spec.rate_evs as u64 - rates.total_evs(spec.hot_pixels)).max(1);
        let crossings = crossings(spec, signal_evs);
        let period_us = period_us(crossings.len() as u64, signal_evs);
        let mut keys: Vec<u64> =
            crossings.iter().map(|c| Tagged::signal(c, period_us).key(period_us)).collect();
        drop(crossings);
        let mut random = Random::new(spec.seed, 3);
        noise(spec, rates, period_us, &mut random, |tagged| keys.push(tagged.key(period_us)));
        keys.sort_unstable();
        keys.dedup_by_key(|key| *key >> LABEL_BITS);
        let events = keys.iter().map(|key| Tagged::event(*key)).collect();
        let labels = keys.iter().map(|key| Label::from_bits(*key)).collect();
        let mut scene = Self { geometry: spec.geometry, period_us, events, labels, buckets: Vec::new() };
        scene.index();
        Ok(scene)
    }

    /// The sensor's size.
    pub const fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// How long a loop lasts, in µs.
    pub const fn period_us(&self) -> u64 {
        self.period_us as u64
    }

    /// The events of the first loop, from time 0 on.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// The label of each of [`events`](Self::events).
    pub fn labels(&self) -> &[Label] {
        &self.labels
    }

    /// Events per second, which are those of the spec but for rounding, and for scenes that move as slowly as they can.
    pub fn rate_evs(&self) -> u64 {
        self.events.len() as u64 * 1_000_000 / self.period_us().max(1)
    }

    /// What an event is that the camera sent at full time `t`; nothing if it never sent it.
    pub fn label(&self, t: u64, event: Event) -> Option<Label> {
        let t = (t % self.period_us().max(1)) as u32;
        let bucket = (t / BUCKET_US) as usize;
        let first = self.buckets.get(bucket)?.first;
        let end = self.buckets.get(bucket + 1)?.first;
        let wanted = order(Event::new(t, event.x(), event.y(), event.polarity()));
        let place = self.events.get(first..end)?.binary_search_by_key(&wanted, |event| order(*event)).ok()?;
        self.labels.get(first + place).copied()
    }

    /// How many events the camera sends from time `t0` on, before `t1`, in µs.
    pub fn counts(&self, t0: u64, t1: u64) -> LabelCounts {
        self.counts_before(t1.max(t0)).minus(&self.counts_before(t0))
    }

    /// What the first `n` events are that the camera sends, in as many loops as that takes.
    pub fn counts_of_first(&self, n: u64) -> LabelCounts {
        let whole = (self.labels.len() as u64).max(1);
        let rest = (n % whole) as usize;
        let bucket = self.buckets.partition_point(|bucket| bucket.first <= rest).checked_sub(1);
        let bucket = bucket.and_then(|i| self.buckets.get(i)).copied().unwrap_or_default();
        let mut counts = self.counts_of_loop().times(n / whole).plus(&bucket.before);
        for label in self.labels.get(bucket.first..rest).unwrap_or_default() {
            counts.count(*label);
        }
        counts
    }

    fn counts_of_loop(&self) -> LabelCounts {
        self.buckets.last().map(|bucket| bucket.before).unwrap_or_default()
    }

    fn counts_before(&self, t: u64) -> LabelCounts {
        let period = self.period_us().max(1);
        let mut counts = self.counts_of_loop().times(t / period);
        let rest = (t % period) as u32;
        let Some(bucket) = self.buckets.get((rest / BUCKET_US) as usize) else { return counts };
        counts = counts.plus(&bucket.before);
        let events = self.events.get(bucket.first..).unwrap_or_default();
        let labels = self.labels.get(bucket.first..).unwrap_or_default();
        for (_, label) in events.iter().zip(labels).take_while(|(event, _)| event.t() < rest) {
            counts.count(*label);
        }
        counts
    }

    fn index(&mut self) {
        let mut counts = LabelCounts::default();
        let mut place = 0;
        let mut labelled = self.events.iter().zip(&self.labels).peekable();
        for start in (0..=self.period_us).step_by(BUCKET_US as usize) {
            while let Some((_, label)) = labelled.next_if(|(event, _)| event.t() < start) {
                counts.count(*label);
                place += 1;
            }
            self.buckets.push(Bucket { first: place, before: counts });
        }
    }
}

/// What the pixels see in one loop of a scene that is busy enough for `signal_evs` at a natural pace.
fn crossings(spec: &SceneSpec, signal_evs: u64) -> Vec<Crossing> {
    let mut random = Random::new(spec.seed, 1);
    let objects: Vec<Object> = (0..OBJECTS).map(|_| Object::random(spec.geometry, &mut random)).collect();
    // 2.5 s a loop at 0.1 Mev/s, 0.14 s at 30: slower scenes are emptier, and faster ones both fuller and faster.
    let events = signal_evs * 790_000 / signal_evs.isqrt().max(1) / 1000;
    let room = spec.geometry.pixels() as u64 / 4000;
    let events = events.saturating_sub(OBJECTS as u64 * OBJECT_EVENTS);
    let shapes = (events / SHAPE_EVENTS).clamp(1, room.max(1)) as u32;
    let texture = Texture::new(spec.geometry, shapes, &mut random);
    Pixels::new(spec.geometry, texture, objects, &mut Random::new(spec.seed, 2)).run()
}

/// How long a loop of so many events lasts, in whole steps.
fn period_us(events: u64, signal_evs: u64) -> u32 {
    let step = PERIOD_STEP_US as u64;
    let steps = (events * 1_000_000 / signal_evs + step / 2) / step;
    (steps * step).clamp(step, PERIOD_US_MAX as u64) as u32
}

/// An event of the loop and its label.
pub(super) struct Tagged {
    pub(super) t: u32,
    pub(super) x: u16,
    pub(super) y: u16,
    pub(super) polarity: Polarity,
    pub(super) label: Label,
}

/// Bits of the sort key, from the least: label, x, polarity, y, time.
const LABEL_BITS: u32 = 2;
const X_BITS: u32 = 11;
const Y_BITS: u32 = 11;

impl Tagged {
    fn signal(crossing: &Crossing, period_us: u32) -> Self {
        let whole = (FRAMES * TICKS) as u64;
        let t = (crossing.ticks as u64 * period_us as u64 / whole) as u32;
        let Crossing { x, y, polarity, .. } = *crossing;
        Self { t, x, y, polarity, label: Label::Signal }
    }

    /// The time its row is read out, and all the rest, such that keys sort in the order of the readout.
    fn key(&self, period_us: u32) -> u64 {
        let slot = (self.y as u32 * 7) % READOUT_US;
        let wait = (READOUT_US + slot - self.t % READOUT_US) % READOUT_US;
        let t = (self.t + wait) % period_us.max(1);
        let key = (t as u64) << Y_BITS | self.y as u64;
        let key = key << 1 | self.polarity as u64;
        (key << X_BITS | self.x as u64) << LABEL_BITS | self.label as u64
    }

    fn event(key: u64) -> Event {
        let x = (key >> LABEL_BITS) & ((1 << X_BITS) - 1);
        let polarity = Polarity::from_bit((key >> (LABEL_BITS + X_BITS)) as u16 & 1);
        let key = key >> (LABEL_BITS + X_BITS + 1);
        Event::new((key >> Y_BITS) as u32, x as u16, (key & ((1 << Y_BITS) - 1)) as u16, polarity)
    }
}

/// What events of a scene are sorted by.
const fn order(event: Event) -> (u32, u16, bool, u16) {
    (event.t(), event.y(), event.is_on(), event.x())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(seed: u64, rate_evs: u32) -> Scene {
        let spec = SceneSpec { geometry: Geometry::new(160, 120), seed, rate_evs, ..SceneSpec::default() };
        Scene::try_new(&spec).unwrap()
    }

    #[test]
    fn a_seed_gives_the_same_scene_everywhere() {
        let (one, again, other) = (scene(7, 500_000), scene(7, 500_000), scene(8, 500_000));
        assert_eq!(one.events, again.events);
        assert_ne!(one.events, other.events);
        // Bit for bit the same on every machine: FNV-1a over the events and labels.
        let bytes = bytemuck::cast_slice::<Event, u8>(&one.events).iter().copied();
        let bytes = bytes.chain(one.labels.iter().map(|label| *label as u8));
        let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ b as u64).wrapping_mul(0x100_0000_01b3));
        assert_eq!((one.events.len(), hash), (203_889, 4_278_414_980_887_460_419));
    }

    #[test]
    fn the_rate_is_what_was_asked_for() {
        for rate in [100_000, 1_000_000, 5_000_000] {
            let scene = scene(1, rate);
            let off = scene.rate_evs().abs_diff(rate as u64) * 100 / rate as u64;
            assert!(off <= 10, "{rate}: {} in {} us", scene.rate_evs(), scene.period_us());
        }
    }

    #[test]
    fn counts_are_those_of_the_events_in_any_stretch() {
        let scene = scene(3, 300_000);
        let period = scene.period_us();
        for (t0, t1) in
            [(0, period), (1, 2), (777, 5_001), (period - 5, period + 5), (period / 2, 3 * period + 17)]
        {
            let mut naive = LabelCounts::default();
            for turn in 0..4 {
                for (event, label) in scene.events.iter().zip(&scene.labels) {
                    if (t0..t1).contains(&(turn * period + event.t() as u64)) {
                        naive.count(*label);
                    }
                }
            }
            assert_eq!(scene.counts(t0, t1), naive, "{t0}..{t1}");
        }
    }

    #[test]
    fn the_first_events_are_counted_over_loops() {
        let scene = scene(4, 300_000);
        let whole = scene.labels.len() as u64;
        for n in [0, 1, 2, 999, whole - 1, whole, whole + 1, 3 * whole + 12_345] {
            let mut naive = LabelCounts::default();
            scene.labels.iter().cycle().take(n as usize).for_each(|label| naive.count(*label));
            assert_eq!(scene.counts_of_first(n), naive, "{n}");
        }
    }

    #[test]
    fn every_event_finds_its_label_and_no_other_does() {
        let scene = scene(5, 300_000);
        for (event, label) in scene.events.iter().zip(&scene.labels) {
            assert_eq!(scene.label(4 * scene.period_us() + event.t() as u64, *event), Some(*label));
        }
        let found =
            (0..scene.period_us()).filter(|t| scene.label(*t, Event::new(0, 3, 3, Polarity::On)).is_some());
        let there = scene.events.iter().filter(|e| (e.x(), e.y(), e.is_on()) == (3, 3, true));
        assert_eq!(found.count(), there.count());
    }

    #[test]
    fn hot_pixels_are_few_places_and_many_events() {
        let scene = scene(2, 1_000_000);
        let mut places: Vec<(u16, u16)> = (scene.events.iter().zip(&scene.labels))
            .filter(|(_, label)| **label == Label::Hot)
            .map(|(event, _)| (event.x(), event.y()))
            .collect();
        assert!(places.len() > 200, "{}", places.len());
        places.sort_unstable();
        places.dedup();
        assert_eq!(places.len(), 20);
    }
}
