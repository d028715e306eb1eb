//! Windows that overlap, against an oracle that cuts the whole stream and draws each window from its events alone.

use crate::chunk_invariance::Splits;
use crate::streams::{self, Timed};
use crate::window::{Sliced, oracle};
use bytemuck::{Zeroable, cast_slice};
use lobula_core::representation::{Build, Count, Overlap, Parameters, Sliding};
use lobula_core::{
    BadGrid, Closed, Event, Geometry, Grid, Polarity, Representation, Shape, Slicer, Slide, SlidingSlicer,
    Span, Stride, Window, WrongGeometry, for_each_representation,
};
use proptest::prelude::*;

const GEOMETRY: Geometry = Geometry::new(16, 4);

/// A window with its events, and those of them that are new in it.
#[derive(Clone, Debug, PartialEq)]
struct Slid {
    closed: Closed,
    is_first: bool,
    inside: Vec<Timed>,
    coming: Vec<Timed>,
}

/// All windows of a stream, and what was counted.
#[derive(Debug, Default, PartialEq)]
struct AllSlid {
    windows: Vec<Slid>,
    late: u64,
    skipped: u64,
    overflowed: u64,
}

/// A stride with its events.
type OneStride = (Window, Vec<Timed>);

/// Strides of time are the windows of a slicer; those between two steps back of its clock make windows together. Strides of
/// events do as long as none of their windows is too long.
fn expected(events: &[Timed], grid: Grid, events_max: usize) -> AllSlid {
    let mut out = AllSlid::default();
    match grid {
        Grid::Time { stride_us, .. } => {
            let Sliced { windows: strides, late, skipped } = oracle(events, stride_us);
            out = AllSlid { late, skipped, ..out };
            for run in strides.chunk_by(|a, b| b.0.t0 >= a.0.t1) {
                slide_over(run, grid, events_max, 0, &mut out);
            }
        }
        Grid::Events { stride_events, .. } => {
            let (strides, n) = (strides_of_events(events, stride_events), grid.strides().unwrap());
            let (mut from, mut end, mut held) = (0, 0, 0);
            for at in 0..strides.len() {
                // Ends of windows do not step back.
                let latest = strides[at].0.t1.max(end);
                let t0 =
                    strides[(at + 1).saturating_sub(n).max(from)..=at].iter().map(|stride| stride.0.t0).min();
                if latest - t0.unwrap() > Slicer::PERIOD_US_MAX.into() {
                    held = slide_over(&strides[from..at], grid, events_max, held, &mut out);
                    from = at;
                }
                end = if from == at { strides[at].0.t1 } else { latest };
            }
            slide_over(&strides[from..], grid, events_max, held, &mut out);
        }
    }
    out
}

/// From the oldest event to the newest.
fn span_of<'a>(events: impl Iterator<Item = &'a Timed> + Clone) -> Window {
    let times = events.map(|timed| timed.t);
    Window { t0: times.clone().min().unwrap(), t1: times.max().unwrap() }
}

fn strides_of_events(events: &[Timed], stride_events: u32) -> Vec<OneStride> {
    let (mut strides, mut rest) = (vec![], events);
    while !rest.is_empty() {
        let short = |n: &usize| {
            let Window { t0, t1 } = span_of(rest[..*n].iter());
            t1 - t0 <= Slicer::PERIOD_US_MAX.into()
        };
        let n = (1..=rest.len().min(stride_events as usize)).take_while(short).last().unwrap();
        strides.push((span_of(rest[..n].iter()), rest[..n].to_vec()));
        rest = &rest[n..];
    }
    strides
}

/// That of the strides `first` to `last` of a run, of which there may be fewer than a window has.
fn window_of(run: &[OneStride], first: usize, last: usize, grid: Grid) -> Window {
    match grid {
        Grid::Time { period_us, .. } if run.len() < grid.strides().unwrap() => {
            Window { t0: run[0].0.t0, t1: run[0].0.t0 + u64::from(period_us) }
        }
        Grid::Time { period_us, .. } => {
            Window { t0: run[last].0.t1 - u64::from(period_us), t1: run[last].0.t1 }
        }
        Grid::Events { .. } => Window {
            t0: span_of(run[first..=last].iter().flat_map(|stride| &stride.1)).t0,
            t1: span_of(run[..=last].iter().flat_map(|stride| &stride.1)).t1,
        },
    }
}

/// Adds the windows of a run, whose first stride came while `held` events of the run before were still kept. Returns how
/// many of its own are at its end.
fn slide_over(run: &[OneStride], grid: Grid, events_max: usize, held: usize, out: &mut AllSlid) -> usize {
    if run.is_empty() {
        return held;
    }
    let n = grid.strides().unwrap();
    let late = |(stride, inside): &OneStride| inside.iter().filter(|e| e.t < stride.t0).count() as u64;
    let mut kept: Vec<&[Timed]> = vec![];
    let newest = |kept: &[&[Timed]], n| kept.iter().rev().take(n).map(|stride| stride.len()).sum::<usize>();
    for (_, inside) in run {
        let others = if kept.is_empty() { held } else { newest(&kept, n - 1) };
        kept.push(&inside[..inside.len().min(events_max - others)]);
        out.overflowed += (inside.len() - kept[kept.len() - 1].len()) as u64;
    }
    for last in n.min(run.len()) - 1..run.len() {
        let first = (last + 1).saturating_sub(n);
        let is_first = last + 1 == n.min(run.len());
        let window = window_of(run, first, last, grid);
        let came = run[first..=last].iter().map(|(_, inside)| inside.len() as u64).sum();
        let new = if is_first { first } else { last };
        let late = run[new..=last].iter().map(late).sum();
        out.windows.push(Slid {
            closed: Closed { window, events: came, late },
            is_first,
            inside: kept[first..=last].concat(),
            coming: kept[new..=last].concat(),
        });
    }
    newest(&kept, n - 1)
}

/// Feeds pieces of a stream to a slicer, and tells it the time now and then, as [`crate::window::slice`] does.
fn slide(
    events: &[Timed],
    grid: Grid,
    events_max: usize,
    splits: &mut Splits,
    each: &mut dyn FnMut(&Slide<'_>),
) -> SlidingSlicer<Vec<Stride>, Vec<Event>> {
    let strides = vec![Stride::default(); grid.strides().unwrap()];
    let memory = vec![Event::default(); events_max];
    let mut slicer = SlidingSlicer::try_new(grid, GEOMETRY, strides, memory).unwrap();
    let mut rest = events;
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(splits.next(streams::block_len(rest)));
        let memory = streams::block_events(piece);
        let (t_first, t_last) = (piece[0].t, piece[piece.len() - 1].t);
        if splits.next(3) == 1 {
            slicer.advance(t_first, &mut *each);
        }
        slicer.push(Span { t_first, t_last, geometry: GEOMETRY, events: &memory }, &mut *each).unwrap();
        rest = after;
    }
    slicer.finish(0, each);
    slicer
}

fn collect(events: &[Timed], grid: Grid, events_max: usize, splits: &mut Splits) -> AllSlid {
    let mut windows = vec![];
    let all = |spans: [Span<'_>; 2]| {
        let timed = |span: Span<'_>| {
            let events = span.events.iter().map(move |event| Timed { t: span.time(*event), event: *event });
            events.collect::<Vec<_>>()
        };
        spans.map(timed).concat()
    };
    let mut staying: Vec<Timed> = vec![];
    let slicer = slide(events, grid, events_max, splits, &mut |slide| {
        let (inside, coming) = (all(slide.events()), all(slide.coming()));
        assert_eq!(inside.len(), slide.len());
        assert!(slide.is_first() || inside == [&staying[..], &coming].concat(), "what stayed and what came");
        staying = inside[all(slide.leaving()).len()..].to_vec();
        windows.push(Slid { closed: slide.closed, is_first: slide.is_first(), inside, coming });
    });
    let (late, skipped, overflowed) = (slicer.late(), slicer.skipped(), slicer.overflowed());
    assert_eq!(windows.iter().map(|slid| slid.closed.late).sum::<u64>(), late, "each is told once");
    let came: usize = windows.iter().map(|slid| slid.coming.len()).sum();
    assert_eq!(came as u64 + overflowed, events.len() as u64, "each is in a window or counted");
    AllSlid { windows, late, skipped, overflowed }
}

fn grids() -> impl Strategy<Value = Grid> {
    let strides = || prop_oneof![Just(1u32), 2u32..5, 5u32..50, Just(Grid::STRIDES_MAX)];
    let stride_us = prop_oneof![1u32..100, 100u32..100_000, 500_000u32..1_000_000];
    let events = |(n, stride_events)| Grid::Events { slice_events: n * stride_events, stride_events };
    prop_oneof![
        (strides(), stride_us).prop_map(|(n, stride_us)| Grid::Time { period_us: n * stride_us, stride_us }),
        (strides(), 1u32..20).prop_map(events),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 48, ..Default::default() })]

    #[test]
    fn windows_are_the_oracle_s_however_the_stream_is_split(
        events in streams::stream(GEOMETRY, 120),
        grid in grids(),
        events_max in prop_oneof![Just(0usize), 1usize..20, Just(200)],
        seed in any::<u64>(),
    ) {
        let expected = expected(&events, grid, events_max);
        for mut splits in [Splits::Whole, Splits::Ones, Splits::random(seed)] {
            let found = collect(&events, grid, events_max, &mut splits);
            prop_assert!(found == expected, "{splits:?}: {found:?}");
        }
    }
}

// Few events: each long silence is a thousand windows.
chunk_invariance!(custom sliding_windows, streams::stream(GEOMETRY, 40), |events, splits| {
    collect(events, Grid::Time { period_us: 40_000, stride_us: 10_000 }, 50, splits)
});
chunk_invariance!(custom sliding_windows_of_events, streams::stream(GEOMETRY, 200), |events, splits| {
    collect(events, Grid::Events { slice_events: 12, stride_events: 3 }, 11, splits)
});

#[test]
fn a_stride_as_long_as_the_window_gives_the_windows_of_a_slicer() {
    let events = streams::stepping_back();
    for period_us in [1, 64, 4_096, 100_000] {
        let AllSlid { windows, late, skipped, .. } =
            collect(&events, Grid::Time { period_us, stride_us: period_us }, 100, &mut Splits::Ones);
        let windows = windows.into_iter().map(|slid| (slid.closed.window, slid.inside)).collect();
        assert_eq!(Sliced { windows, late, skipped }, oracle(&events, period_us));
    }
}

/// Bursts that no byte can count, silence shorter and longer than a window, steps back of the clock, and a restart.
fn eventful() -> Vec<Timed> {
    let mut random = 7u32;
    let mut next = |below: u32| {
        random = random.wrapping_mul(0x9E37_79B1).rotate_left(13) ^ 0x5bd1;
        random % below
    };
    let mut events = vec![];
    for (start, strides) in [(1u64 << 33, 30u64), (5_000, 12), ((1 << 32) - 4_500, 2)] {
        for stride in 0..strides {
            let many = [20, 300, 0, 0, 0, 0, 3, 700, 50, 50][(stride % 10) as usize];
            let mut times: Vec<u64> =
                (0..many).map(|_| start + stride * 1_000 + u64::from(next(1_000))).collect();
            times.sort_unstable();
            for t in times {
                let (t, x) = (if next(40) == 0 { t - u64::from(next(2_500)) } else { t }, next(5) * next(4));
                // Long runs of a polarity at a pixel: sums of signs reach either limit on the way.
                let polarity = Polarity::from_bit((stride / 2 % 2) as u16);
                events.push(Timed::new(t, x as u16, next(4) as u16 & 1, polarity));
            }
        }
    }
    events
}

/// Bytes of each tensor, drawn from its window's events alone; where the stage remembers, from what came since.
fn tensors_alone<R: Representation>(build: &dyn Fn() -> R, windows: &[Slid]) -> Vec<Vec<u8>> {
    let mut stage = build();
    let mut out = vec![R::Pixel::zeroed(); stage.shape().len()];
    let mut draw = |slid: &Slid| {
        let remembers = stage.overlap() == Overlap::Memory;
        if !remembers {
            stage = build();
        }
        let events = streams::block_events(if remembers { &slid.coming } else { &slid.inside });
        let window = slid.closed.window;
        let span = Span { t_first: window.t0, t_last: window.t1, geometry: GEOMETRY, events: &events };
        stage.begin(window, &mut out);
        stage.accumulate(span, &mut out).unwrap();
        stage.finish(&mut out);
        cast_slice(&out).to_vec()
    };
    windows.iter().map(&mut draw).collect()
}

/// The same, each from the one before where that can be.
fn tensors_slid<R: Representation>(stage: &mut R, events: &[Timed], grid: Grid) -> Vec<Vec<u8>> {
    let mut sliding = Sliding::new();
    let mut sum = vec![R::Pixel::zeroed(); Sliding::sum_len(stage)];
    let mut out = vec![R::Pixel::zeroed(); stage.shape().len()];
    cast_slice_garbage(&mut sum);
    let mut tensors = vec![];
    slide(events, grid, 4_000, &mut Splits::Random(5), &mut |slide| {
        cast_slice_garbage(&mut out);
        sliding.draw(stage, slide, &mut sum, &mut out).unwrap();
        tensors.push(cast_slice(&out).to_vec());
    });
    tensors
}

fn cast_slice_garbage<P: bytemuck::Pod>(memory: &mut [P]) {
    bytemuck::cast_slice_mut::<_, u8>(memory).fill(0xA5);
}

fn parameters() -> Parameters {
    let mut parameters = Parameters::default();
    (parameters.bins, parameters.tau_us, parameters.tile_px) = (5, 2_000, 2);
    parameters
}

fn check<R: Representation + Build<Vec<u32>>>(events: &[Timed], grid: Grid, windows: &[Slid]) {
    let build = || {
        let state = vec![0x5A5A_5A5A; R::state_len(&parameters(), GEOMETRY)];
        R::build(&parameters(), GEOMETRY, state).unwrap()
    };
    let alone = tensors_alone(&build, windows);
    let slid = tensors_slid(&mut build(), events, grid);
    assert_eq!(alone.len(), slid.len());
    for ((alone, slid), window) in alone.iter().zip(slid).zip(windows) {
        assert!(*alone == slid, "{} {grid:?} {:?}", std::any::type_name::<R>(), window.closed);
    }
}

macro_rules! check_all {
    ($($variant:ident $kind:ident $type:ty;)*) => {
        #[test]
        fn every_tensor_is_that_of_its_events_alone() {
            let events = eventful();
            let of_time = [1, 2, 5, 33].map(|n| Grid::Time { period_us: n * 1_000, stride_us: 1_000 });
            let of_events = [(1, 100), (7, 100), (2, 1_900)]
                .map(|(n, stride_events)| Grid::Events { slice_events: n * stride_events, stride_events });
            for grid in of_time.into_iter().chain(of_events) {
                let AllSlid { windows, overflowed, .. } = expected(&events, grid, 4_000);
                // A restart; and a silence that no window of events reaches over, where one has more than a stride.
                let runs = if matches!(grid, Grid::Events { .. }) && grid.strides() != Ok(1) { 3 } else { 2 };
                assert_eq!(windows.iter().filter(|slid| slid.is_first).count(), runs, "{grid:?}");
                assert_eq!(overflowed, 0);
                $(check::<$type>(&events, grid, &windows);)*
            }
        }
    };
}

for_each_representation!(check_all, Vec<u32>);

/// Counts how many events are drawn.
struct Spy(Count<u8>, u64);

impl Representation for Spy {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        self.0.shape()
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [u8]) -> Result<(), WrongGeometry> {
        self.1 += span.events.len() as u64;
        self.0.accumulate(span, out)
    }

    fn finish(&mut self, out: &mut [u8]) {
        self.0.finish(out);
    }

    fn overlap(&self) -> Overlap {
        self.0.overlap()
    }

    fn take_away(&mut self, span: Span<'_>, out: &mut [u8]) -> Result<bool, WrongGeometry> {
        self.1 += span.events.len() as u64;
        self.0.take_away(span, out)
    }
}

#[test]
fn a_sum_is_drawn_anew_only_where_a_pixel_was_full() {
    let grid = Grid::Time { period_us: 20_000, stride_us: 1_000 };
    let at = |i: u64, x: u16| Timed::new(i * 10, x, 0, Polarity::On);
    let calm: Vec<Timed> = (0..10_000).map(|i| at(i, (i % 16) as u16)).collect();
    let drawn = |events: &[Timed]| {
        let mut spy = Spy(Count::new(GEOMETRY), 0);
        tensors_slid(&mut spy, events, grid);
        spy.1
    };
    // Once in, and out again but for the last window's.
    assert_eq!(drawn(&calm), 10_000 + 8_000 + 100);
    // 2,000 events of one pixel in every window: each is drawn whole, and its oldest 100 taken away.
    let full: Vec<Timed> = (0..10_000).map(|i| at(i, 3)).collect();
    assert_eq!(drawn(&full), 81 * 2_100);
    // The burst fills a pixel in the windows that hold it: 20 of them, and 20 times 100 events less.
    let mut burst = calm.clone();
    burst[5_000..5_100].fill(at(5_000, 3));
    burst.splice(5_100..5_100, vec![at(5_100, 3); 200]);
    let expected = 10_200 + 8_000 + 200 + 100;
    let more = drawn(&burst) - expected;
    assert!((1..20 * 2_300).contains(&more), "{more}");
}

#[test]
fn refuses_grids_and_memory_that_do_not_fit() {
    let grid = |period_us, stride_us| Grid::Time { period_us, stride_us };
    let by_number = |slice_events, stride_events| Grid::Events { slice_events, stride_events };
    for (window, stride, strides) in [(33_000, 1_000, 33), (1, 1, 1), (1_024, 1, 1_024)] {
        assert_eq!(grid(window, stride).strides(), Ok(strides));
        assert_eq!(by_number(window, stride).strides(), Ok(strides));
    }
    for (window, stride) in [(0, 1), (1, 0), (0, 0), (10, 3), (10, 20), (2_048, 1)] {
        let text = by_number(window, stride).strides().unwrap_err().to_string();
        let named = format!("stride_events = {stride} is no stride of windows of {window} events: ");
        assert!(text.starts_with(&named), "{text}");
    }
    for (period_us, stride_us, text) in [
        (10, 3, "stride_us = 3 is no stride of windows of 10 µs: give a whole part of them, 1/1024 at least"),
        (10, 0, "stride_us = 0 is no stride of windows of 10 µs: give a whole part of them, 1/1024 at least"),
        (
            10,
            20,
            "stride_us = 20 is no stride of windows of 10 µs: give a whole part of them, 1/1024 at least",
        ),
        (
            2_048,
            1,
            "stride_us = 1 is no stride of windows of 2048 µs: give a whole part of them, 1/1024 at least",
        ),
        (0, 1, "period_us = 0 is not a period: give 1 to 1073741823 µs"),
        (1 << 30, 1 << 20, "period_us = 1073741824 is not a period: give 1 to 1073741823 µs"),
    ] {
        assert_eq!(grid(period_us, stride_us).strides().unwrap_err().to_string(), text);
    }
    let new =
        |n| SlidingSlicer::try_new(grid(30, 10), GEOMETRY, vec![Stride::default(); n], [Event::default(); 9]);
    assert_eq!(new(2).unwrap_err(), BadGrid::StridesLen { expected: 3, found: 2 });
    let found = Geometry::new(4, 16);
    let span = Span { t_first: 0, t_last: 0, geometry: found, events: &[] };
    let refused = new(3).unwrap().push(span, |_| panic!("a window of nothing"));
    assert_eq!(refused, Err(WrongGeometry { expected: GEOMETRY, found }));
}

#[test]
fn survives_the_end_of_time() {
    let grid = Grid::Time { period_us: 3_000, stride_us: 1_000 };
    let mut slicer =
        SlidingSlicer::try_new(grid, GEOMETRY, [Stride::default(); 3], [Event::default(); 4]).unwrap();
    let mut slides = 0;
    let mut each = |slide: &Slide<'_>| {
        assert!(slide.len() <= 4);
        slides += 1;
    };
    for t_first in [0, u64::MAX - 5, u64::MAX, 3] {
        let events =
            [t_first as u32, (t_first as u32).wrapping_add(9)].map(|t| Event::new(t, 0, 0, Polarity::On));
        let span = Span { t_first, t_last: t_first, geometry: GEOMETRY, events: &events };
        slicer.push(span, &mut each).unwrap();
    }
    slicer.finish(u64::MAX, &mut each);
    assert!(slides >= 3);
}

#[test]
fn a_still_scene_gives_windows_at_the_rate_of_the_stride() {
    let grid = Grid::Time { period_us: 3_000, stride_us: 1_000 };
    let mut slicer =
        SlidingSlicer::try_new(grid, GEOMETRY, [Stride::default(); 3], [Event::default(); 4]).unwrap();
    let mut windows = vec![];
    let mut each =
        |slide: &Slide<'_>| windows.push((slide.closed.window.t0, slide.closed.events, slide.len()));
    let events = [Event::new(5_500, 0, 0, Polarity::On)];
    slicer
        .push(Span { t_first: 5_500, t_last: 5_500, geometry: GEOMETRY, events: &events }, &mut each)
        .unwrap();
    slicer.advance(7_999 + Slicer::SLACK_US, &mut each);
    slicer.advance(8_000 + Slicer::SLACK_US, &mut each);
    slicer.advance(10_000 + Slicer::SLACK_US, &mut each);
    assert_eq!(windows, [(5_000, 1, 1), (6_000, 0, 0), (7_000, 0, 0)]);
}
