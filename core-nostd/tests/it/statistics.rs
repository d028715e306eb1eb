//! Statistics against oracles that see the whole stream with 64-bit times, in any split.

use crate::chunk_invariance::{GEOMETRY, Splits};
use crate::streams::{self, Timed};
use lobula_core::statistics::{BadStatistic, EventRate, Intervals, PixelIntervals, PixelTimes, Tally};
use lobula_core::{Geometry, Polarity, Span};
use std::collections::HashMap;

/// Calls `each` with blocks of the stream.
fn blocks(events: &[Timed], splits: &mut Splits, mut each: impl FnMut(Span<'_>)) {
    let mut rest = events;
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(splits.next(streams::block_len(rest)));
        let memory = streams::block_events(piece);
        let (t_first, t_last) = (piece[0].t, piece[piece.len() - 1].t);
        each(Span { t_first, t_last, geometry: GEOMETRY, events: &memory });
        rest = after;
    }
}

/// Counts on a grid from the middle of the stream on, so that some events lie before it and some after.
fn rate(events: &[Timed], splits: &mut Splits) -> (Vec<Tally>, u64) {
    let start = events.get(events.len() / 4).map_or(0, |timed| timed.t);
    let mut rate = EventRate::try_new(start, 1_000, vec![Tally { on: 7, off: 7 }; 50]).unwrap();
    blocks(events, splits, |span| rate.push(span));
    let total = rate.total();
    assert_eq!(total.events() + rate.outside(), events.len() as u64);
    let mut bins = vec![Tally::default(); 50];
    for timed in events.iter().filter(|timed| (start..start + 50_000).contains(&timed.t)) {
        let bin = &mut bins[((timed.t - start) / 1_000) as usize];
        *(if timed.event.polarity() == Polarity::On { &mut bin.on } else { &mut bin.off }) += 1;
    }
    assert_eq!(rate.bins(), bins);
    (bins, rate.outside())
}

fn intervals(events: &[Timed], splits: &mut Splits) -> (Vec<u64>, u64, Vec<PixelTimes>) {
    let memory = vec![PixelTimes { first: 1, last: 2, events: 3 }; GEOMETRY.pixels()];
    let mut intervals = Intervals::try_new(GEOMETRY, memory).unwrap();
    blocks(events, splits, |span| intervals.push(span).unwrap());
    let mut times: HashMap<usize, Vec<u64>> = HashMap::new();
    for timed in events {
        times.entry(GEOMETRY.index(timed.event.x(), timed.event.y())).or_default().push(timed.t);
    }
    let (mut histogram, mut backward) = (vec![0; 65], 0);
    for pair in times.values().flat_map(|times| times.windows(2)) {
        match (0..65).find(|bin| pair[1] >= pair[0] && u128::from(pair[1] - pair[0]) < 1 << *bin) {
            Some(bin) => histogram[bin] += 1,
            None => backward += 1,
        }
    }
    assert_eq!((&intervals.histogram()[..], intervals.backward()), (&histogram[..], backward));
    for (at, pixel) in intervals.pixels().iter().enumerate() {
        let times = times.get(&at).map_or(&[][..], |times| times);
        assert_eq!(pixel.events, times.len() as u64);
        if let [first, .., last] = times {
            assert_eq!((pixel.first, pixel.last), (*first, *last));
            let mean = (last >= first).then(|| (last - first) as f64 / (times.len() - 1) as f64);
            assert_eq!(pixel.mean_interval_us(), mean);
        }
    }
    (histogram, backward, intervals.pixels().to_vec())
}

/// Each pixel's histogram; the last of the bins takes all that is longer.
fn histograms(events: &[Timed], splits: &mut Splits) -> Vec<u32> {
    const BINS: usize = 6;
    let (pixels, counts) =
        (vec![PixelTimes::default(); GEOMETRY.pixels()], vec![7; BINS * GEOMETRY.pixels()]);
    let mut intervals = PixelIntervals::try_new(GEOMETRY, pixels, counts).unwrap();
    blocks(events, splits, |span| intervals.push(span).unwrap());
    let mut expected: HashMap<(u16, u16), [u32; BINS]> = HashMap::new();
    let mut last: HashMap<(u16, u16), u64> = HashMap::new();
    for Timed { t, event } in events {
        let before = last.insert((event.x(), event.y()), *t);
        if let Some(interval) = before.and_then(|before| t.checked_sub(before)) {
            let bin = [1, 2, 4, 8, 16].iter().filter(|start| interval >= **start).count();
            expected.entry((event.x(), event.y())).or_default()[bin] += 1;
        }
    }
    for (x, y) in (0..GEOMETRY.height).flat_map(|y| (0..GEOMETRY.width).map(move |x| (x, y))) {
        assert_eq!(intervals.histogram(x, y), expected.get(&(x, y)).unwrap_or(&[0; BINS]));
    }
    assert!(intervals.histogram(GEOMETRY.width, 0).is_empty());
    let all: u64 = intervals.counts().iter().map(|count| u64::from(*count)).sum();
    assert_eq!(all, intervals.intervals().histogram().iter().sum::<u64>());
    intervals.counts().to_vec()
}

chunk_invariance!(events histograms_of_pixels, super::histograms);
chunk_invariance!(events event_rate, super::rate);
chunk_invariance!(events pixel_intervals, super::intervals);

#[test]
fn rates_and_balances() {
    let tally = Tally { on: 3, off: 1 };
    assert_eq!((tally.events(), tally.per_second(2_000), tally.balance()), (4, 2_000.0, 0.5));
    assert_eq!((Tally::default().per_second(5), Tally::default().balance()), (0.0, 0.0));
    assert_eq!((tally.per_second(0), Tally { on: 0, off: 9 }.balance()), (0.0, -1.0));
    let pixel = PixelTimes { first: 10, last: 30, events: 3 };
    assert_eq!((pixel.mean_interval_us(), pixel.per_second(1_000_000)), (Some(10.0), 3.0));
    assert_eq!(PixelTimes { events: 1, ..pixel }.mean_interval_us(), None);
}

#[test]
fn statistics_refuse_what_makes_no_sense() {
    assert_eq!(EventRate::try_new(0, 0, [Tally::default(); 1]).unwrap_err(), BadStatistic::BinUs);
    let few = Intervals::try_new(Geometry::new(2, 2), [PixelTimes::default(); 3]).unwrap_err();
    assert_eq!(few, BadStatistic::StateLen { expected: 4, found: 3 });
    for (found, expected) in [(0, 4), (3, 4), (9, 8)] {
        let pixels = [PixelTimes::default(); 4];
        let refused = PixelIntervals::try_new(Geometry::new(2, 2), pixels, vec![0; found]).unwrap_err();
        assert_eq!(refused, BadStatistic::StateLen { expected, found });
    }
    let mut intervals = Intervals::try_new(Geometry::new(2, 2), [PixelTimes::default(); 4]).unwrap();
    let other = Span { t_first: 0, t_last: 0, geometry: Geometry::new(3, 2), events: &[] };
    assert!(intervals.push(other).is_err());
}
