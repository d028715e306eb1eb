//! What a sensor sends that is not in the scene: leak, shot noise and hot pixels.

use super::scene::{Label, Tagged};
use super::spec::SceneSpec;
use crate::Polarity;
use crate::random::Random;

/// Events per second of each kind of noise over the whole sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NoiseRates {
    pub(super) leak_evs: u64,
    pub(super) shot_evs: u64,
    /// Of one hot pixel.
    pub(super) hot_evs: u64,
}

impl NoiseRates {
    /// The rates of a spec, scaled down together where they would be more than it allows.
    pub(super) fn of(spec: &SceneSpec) -> Self {
        let pixels = spec.geometry.pixels() as u64;
        let leak = pixels * spec.leak_mhz as u64 / 1000;
        let shot = pixels * spec.shot_mhz as u64 / 1000;
        let hot = spec.hot_hz as u64;
        let total = leak + shot + hot * spec.hot_pixels as u64;
        let most = spec.rate_evs as u64 * spec.noise_percent_max as u64 / 100;
        if total <= most || total == 0 {
            return Self { leak_evs: leak, shot_evs: shot, hot_evs: hot };
        }
        let scale = |evs: u64| (evs as u128 * most as u128 / total as u128) as u64;
        Self { leak_evs: scale(leak), shot_evs: scale(shot), hot_evs: scale(hot) }
    }

    pub(super) const fn total_evs(&self, hot_pixels: u32) -> u64 {
        self.leak_evs + self.shot_evs + self.hot_evs * hot_pixels as u64
    }
}

/// The noise of one loop: as many events of each kind as its rate gives, at any time and place.
pub(super) fn noise(
    spec: &SceneSpec,
    rates: NoiseRates,
    period_us: u32,
    random: &mut Random,
    mut add: impl FnMut(Tagged),
) {
    let geometry = spec.geometry;
    let count = |evs: u64| evs * period_us as u64 / 1_000_000;
    let mut lone = |label: Label, n: u64, polarity: fn(&mut Random) -> Polarity| {
        for _ in 0..n {
            add(Tagged {
                t: random.below(period_us),
                x: random.below(geometry.width as u32) as u16,
                y: random.below(geometry.height as u32) as u16,
                polarity: polarity(random),
                label,
            });
        }
    };
    lone(Label::Leak, count(rates.leak_evs), |_| Polarity::On);
    lone(Label::Shot, count(rates.shot_evs), |random| Polarity::from_bit(random.below(2) as u16));
    for _ in 0..spec.hot_pixels {
        let x = random.below(geometry.width as u32) as u16;
        let y = random.below(geometry.height as u32) as u16;
        for _ in 0..count(rates.hot_evs) {
            // Hot pixels lean to one side: three events in four are ON.
            let polarity = if random.below(4) == 0 { Polarity::Off } else { Polarity::On };
            add(Tagged { t: random.below(period_us), x, y, polarity, label: Label::Hot });
        }
    }
}
