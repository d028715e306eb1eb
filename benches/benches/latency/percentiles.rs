//! What is told of many times.

use serde::{Deserialize, Serialize};

/// Times of the packets received, in ns.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Percentiles {
    /// How many packets.
    pub packets: usize,
    /// Half took no longer.
    pub p50: u64,
    /// 99 of 100 took no longer.
    pub p99: u64,
    /// 999 of 1000 took no longer.
    pub p999: u64,
    /// The longest.
    pub max: u64,
    /// Events lost to the receiver.
    pub lost: u64,
    /// Median of each stage, see [`Stages`].
    pub stages: Stages,
}

/// Where a packet's time went, in ns: due, arrived, decoded, published, received.
pub type Stages = [u64; 4];

impl Percentiles {
    /// Of these times.
    pub fn of(times_ns: &mut [u64], stages_ns: &[Stages], lost: u64) -> Self {
        times_ns.sort_unstable();
        let at = |per_mille: usize| {
            times_ns.get((times_ns.len() * per_mille / 1000).min(times_ns.len().saturating_sub(1))).copied()
        };
        let at = |per_mille| at(per_mille).unwrap_or_default();
        Self {
            packets: times_ns.len(),
            p50: at(500),
            p99: at(990),
            p999: at(999),
            max: at(1000),
            lost,
            stages: medians(stages_ns),
        }
    }
}

fn medians(stages_ns: &[Stages]) -> Stages {
    std::array::from_fn(|stage| {
        let mut times: Vec<u64> = stages_ns.iter().map(|stages| stages[stage]).collect();
        times.sort_unstable();
        times.get(times.len() / 2).copied().unwrap_or_default()
    })
}
