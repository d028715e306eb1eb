//! The statistics, in bins from the earliest event on.

use crate::{Answer, Op, Slice};
use lobula_core::statistics::{EventRate, Tally};

const BIN_US: u64 = 700;

/// A line for each operation, and for each way of doing it.
pub const OPS: &[Op] = &[
    Op {
        name: "event_rate, counts",
        theirs: "(lambda r: np.stack([r[k].astype('u8') for k in ('t', 'positive', 'negative')]))(s.event_rate(bin_us=700))",
        ours: |slice| {
            let rate = rate(slice);
            let starts = (0..rate.bins().len() as u64).map(|bin| rate.start() + bin * BIN_US);
            let (on, off) = (rate.bins().iter().map(|bin| bin.on), rate.bins().iter().map(|bin| bin.off));
            Answer::Integers(vec![3, rate.bins().len()], starts.chain(on).chain(off).collect())
        },
    },
    Op {
        name: "event_rate, rates",
        theirs: "s.event_rate(bin_us=700)['rate'].astype('f4')",
        ours: |slice| {
            let rate = rate(slice);
            let rates = rate.bins().iter().map(|bin| bin.per_second(BIN_US) as f32).collect();
            Answer::Floats(vec![rate.bins().len()], rates)
        },
    },
];

fn rate(slice: &Slice) -> EventRate<Vec<Tally>> {
    let times = || slice.events.iter().map(|event| slice.span().time(*event));
    let (start, last) = (times().min().unwrap_or_default(), times().max().unwrap_or_default());
    let bins = vec![Tally::default(); ((last - start) / BIN_US + 1) as usize];
    let mut rate = EventRate::try_new(start, BIN_US, bins).unwrap();
    rate.push(slice.span());
    assert_eq!(rate.outside(), 0);
    rate
}
