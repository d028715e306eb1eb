//! Percentiles of times.

use serde::{Deserialize, Serialize};

/// Times in ns by nearest rank.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Half of all are at most this.
    pub p50: u64,
    /// 99 of 100.
    pub p99: u64,
    /// 999 of 1000.
    pub p999: u64,
}

impl Percentiles {
    /// Of the times, which are sorted for it; zeros of none.
    pub fn of(times_ns: &mut [u64]) -> Self {
        times_ns.sort_unstable();
        let rank = |thousandths: usize| {
            let place = (times_ns.len() * thousandths).div_ceil(1000).saturating_sub(1);
            times_ns.get(place).copied().unwrap_or_default()
        };
        Self { p50: rank(500), p99: rank(990), p999: rank(999) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_are_nearest() {
        let mut times: Vec<u64> = (1..=1000).rev().collect();
        assert_eq!(Percentiles::of(&mut times), Percentiles { p50: 500, p99: 990, p999: 999 });
        assert_eq!(Percentiles::of(&mut [7]), Percentiles { p50: 7, p99: 7, p999: 7 });
        assert_eq!(Percentiles::of(&mut []), Percentiles::default());
    }
}
