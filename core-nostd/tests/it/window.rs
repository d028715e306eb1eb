//! The slicer against an oracle that sees the whole stream with 64-bit times.

use crate::chunk_invariance::{Splits, assert_invariant};
use crate::streams::{self, Timed};
use lobula_core::{Closed, Event, Geometry, Piece, Polarity, Slicer, Span, Window};
use proptest::prelude::*;

const GEOMETRY: Geometry = Geometry::new(16, 4);
const RESTART_US: u64 = 1 << 29;

/// A stream cut at a grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sliced {
    pub windows: Vec<(Window, Vec<Timed>)>,
    pub late: u64,
    pub skipped: u64,
}

impl Sliced {
    /// The windows, of a silence the first only: the others are as many as nobody cares to draw.
    pub fn heard(self) -> Vec<(Window, Vec<Timed>)> {
        let mut silent = false;
        let mut heard =
            |inside: &[Timed]| !(std::mem::replace(&mut silent, inside.is_empty()) && inside.is_empty());
        self.windows.into_iter().filter(|(_, inside)| heard(inside)).collect()
    }
}

/// Cuts as the rules say: each event goes to the window of its time, or the newest one when it is older.
pub fn oracle(events: &[Timed], period_us: u32) -> Sliced {
    let period = u64::from(period_us);
    let window = |index: u64| Window { t0: index * period, t1: (index + 1) * period };
    let mut out = Sliced::default();
    let mut newest: Option<u64> = None;
    for timed in events {
        let own = timed.t / period;
        let index = match newest {
            Some(newest) if own < newest && timed.t + RESTART_US >= newest * period => newest,
            _ => own,
        };
        if newest != Some(index) {
            let empty = newest.map_or(0, |newest| index.saturating_sub(newest + 1));
            let shown = empty.min(Slicer::EMPTY_MAX);
            out.skipped += empty - shown;
            out.windows.extend((0..shown).map(|i| (window(newest.unwrap() + 1 + i), vec![])));
            out.windows.push((window(index), vec![]));
            newest = Some(index);
        }
        let (window, inside) = out.windows.last_mut().unwrap();
        out.late += u64::from(timed.t < window.t0);
        inside.push(*timed);
    }
    out
}

/// Feeds pieces of a stream to a slicer, and each piece to `each`. Before some pieces the slicer is told the time, as
/// a decoder knows it: that of the next event, or as little later as it may step back.
pub fn slice(
    events: &[Timed],
    period_us: u32,
    geometry: Geometry,
    splits: &mut Splits,
    mut each: impl FnMut(Piece<'_>),
) -> Slicer {
    let mut slicer = Slicer::try_new(period_us).unwrap();
    let mut rest = events;
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(splits.next(streams::block_len(rest)));
        let memory = streams::block_events(piece);
        let (t_first, t_last) = (piece[0].t, piece[piece.len() - 1].t);
        match splits.next(3) {
            1 => slicer.advance(t_first, &mut each),
            2 => slicer.advance(t_first + Slicer::SLACK_US, &mut each),
            _ => {}
        }
        slicer.push(Span { t_first, t_last, geometry, events: &memory }, &mut each);
        rest = after;
    }
    slicer.finish(0, &mut each);
    slicer
}

fn collect(events: &[Timed], period_us: u32, splits: &mut Splits) -> Sliced {
    let mut windows: Vec<(Window, Vec<Timed>)> = vec![];
    let mut open = false;
    let slicer = slice(events, period_us, GEOMETRY, splits, |piece| match piece {
        Piece::Begin(window) => {
            assert!(!open, "a window begins in another");
            open = true;
            windows.push((window, vec![]));
        }
        Piece::Events(span) => {
            assert!(open && !span.events.is_empty());
            let timed = |event: &Event| Timed { t: span.time(*event), event: *event };
            windows.last_mut().unwrap().1.extend(span.events.iter().map(timed));
        }
        Piece::End(Closed { window, events, late }) => {
            assert!(open);
            open = false;
            let (begun, inside) = windows.last().unwrap();
            assert_eq!(*begun, window);
            assert_eq!(events, inside.len() as u64);
            assert_eq!(late, inside.iter().filter(|timed| timed.t < window.t0).count() as u64);
        }
    });
    assert!(!open, "the last window never ends");
    Sliced { windows, late: slicer.late(), skipped: slicer.skipped() }
}

fn periods() -> impl Strategy<Value = u32> {
    prop_oneof![1u32..100, 100u32..100_000, 1_000_000u32..Slicer::PERIOD_US_MAX]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn cuts_as_the_oracle_however_the_stream_is_split(
        events in streams::stream(GEOMETRY, 300),
        period_us in periods(),
        seeds in any::<[u64; 3]>(),
    ) {
        prop_assert_eq!(collect(&events, period_us, &mut Splits::Whole), oracle(&events, period_us));
        assert_invariant(&events[..], &seeds, |events, splits| collect(events, period_us, splits));
    }
}

#[test]
fn steps_back_are_late_and_not_lost() {
    let events = streams::stepping_back();
    for period_us in [1, 64, 1_000, 4_096, 100_000] {
        let sliced = collect(&events, period_us, &mut Splits::Ones);
        assert_eq!(sliced, oracle(&events, period_us), "period {period_us}");
        assert_eq!(sliced.windows.iter().map(|(_, inside)| inside.len()).sum::<usize>(), events.len());
    }
    assert_eq!(oracle(&events, 4_096).late, 5);
}

/// What closes when stream time goes on without events, as `t0` and number of events.
fn closed(times: &[u64], now: &[u64], period_us: u32) -> (Vec<(u64, u64)>, u64) {
    let mut slicer = Slicer::try_new(period_us).unwrap();
    let mut out = vec![];
    let mut each = |piece: Piece<'_>| {
        if let Piece::End(closed) = piece {
            out.push((closed.window.t0, closed.events));
        }
    };
    let events: Vec<Timed> = times.iter().map(|t| Timed::new(*t, 0, 0, Polarity::On)).collect();
    let memory = streams::block_events(&events);
    if let (Some(&t_first), Some(&t_last)) = (times.first(), times.last()) {
        slicer.push(Span { t_first, t_last, geometry: GEOMETRY, events: &memory }, &mut each);
    }
    now.iter().for_each(|now| slicer.advance(*now, &mut each));
    (out, slicer.skipped())
}

#[test]
fn a_still_scene_gives_windows_at_the_same_rate() {
    let slack = Slicer::SLACK_US;
    assert_eq!(closed(&[], &[50_000], 1_000).0, [], "no event yet, no grid");
    assert_eq!(closed(&[2_500], &[2_999 + slack], 1_000).0, []);
    assert_eq!(closed(&[2_500], &[3_000 + slack], 1_000).0, [(2_000, 1)]);
    assert_eq!(
        closed(&[2_500], &[3_000 + slack, 4_999 + slack, 5_000 + slack], 1_000).0,
        [(2_000, 1), (3_000, 0), (4_000, 0)]
    );
}

#[test]
fn of_a_long_silence_the_rest_is_skipped_and_counted() {
    let end = Slicer::SLACK_US + 10 * 3_000;
    let at_once = closed(&[0], &[end], 10);
    let bit_by_bit = closed(&[0], &(0..=end).step_by(7).chain([end]).collect::<Vec<_>>(), 10);
    assert_eq!(at_once, bit_by_bit);
    assert_eq!((at_once.0.len(), at_once.1), (1 + 1024, 3_000 - 1 - 1024));
}

#[test]
fn what_comes_out_in_all_does_not_depend_on_what_was_told_on_the_way() {
    let run = |advances: &[u64]| {
        let mut slicer = Slicer::try_new(100).unwrap();
        let mut out = vec![];
        let mut each = |piece: Piece<'_>| {
            if let Piece::End(closed) = piece {
                out.push(closed);
            }
        };
        let events = [Event::new(250, 0, 0, Polarity::On)];
        slicer.push(Span { t_first: 250, t_last: 250, geometry: GEOMETRY, events: &events }, &mut each);
        advances.iter().for_each(|now| slicer.advance(*now, &mut each));
        slicer.finish(5_000, &mut each);
        (out, slicer.skipped())
    };
    assert_eq!(run(&[]), run(&[300, 1_500, 4_700]));
    assert_eq!(run(&[]).0.len(), 49);
}

#[test]
fn refuses_what_is_no_period() {
    for period_us in [0, Slicer::PERIOD_US_MAX + 1, u32::MAX] {
        assert!(Slicer::try_new(period_us).is_err(), "{period_us}");
    }
    assert!(Slicer::try_new(1).is_ok() && Slicer::try_new(Slicer::PERIOD_US_MAX).is_ok());
}

#[test]
fn survives_the_end_of_time() {
    let mut slicer = Slicer::try_new(1_000).unwrap();
    let mut ends = 0;
    let mut each = |piece: Piece<'_>| ends += u32::from(matches!(piece, Piece::End(_)));
    for t_first in [0, u64::MAX - 5, u64::MAX, 3] {
        let events =
            [t_first as u32, (t_first as u32).wrapping_add(9)].map(|t| Event::new(t, 0, 0, Polarity::On));
        slicer.push(Span { t_first, t_last: t_first, geometry: GEOMETRY, events: &events }, &mut each);
    }
    slicer.finish(u64::MAX, &mut each);
    assert!(ends >= 4);
}
