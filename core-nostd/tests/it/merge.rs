//! Streams merged in pieces, against all of them sorted at once.

use crate::chunk_invariance::{GEOMETRY, Splits};
use crate::streams::{self, Timed};
use lobula_core::merge::{Merge, MergeInput};
use lobula_core::{Event, Geometry, Polarity, SPAN_MAX_US, Sink, Span};
use proptest::prelude::*;

/// A few sorted streams, some empty, with many events of one time; each event tells its stream and its number.
fn inputs() -> impl Strategy<Value = Vec<Vec<Timed>>> {
    let step = prop_oneof![4 => 0u64..3, 2 => 0u64..200, 1 => 0u64..1 << 33];
    let one = (0u64..100, prop::collection::vec(step, 0..60));
    prop::collection::vec(one, 0..5).prop_map(|all| {
        let stream = |(which, (mut t, steps)): (usize, (u64, Vec<u64>))| {
            let of = |(i, step): (usize, u64)| {
                t += step;
                Timed::new(t, which as u16, i as u16 % 45, Polarity::On)
            };
            steps.into_iter().enumerate().map(of).collect()
        };
        all.into_iter().enumerate().map(stream).collect()
    })
}

/// Merges in pieces, into sinks of random room; a stream's time is told late, early or not at all.
fn merged(streams: &[Vec<Timed>], splits: &mut Splits) -> Vec<Timed> {
    let mut rests: Vec<&[Timed]> = streams.iter().map(|events| &events[..]).collect();
    let mut held: Vec<Vec<Event>> = vec![vec![]; streams.len()];
    let mut given: Vec<&[Timed]> = vec![&[]; streams.len()];
    let mut memory = [Event::default(); 32];
    let mut out = vec![];
    loop {
        // A stream whose events are all merged gets the next of its own.
        for i in 0..streams.len() {
            if given[i].is_empty() {
                let len = splits.next(streams::block_len(rests[i]));
                (given[i], rests[i]) = rests[i].split_at(len);
                held[i] = streams::block_events(given[i]);
            }
        }
        let mut inputs: Vec<MergeInput<'_>> = (0..streams.len())
            .map(|i| {
                let t = |timed: Option<&Timed>| timed.map_or(0, |timed| timed.t);
                let (t_first, t_last) = (t(given[i].first()), t(given[i].last()));
                let span = Span { t_first, t_last, geometry: GEOMETRY, events: &held[i] };
                match rests[i].first() {
                    None => MergeInput::last(span),
                    Some(next) if splits.next(2) == 1 => MergeInput { span, now: next.t },
                    Some(_) => MergeInput::new(span),
                }
            })
            .collect();
        let room = 1 + splits.next(31);
        let mut sink = Sink::new(&mut memory[..room]);
        let count = Merge::new(GEOMETRY).merge(&mut inputs, &mut sink).unwrap();
        let block = sink.block(GEOMETRY);
        assert_eq!(count, block.len());
        out.extend(block.span().events.iter().map(|e| Timed { t: block.span().time(*e), event: *e }));
        let left: Vec<usize> = inputs.iter().map(|input| input.span.events.len()).collect();
        for (i, left) in left.into_iter().enumerate() {
            let taken = given[i].len() - left;
            given[i] = &given[i][taken..];
            held[i].drain(..taken);
        }
        if count == 0 {
            assert!(given.iter().chain(&rests).all(|rest| rest.is_empty()), "stuck with events left");
            return out;
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn is_a_stable_sort_of_all(streams in inputs(), seed: u64) {
        let mut expected: Vec<Timed> = streams.iter().flatten().copied().collect();
        expected.sort_by_key(|timed| timed.t);
        prop_assert_eq!(merged(&streams, &mut Splits::random(seed)), expected);
    }
}

chunk_invariance!(custom merge, inputs(), |streams: &Vec<Vec<Timed>>, splits: &mut Splits| merged(streams, splits));

#[test]
fn waits_for_the_stream_that_is_behind_and_for_no_other() {
    let events = [10u32, 20, 30].map(|t| Event::new(t, 0, 0, Polarity::On));
    let span = |events| Span { t_first: 10, t_last: 30, geometry: GEOMETRY, events };
    let merged = |now| {
        let mut inputs = [MergeInput::new(span(&events)), MergeInput { span: span(&[]), now }];
        let mut memory = [Event::default(); 64];
        Merge::new(GEOMETRY).merge(&mut inputs, &mut Sink::new(&mut memory)).unwrap()
    };
    assert_eq!([0, 9, 10, 20, 29, 30, u64::MAX].map(merged), [0, 0, 1, 2, 2, 3, 3]);
}

#[test]
fn a_full_sink_and_one_of_another_time_stop_it() {
    let events = [0u32, 5, 6].map(|t| Event::new(t, 0, 0, Polarity::On));
    let span = Span { t_first: 0, t_last: 6, geometry: GEOMETRY, events: &events };
    let mut inputs = [MergeInput::last(span)];
    let mut memory = [Event::default(); 2];
    let mut sink = Sink::new(&mut memory);
    assert_eq!(Merge::new(GEOMETRY).merge(&mut inputs, &mut sink), Ok(2));
    assert_eq!(Merge::new(GEOMETRY).merge(&mut inputs, &mut sink), Ok(0));
    sink.clear();
    let far = 6 + SPAN_MAX_US;
    assert!(sink.push(far, Event::default()));
    assert_eq!(Merge::new(GEOMETRY).merge(&mut inputs, &mut sink), Ok(0), "another block's event");
    assert_eq!(inputs[0].span.events.len(), 1);
}

#[test]
fn sensors_must_fit() {
    let merge = Merge::fitting([Geometry::new(10, 30), Geometry::new(20, 5)]);
    assert_eq!(merge.geometry(), Geometry::new(20, 30));
    let span = |geometry| Span { t_first: 0, t_last: 0, geometry, events: &[] };
    let mut memory = [Event::default(); 4];
    let mut fits =
        |geometry| merge.merge(&mut [MergeInput::last(span(geometry))], &mut Sink::new(&mut memory)).is_ok();
    assert!(fits(Geometry::new(10, 30)) && !fits(Geometry::new(21, 5)));
}
