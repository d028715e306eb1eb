//! Operations on whole slices against the standard library's stable sort.

use crate::chunk_invariance::{GEOMETRY, LEN_MAX};
use crate::streams::{self, Timed};
use lobula_core::slice::{SliceNormalize, SliceReverse, SliceSort};
use lobula_core::transform::TransformError;
use lobula_core::{Block, Event, Geometry, Polarity};
use proptest::prelude::*;

fn timed(block: &Block<'_>) -> Vec<Timed> {
    let span = block.span();
    span.events.iter().map(|event| Timed { t: span.time(*event), event: *event }).collect()
}

/// The events that fit one block, changed by `operate`.
fn run(events: &[Timed], operate: impl FnOnce(&mut Block<'_>)) -> Vec<Timed> {
    let mut memory = streams::block_events(events);
    if events.is_empty() {
        operate(&mut Block::new(0, 0, GEOMETRY, &mut memory));
        return vec![];
    }
    let mut block = streams::block(events, &mut memory, GEOMETRY);
    operate(&mut block);
    if let Some(last) = timed(&block).last() {
        assert!(block.t_last >= last.t || block.t_last == events.last().unwrap().t);
    }
    timed(&block)
}

fn scratch(events: &[Timed]) -> Vec<Event> {
    vec![Event::new(9, 9, 9, Polarity::On); events.len() + 3]
}

fn sorted(events: &[Timed]) -> Vec<Timed> {
    let mut events = events.to_vec();
    events.sort_by_key(|timed| timed.t);
    events
}

fn reversed(events: &[Timed]) -> Vec<Timed> {
    let (min, max) =
        (events.iter().map(|e| e.t).min().unwrap_or(0), events.iter().map(|e| e.t).max().unwrap_or(0));
    let mirror = |e: &Timed| {
        Timed::new(min + max - e.t, e.event.x(), e.event.y(), Polarity::from_bit(!e.event.is_on() as u16))
    };
    sorted(&events.iter().map(mirror).collect::<Vec<_>>())
}

/// Times anywhere in a block, many of them alike.
fn jumbled() -> impl Strategy<Value = Vec<Timed>> {
    (0u64..1 << 40, 0u32..32, prop::collection::vec(any::<u32>(), 0..2000)).prop_map(
        |(start, bits, times)| {
            let of = |(i, t): (usize, &u32)| {
                Timed::new(start + u64::from(t >> 1 >> bits), i as u16 % 123, 3, Polarity::On)
            };
            times.iter().enumerate().map(of).collect()
        },
    )
}

fn fitting(events: &[Timed]) -> &[Timed] {
    &events[..streams::block_len(events)]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn sorts_as_the_standard_library_does(
        events in prop_oneof![jumbled(), streams::stream(GEOMETRY, LEN_MAX)],
    ) {
        let events = fitting(&events);
        let found = run(events, |block| SliceSort::new(scratch(events)).apply(block).unwrap());
        prop_assert_eq!(found, sorted(events));
    }

    #[test]
    fn reverses_as_mirroring_and_sorting_does(
        events in prop_oneof![jumbled(), streams::stream(GEOMETRY, LEN_MAX)],
    ) {
        let events = fitting(&events);
        let once = run(events, |block| SliceReverse::new(scratch(events)).apply(block).unwrap());
        prop_assert_eq!(&once, &reversed(events));
        let twice = run(events, |block| {
            SliceReverse::new(scratch(events)).apply(block).unwrap();
            SliceReverse::new(scratch(events)).apply(block).unwrap();
        });
        prop_assert_eq!(twice, sorted(events));
    }

    #[test]
    fn normalizes_to_the_earliest(events in prop_oneof![jumbled(), streams::stream(GEOMETRY, LEN_MAX)]) {
        let events = fitting(&events);
        let earliest = events.iter().map(|timed| timed.t).min().unwrap_or(0);
        let found = run(events, |block| SliceNormalize.apply(block));
        let shifted = |e: &Timed| Timed::new(e.t - earliest, e.event.x(), e.event.y(), e.event.polarity());
        prop_assert_eq!(found, events.iter().map(shifted).collect::<Vec<_>>());
    }
}

#[test]
fn without_enough_scratch_memory_nothing_is_done() {
    let mut events = [30, 10].map(|t| Event::new(t, 1, 2, Polarity::On));
    let before = events;
    let mut block = Block::new(30, 10, Geometry::new(4, 4), &mut events);
    let short = Err(TransformError::MemoryTooShort { needed: 2, found: 1 });
    assert_eq!(SliceSort::new([Event::default()]).apply(&mut block), short);
    assert_eq!(SliceReverse::new([Event::default()]).apply(&mut block), short);
    assert_eq!(events, before);
}

#[test]
fn an_anchor_before_all_events_stays_before_them() {
    // The first event was filtered out; the others are almost 2^31 µs later.
    let mut events = [2_000_000_500u32, 2_000_000_000].map(|t| Event::new(t, 1, 2, Polarity::On));
    let mut block = Block::new(0, 2_000_000_000, Geometry::new(4, 4), &mut events);
    SliceNormalize.apply(&mut block);
    assert_eq!(
        (block.t_first, timed(&block).iter().map(|timed| timed.t).collect::<Vec<_>>()),
        (0, vec![500, 0])
    );
}
