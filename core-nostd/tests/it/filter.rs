//! Every filter against a naive oracle with 64-bit times, over streams with silences of up to 100 hours.

use crate::streams::Timed;
use lobula_core::filter::*;
use lobula_core::time_map::TimeMap;
use lobula_core::{Block, Event, Filter, Geometry, Polarity, SPAN_MAX_US, WrongGeometry};
use proptest::prelude::*;
use std::collections::{HashMap, VecDeque};

/// Small, so that random events are neighbours.
const SENSOR: Geometry = Geometry::new(5, 4);
/// 100 hours in µs.
const GAP_MAX_US: i64 = 100 * 3600 * 1_000_000;
/// The period that the tests give to every filter; a multiple of the ticks of all maps.
const DT_US: u32 = 1024;

/// A step in time that matters to a map whose cells are `cell_us` long, by a random number: bursts, the filter's
/// period, the cells' borders, the largest step back, the age at which entries are clamped, long silence.
fn step(random: u64, cell_us: i64) -> i64 {
    let (kind, random) = (random % 32, (random / 32) as i64);
    let jitter = random % 40 - 20;
    match kind {
        0..8 => random % 40,
        8..12 => -random % 20,
        12..18 => DT_US as i64 + jitter,
        18..24 => random % 3000,
        24..28 => [-3, -2, -1, 1, 2, 3, 4, 5, 8, 16][(random / 64) as usize % 10] * cell_us / 2 + jitter,
        28 => (1 << 32) + jitter,
        29 => random % (1 << 33),
        30 => random % GAP_MAX_US,
        _ => 0,
    }
}

fn stream(cell_us: i64) -> impl Strategy<Value = Vec<Timed>> {
    let start = prop_oneof![
        Just(0u64),
        0..1u64 << 40,
        ((1u64 << 32) - 3000)..(1 << 32),
        ((1u64 << 34) - 30)..(1 << 34)
    ];
    (start, prop::collection::vec(any::<[u32; 3]>(), 0..120)).prop_map(move |(mut t, randoms)| {
        let timed = |[high, low, place]: [u32; 3]| {
            t = t.saturating_add_signed(step((high as u64) << 32 | low as u64, cell_us));
            let (x, y) = (place % SENSOR.width as u32, place / 8 % SENSOR.height as u32);
            Timed {
                t,
                event: Event::new(t as u32, x as u16, y as u16, Polarity::from_bit((place >> 31) as u16)),
            }
        };
        randoms.into_iter().map(timed).collect()
    })
}

/// Filters the stream in blocks of random length.
fn run(filter: &mut impl Filter, events: &[Timed], mut seed: u64) -> Vec<Timed> {
    let mut kept = vec![];
    let mut rest = events;
    while let Some(first) = rest.first() {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let wanted = [1, 2, 5, 1000][(seed >> 33) as usize % 4];
        let fits = rest.iter().take_while(|timed| timed.t.abs_diff(first.t) < SPAN_MAX_US).count();
        let (piece, after) = rest.split_at(fits.min(wanted));
        let mut memory: Vec<Event> = piece.iter().map(|timed| timed.event).collect();
        let mut block = Block::new(first.t, piece[piece.len() - 1].t, SENSOR, &mut memory);
        assert_eq!(filter.retain(&mut block), Ok(block.len()));
        kept.extend(
            block.span().events.iter().map(|event| Timed { t: block.span().time(*event), event: *event }),
        );
        rest = after;
    }
    kept
}

/// What a filter remembers, in the plainest way: the last full time of each pixel in ticks, if it fired at all.
struct Memory {
    last: [[Option<i128>; SENSOR.width as usize]; SENSOR.height as usize],
    on: [[bool; SENSOR.width as usize]; SENSOR.height as usize],
    burst: [[usize; SENSOR.width as usize]; SENSOR.height as usize],
    newest: Option<i128>,
    shift: u8,
    step_back_max: i128,
}

impl Memory {
    fn new(bits: u32, shift: u8) -> Self {
        Self {
            last: Default::default(),
            on: Default::default(),
            burst: Default::default(),
            newest: None,
            shift,
            step_back_max: 1 << (bits - 3),
        }
    }

    /// The time in ticks; a large step back is a restart of the clock, after which nothing is remembered.
    fn see(&mut self, timed: &Timed) -> i128 {
        let t = (timed.t >> self.shift) as i128;
        if self.newest.is_some_and(|newest| newest - t > self.step_back_max) {
            self.last = Default::default();
            self.newest = None;
        }
        self.newest = Some(self.newest.map_or(t, |newest| newest.max(t)));
        t
    }

    fn dt(&self) -> i128 {
        (DT_US >> self.shift) as i128
    }

    fn pixel(&mut self, event: Event) -> &mut Option<i128> {
        &mut self.last[event.y() as usize][event.x() as usize]
    }

    /// The neighbours of an event that fired at most `dt` before `t`: those beside it, and those at its corners.
    fn recent(&self, event: Event, t: i128, dt: i128, polarity: PolarityMatch) -> (usize, usize) {
        let (mut beside, mut corners) = (0, 0);
        for (y, row) in self.last.iter().enumerate() {
            for (x, last) in row.iter().enumerate() {
                let (dx, dy) = (x.abs_diff(event.x() as usize), y.abs_diff(event.y() as usize));
                let alike = polarity == PolarityMatch::Any || self.on[y][x] == event.is_on();
                let recent = (alike && last.is_some_and(|last| t - last <= dt)) as usize;
                match (dx, dy) {
                    (1, 0) | (0, 1) => beside += recent,
                    (1, 1) => corners += recent,
                    _ => {}
                }
            }
        }
        (beside, corners)
    }
}

fn refractory(memory: &mut Memory, timed: &Timed, refresh: Refresh) -> bool {
    let (t, dt) = (memory.see(timed), memory.dt());
    let last = memory.pixel(timed.event);
    let keep = last.is_none_or(|last| t - last >= dt);
    if keep || refresh == Refresh::All {
        *last = Some(t);
    }
    keep
}

fn background_activity(memory: &mut Memory, timed: &Timed, neighbours: Neighbours) -> bool {
    let t = memory.see(timed);
    let (beside, corners) = memory.recent(timed.event, t, memory.dt(), PolarityMatch::Any);
    *memory.pixel(timed.event) = Some(t);
    beside > 0 || (neighbours == Neighbours::Eight && corners > 0)
}

fn denoise(memory: &mut Memory, timed: &Timed, params: DenoiseParams) -> bool {
    let t = memory.see(timed);
    let event = timed.event;
    if HOT.contains(&(event.x(), event.y())) {
        return false;
    }
    let shift = memory.shift;
    let ticks = |us: u32| (us >> shift) as i128;
    let (beside, corners) = memory.recent(event, t, ticks(params.support_us), params.polarity_match);
    let last = *memory.pixel(event);
    let age_below = |us: u32| us > 0 && last.is_some_and(|last| t - last < ticks(us));
    let same = memory.on[event.y() as usize][event.x() as usize] == event.is_on();
    let noise = beside + corners < params.support as usize;
    let drop = age_below(params.refractory_us) || noise || (age_below(params.trail_us) && same);
    *memory.pixel(event) = Some(t);
    memory.on[event.y() as usize][event.x() as usize] = event.is_on();
    !drop
}

fn stcf(memory: &mut Memory, timed: &Timed, support: usize, polarity: PolarityMatch) -> bool {
    let t = memory.see(timed);
    let (beside, corners) = memory.recent(timed.event, t, memory.dt(), polarity);
    *memory.pixel(timed.event) = Some(t);
    memory.on[timed.event.y() as usize][timed.event.x() as usize] = timed.event.is_on();
    beside + corners >= support
}

/// How many events of its burst came before an event.
fn in_burst(memory: &mut Memory, timed: &Timed, or_equal: bool) -> usize {
    let (t, gap) = (memory.see(timed), memory.dt() + or_equal as i128);
    let (x, y) = (timed.event.x() as usize, timed.event.y() as usize);
    let goes_on = memory.last[y][x].is_some_and(|last| t - last < gap);
    let before = if goes_on && memory.on[y][x] == timed.event.is_on() { memory.burst[y][x] } else { 0 };
    (memory.last[y][x], memory.on[y][x], memory.burst[y][x]) = (Some(t), timed.event.is_on(), before + 1);
    before
}

/// Pixels that the tests call hot.
const HOT: [(u16, u16); 2] = [(0, 0), (3, 2)];

/// Runs a filter against its oracle over random streams, for a `u32` map and for `u16` maps of several ticks.
macro_rules! oracle {
    ($name:ident, $filter:ident, |$shift:ident| $params:expr, $oracle:expr) => {
        oracle!($name, $filter, |$shift| $params, $oracle, |_filter| {});
    };
    ($name:ident, $filter:ident, |$shift:ident| $params:expr, $oracle:expr, |$made:ident| $prepare:expr) => {
        mod $name {
            use super::*;

            fn agrees(filter: &mut impl Filter, bits: u32, shift: u8, events: &[Timed], seed: u64) {
                let mut memory = Memory::new(bits, shift);
                let oracle: fn(&mut Memory, &Timed) -> bool = $oracle;
                let expected: Vec<Timed> = events.iter().filter(|timed| oracle(&mut memory, timed)).copied().collect();
                assert_eq!(run(filter, events, seed), expected);
            }

            proptest! {
                #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

                #[test]
                fn u32_agrees(events in stream(1 << 29), seed: u64) {
                    let $shift = 0;
                    let memory = vec![0xA5A5_A5A5u32; $filter::<u32, ()>::required_len(SENSOR)];
                    #[allow(unused_mut)]
                    let mut $made = $filter::try_new(SENSOR, $params, memory).unwrap();
                    $prepare;
                    agrees(&mut $made, 32, 0, &events, seed);
                }

                #[test]
                fn u16_agrees(
                    (shift, events) in (0..=10u8).prop_flat_map(|shift| (Just(shift), stream(1 << (13 + shift)))),
                    seed: u64,
                ) {
                    let $shift = shift;
                    let memory = vec![0xA5A5u16; $filter::<u16, ()>::required_len(SENSOR)];
                    #[allow(unused_mut)]
                    let mut $made = $filter::try_new(SENSOR, $params, memory).unwrap();
                    $prepare;
                    agrees(&mut $made, 16, shift, &events, seed);
                }
            }

            #[test]
            fn refuses_another_sensor_and_short_memory() {
                let $shift = 0;
                let len = $filter::<u32, ()>::required_len(SENSOR);
                assert!($filter::<u32, _>::try_new(SENSOR, $params, vec![0; len - 1]).is_err());
                let mut filter = $filter::<u32, _>::try_new(SENSOR, $params, vec![0; len]).unwrap();
                let found = Geometry::new(4, 5);
                let refusal = WrongGeometry { expected: SENSOR, found };
                let mut events = [Event::default()];
                assert_eq!(filter.retain(&mut Block::new(0, 0, found, &mut events)), Err(refusal));
            }

            proptest! {
                #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

                /// By hand, an event at a time: no block tells the time, so no step may be near 2^31 µs.
                #[test]
                fn keep_agrees_with_retain(mut events in stream(1 << 20), seed: u64) {
                    let far = |pair: &[Timed]| pair[0].t.abs_diff(pair[1].t) >= 1 << 29;
                    let near = events.windows(2).position(far).map_or(events.len(), |before| before + 1);
                    events.truncate(near);
                    let $shift = 0;
                    let memory = || vec![0u32; $filter::<u32, ()>::required_len(SENSOR)];
                    let mut whole = $filter::<u32, _>::try_new(SENSOR, $params, memory()).unwrap();
                    let mut single = $filter::<u32, _>::try_new(SENSOR, $params, memory()).unwrap();
                    let kept: Vec<Timed> = events.iter().filter(|timed| single.keep(timed.event)).copied().collect();
                    prop_assert_eq!(run(&mut whole, &events, seed), kept);
                }
            }
        }
    };
}

oracle!(
    refractory_kept,
    Refractory,
    |shift| RefractoryParams { dt_us: DT_US, refresh: Refresh::Kept, shift },
    |memory, timed| refractory(memory, timed, Refresh::Kept)
);
oracle!(
    refractory_all,
    Refractory,
    |shift| RefractoryParams { dt_us: DT_US, refresh: Refresh::All, shift },
    |memory, timed| refractory(memory, timed, Refresh::All)
);
oracle!(
    background_activity_4,
    BackgroundActivity,
    |shift| BackgroundActivityParams { dt_us: DT_US, neighbours: Neighbours::Four, shift },
    |memory, timed| background_activity(memory, timed, Neighbours::Four)
);
oracle!(
    background_activity_8,
    BackgroundActivity,
    |shift| BackgroundActivityParams { dt_us: DT_US, neighbours: Neighbours::Eight, shift },
    |memory, timed| background_activity(memory, timed, Neighbours::Eight)
);
const fn background_activity_only() -> DenoiseParams {
    let polarity_match = PolarityMatch::Any;
    DenoiseParams { refractory_us: 0, support_us: DT_US, support: 1, polarity_match, trail_us: 0, shift: 0 }
}

const fn all_rules() -> DenoiseParams {
    DenoiseParams {
        refractory_us: DT_US,
        support_us: 2 * DT_US,
        support: 3,
        trail_us: 3 * DT_US,
        ..background_activity_only()
    }
}

oracle!(
    denoise_background_activity,
    Denoise,
    |shift| DenoiseParams { shift, ..background_activity_only() },
    |memory, timed| denoise(memory, timed, background_activity_only()),
    |denoise| HOT.iter().for_each(|(x, y)| assert!(denoise.mask(*x, *y)))
);
oracle!(
    denoise_all,
    Denoise,
    |shift| DenoiseParams { shift, ..all_rules() },
    |memory, timed| denoise(memory, timed, all_rules()),
    |denoise| HOT.iter().for_each(|(x, y)| assert!(denoise.mask(*x, *y)))
);

oracle!(
    denoise_alike,
    Denoise,
    |shift| DenoiseParams { shift, polarity_match: PolarityMatch::Same, ..all_rules() },
    |memory, timed| {
        denoise(memory, timed, DenoiseParams { polarity_match: PolarityMatch::Same, ..all_rules() })
    },
    |denoise| HOT.iter().for_each(|(x, y)| assert!(denoise.mask(*x, *y)))
);
oracle!(
    denoise_alike_without_trails,
    Denoise,
    |shift| DenoiseParams { shift, polarity_match: PolarityMatch::Same, ..background_activity_only() },
    |memory, timed| {
        let polarity_match = PolarityMatch::Same;
        denoise(memory, timed, DenoiseParams { polarity_match, ..background_activity_only() })
    },
    |denoise| HOT.iter().for_each(|(x, y)| assert!(denoise.mask(*x, *y)))
);

/// One oracle for each k, since each counts to another number.
macro_rules! stcf {
    ($($any:ident $same:ident $support:literal;)*) => {
        $(
            oracle!(
                $any,
                Stcf,
                |shift| StcfParams { dt_us: DT_US, support: $support, polarity_match: PolarityMatch::Any, shift },
                |memory, timed| stcf(memory, timed, $support, PolarityMatch::Any)
            );
            oracle!(
                $same,
                Stcf,
                |shift| StcfParams { dt_us: DT_US, support: $support, polarity_match: PolarityMatch::Same, shift },
                |memory, timed| stcf(memory, timed, $support, PolarityMatch::Same)
            );
        )*
    };
}

stcf! {
    stcf_1 stcf_1_alike 1;
    stcf_2 stcf_2_alike 2;
    stcf_5 stcf_5_alike 5;
}

macro_rules! bursts {
    ($($name:ident $filter:ident $params:expr, $or_equal:literal, $keeps:expr;)*) => {
        $(
            oracle!(
                $name,
                $filter,
                |shift| { let params = $params; params(shift) },
                |memory, timed| { let keeps: fn(usize) -> bool = $keeps; keeps(in_burst(memory, timed, $or_equal)) }
            );
        )*
    };
}

bursts! {
    trail Trail |shift| TrailParams { dt_us: DT_US, mode: TrailMode::Trail, shift }, false, |n| n == 0;
    stc_cut_trail Trail |shift| TrailParams { dt_us: DT_US, mode: TrailMode::StcCutTrail, shift }, false, |n| n == 1;
    stc_keep_trail Trail |shift| TrailParams { dt_us: DT_US, mode: TrailMode::StcKeepTrail, shift }, false, |n| n > 0;
    inceptive Inceptive
        |shift| InceptiveParams { dt_us: DT_US, keep: InceptiveKeep::Inceptive, shift }, true, |n| n == 0;
    confirming Inceptive
        |shift| InceptiveParams { dt_us: DT_US, keep: InceptiveKeep::Confirming, shift }, true, |n| n == 1;
    trailing Inceptive
        |shift| InceptiveParams { dt_us: DT_US, keep: InceptiveKeep::Trailing, shift }, true, |n| n > 0;
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn hot_pixels_agree(events in stream(1 << 29), seed: u64) {
        let mut mask = PixelMask::empty(SENSOR, [!0]).unwrap();
        assert!(HOT.iter().all(|(x, y)| mask.insert(*x, *y)));
        let expected: Vec<Timed> =
            events.iter().filter(|timed| !HOT.contains(&(timed.event.x(), timed.event.y()))).copied().collect();
        prop_assert_eq!(run(&mut HotPixelFilter::new(mask), &events, seed), expected);
    }

    #[test]
    fn polarity_and_region_agree(events in stream(1 << 29), seed: u64) {
        let params = PolarityParams { keep: Polarity::Off };
        let mut filter = PolarityFilter::new(SENSOR, params);
        let expected: Vec<Timed> = events.iter().filter(|timed| !timed.event.is_on()).copied().collect();
        prop_assert_eq!(run(&mut filter, &events, seed), expected);

        let params = RegionParams { x: 1, y: 2, width: 3, height: 2 };
        let mut filter = RegionOfInterest::try_new(SENSOR, params).unwrap();
        let inside = |e: Event| (1..4).contains(&e.x()) && (2..4).contains(&e.y());
        let expected: Vec<Timed> = events.iter().filter(|timed| inside(timed.event)).copied().collect();
        prop_assert_eq!(run(&mut filter, &events, seed), expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn double_window_agrees(
        events in stream(1 << 29),
        (window, distance_px, support) in (1..20u16, 1..8u16, 1..5u16),
        seed: u64,
    ) {
        let mut windows = [VecDeque::new(), VecDeque::new()];
        let oracle = |timed: &&Timed| {
            let at = [timed.event.x() as i32, timed.event.y() as i32];
            let near = |other: &&[i32; 2]| {
                (at[0] - other[0]).abs() + (at[1] - other[1]).abs() < distance_px as i32
            };
            let signal = windows.iter().flatten().filter(near).count() >= support as usize;
            let own = &mut windows[signal as usize];
            own.push_back(at);
            if own.len() > window as usize {
                own.pop_front();
            }
            signal
        };
        let expected: Vec<Timed> = events.iter().filter(oracle).copied().collect();
        let params = DoubleWindowParams { window, distance_px, support };
        let memory = vec![!0; DoubleWindow::<()>::required_len(window)];
        let mut filter = DoubleWindow::try_new(SENSOR, params, memory).unwrap();
        prop_assert_eq!(run(&mut filter, &events, seed), expected);
    }
}

/// Stream time in periods for the oracles of counters: what ended before an event, and whether the clock restarted.
struct Periods {
    length: u64,
    open: Option<u64>,
}

impl Periods {
    /// How many periods ended before time `t`; none where everything is to be forgotten.
    fn ended(&mut self, t: u64) -> Option<u64> {
        let index = t / self.length;
        let Some(open) = self.open else {
            self.open = Some(index);
            return None;
        };
        if t < open * self.length {
            if open * self.length - t > self.length {
                self.open = Some(index);
                return None;
            }
            return Some(0);
        }
        self.open = Some(index);
        Some(index - open)
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn leaky_hot_pixel_agrees(
        events in stream(1 << 29),
        (limit, leak, period_us) in (1..12u8, 1..5u8, prop::sample::select(vec![1u32, 100, 5_000, 1 << 20])),
        seed: u64,
    ) {
        let mut periods = Periods { length: period_us as u64, open: None };
        let mut counters: HashMap<(u16, u16), u64> = HashMap::new();
        let oracle = |timed: &&Timed| {
            match periods.ended(timed.t) {
                Some(n) => counters.values_mut().for_each(|c| *c = c.saturating_sub(n.saturating_mul(leak as u64))),
                None => counters.clear(),
            }
            let counter = counters.entry((timed.event.x(), timed.event.y())).or_default();
            *counter = (*counter + 1).min(255);
            *counter <= limit as u64
        };
        let expected: Vec<Timed> = events.iter().filter(oracle).copied().collect();
        let params = LeakyHotPixelParams { limit, leak, period_us };
        let memory = vec![0xA5; LeakyHotPixel::<()>::required_len(SENSOR)];
        let mut filter = LeakyHotPixel::try_new(SENSOR, params, memory).unwrap();
        prop_assert_eq!(run(&mut filter, &events, seed), expected);
    }

    #[test]
    fn rate_limit_agrees(
        events in stream(1 << 29),
        (budget, tile_shift) in (1..9u32, 0..3u8),
        period_us in prop::sample::select(vec![1u32, 100, 5_000, 1 << 20]),
        seed: u64,
    ) {
        let mut periods = Periods { length: period_us as u64, open: None };
        let (mut came, mut kept): (HashMap<(u16, u16), u32>, u32) = (HashMap::new(), 0);
        let mut quota = budget;
        let oracle = |timed: &&Timed| {
            let ended = periods.ended(timed.t);
            if ended != Some(0) {
                let fair = (0..=budget).rev().find(|q| came.values().map(|n| n.min(q)).sum::<u32>() <= budget);
                quota = if ended == Some(1) { fair.unwrap().max(1) } else { budget };
                (came, kept) = (HashMap::new(), 0);
            }
            let tile = (timed.event.x() >> tile_shift, timed.event.y() >> tile_shift);
            let n = came.entry(tile).or_default();
            *n += 1;
            let keep = *n <= quota && kept < budget;
            kept += keep as u32;
            keep
        };
        let expected: Vec<Timed> = events.iter().filter(oracle).copied().collect();
        let params = RateLimitParams { events: budget, period_us, tile_shift };
        let memory = vec![!0; RateLimit::<()>::required_len(SENSOR, tile_shift)];
        let mut filter = RateLimit::try_new(SENSOR, params, memory).unwrap();
        prop_assert_eq!(run(&mut filter, &events, seed), expected);
    }

    #[test]
    fn decimation_and_masks_agree(events in stream(1 << 29), n in 1..9u32, seed: u64) {
        let expected: Vec<Timed> = events.iter().step_by(n as usize).copied().collect();
        let mut filter = Decimate::try_new(SENSOR, DecimateParams { n }).unwrap();
        prop_assert_eq!(run(&mut filter, &events, seed), expected);

        for keep in [MaskKeep::Inside, MaskKeep::Outside] {
            let mut mask = PixelMask::empty(SENSOR, [!0]).unwrap();
            assert!(HOT.iter().all(|(x, y)| mask.insert(*x, *y)));
            let keeps = |timed: &&Timed| {
                HOT.contains(&(timed.event.x(), timed.event.y())) == (keep == MaskKeep::Inside)
            };
            let expected: Vec<Timed> = events.iter().filter(keeps).copied().collect();
            prop_assert_eq!(run(&mut MaskFilter::new(mask, keep), &events, seed), expected);
        }
    }
}

/// A tile as the rule tells it, in full numbers.
#[derive(Clone, Default)]
struct Lamp {
    level: u32,
    bright: bool,
    score: u32,
    rise: Option<u64>,
}

impl Lamp {
    /// Whether the tile flickers at this event.
    fn flickers(&mut self, timed: &Timed, params: AntiFlickerParams) -> bool {
        let (low, high) =
            ((params.frequency_hz - params.band_hz) as u64, (params.frequency_hz + params.band_hz) as u64);
        let t = timed.t;
        if timed.event.is_on() {
            self.level = (self.level + 1).min(params.burst as u32);
            if self.level == params.burst as u32 && !self.bright {
                let distance = self.rise.and_then(|rise| t.checked_sub(rise));
                let in_band = distance.is_some_and(|d| d * high >= 1_000_000 && d * low <= 1_000_000);
                self.score = if in_band { self.score + 1 } else { 0 };
                (self.bright, self.rise) = (true, Some(t));
            }
        } else {
            self.level = self.level.saturating_sub(1);
            self.bright &= self.level > 0;
        }
        let recent = self.rise.is_some_and(|rise| t.saturating_sub(rise) <= 2 * (1_000_000 / low));
        self.score >= params.cycles as u32 && recent
    }
}

/// Lamps on a few tiles, with jitter, dropped and false events, now and then a pause: each of (time step, pixel,
/// polarity) by a random number. Most tiles follow the lamp, which is what random events seldom do.
fn lamp_stream() -> impl Strategy<Value = Vec<Timed>> {
    let start = prop_oneof![Just(0u64), 0..1u64 << 40, ((1u64 << 30) - 30_000)..(1 << 30)];
    (start, 1_000..30_000u64, prop::collection::vec(any::<u32>(), 0..400)).prop_map(
        |(start, half, randoms)| {
            let mut phase = start;
            let event = |random: u32| {
                phase += match random % 200 {
                    0 => GAP_MAX_US as u64 / (1 + random as u64 % 1000),
                    1..12 => half * 3,
                    _ => half / 4,
                };
                let on = (phase / half).is_multiple_of(2) != random.is_multiple_of(37);
                let t = phase - phase.min((random >> 8) as u64 % 40);
                let (x, y) = (random >> 16 & 3, random >> 20 & 1);
                Timed::new(t, x as u16, y as u16, Polarity::from_bit(on as u16))
            };
            randoms.into_iter().map(event).collect()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn anti_flicker_agrees(
        events in lamp_stream(),
        (frequency_hz, reach, tile_shift) in (2..400u32, 1..100u32, 0..3u8),
        (burst, cycles, flickering) in (1..4u8, 1..4u8, any::<bool>()),
        seed: u64,
    ) {
        let keep = if flickering { FlickerKeep::Flickering } else { FlickerKeep::Steady };
        let band_hz = frequency_hz * reach / 101;
        let params = AntiFlickerParams { frequency_hz, band_hz, tile_shift, burst, cycles, keep };
        let mut lamps: HashMap<(u16, u16), Lamp> = HashMap::new();
        let oracle = |timed: &&Timed| {
            let tile = (timed.event.x() >> tile_shift, timed.event.y() >> tile_shift);
            lamps.entry(tile).or_default().flickers(timed, params) == flickering
        };
        let expected: Vec<Timed> = events.iter().filter(oracle).copied().collect();
        let memory = vec![!0; AntiFlicker::<()>::required_len(SENSOR, tile_shift)];
        let mut filter = AntiFlicker::try_new(SENSOR, params, memory).unwrap();
        prop_assert_eq!(run(&mut filter, &events, seed), expected);
    }
}

/// A lamp of 100 Hz on one tile and an edge that passes over another: the lamp is dropped from its fourth rise on, the
/// edge stays.
#[test]
fn a_lamp_is_dropped_and_an_edge_beside_it_stays() {
    let geometry = Geometry::new(16, 8);
    let memory = vec![0; AntiFlicker::<()>::required_len(geometry, 3)];
    let mut filter = AntiFlicker::try_new(geometry, AntiFlickerParams::default(), memory).unwrap();
    let (mut lamp, mut edge) = ([0; 10], 0);
    for half in 0..20u32 {
        for pixel in 0..64u16 {
            let polarity = Polarity::from_bit((half as u16 + 1) % 2);
            let t = half * 5_000 + pixel as u32 * 10;
            lamp[half as usize / 2] += filter.keep(Event::new(t, pixel % 8, pixel / 8, polarity)) as u32;
        }
        let passing = Event::new(half * 5_000 + 4_000, 8 + half as u16 % 8, 3, Polarity::On);
        edge += filter.keep(passing) as u32;
    }
    // In the fourth period the tile flickers once its level has risen to 16: 15 events pass.
    assert_eq!((lamp, edge), ([128, 128, 128, 15, 0, 0, 0, 0, 0, 0], 20));
}

#[test]
fn a_busy_tile_takes_nothing_from_the_others() {
    let geometry = Geometry::new(64, 64);
    let params = RateLimitParams { events: 100, period_us: 1000, tile_shift: 5 };
    let memory = vec![0; RateLimit::<()>::required_len(geometry, 5)];
    let mut filter = RateLimit::try_new(geometry, params, memory).unwrap();
    let mut kept = [0; 4];
    for t in 1000..2000u32 {
        let busy = filter.keep(Event::new(t - 1000, 1, 1, Polarity::On));
        assert_eq!(busy, t - 1000 < 100);
    }
    for t in 1000..2000u32 {
        // 1000 events of the first tile; 20 of each of the others.
        kept[0] += filter.keep(Event::new(t, 1, 1, Polarity::On)) as u32;
        for tile in 1..4u16 {
            if t % 50 == 0 {
                let event = Event::new(t, tile % 2 * 32, tile / 2 * 32, Polarity::On);
                kept[tile as usize] += filter.keep(event) as u32;
            }
        }
    }
    // Its own budget is as it was: the second period still knows of one busy tile only. The third shares.
    assert!(kept[0] <= 100 && kept.iter().sum::<u32>() == 100, "{kept:?}");
    let mut kept = [0; 4];
    for t in 2000..3000u32 {
        kept[0] += filter.keep(Event::new(t, 1, 1, Polarity::On)) as u32;
        for tile in 1..4u16 {
            if t % 50 == 0 {
                let event = Event::new(t, tile % 2 * 32, tile / 2 * 32, Polarity::On);
                kept[tile as usize] += filter.keep(event) as u32;
            }
        }
    }
    assert_eq!(kept, [40, 20, 20, 20]);
}

#[test]
fn parameters_out_of_range_are_refused() {
    let range = |name, value, min, max| Some(FilterError::OutOfRange { name, value, min, max });
    let leaky = |params| LeakyHotPixel::try_new(SENSOR, params, [0; 20]).err();
    let good = LeakyHotPixelParams::default();
    assert_eq!(leaky(LeakyHotPixelParams { limit: 255, ..good }), range("limit", 255, 1, 254));
    assert_eq!(leaky(LeakyHotPixelParams { leak: 0, ..good }), range("leak", 0, 1, 255));
    assert_eq!(leaky(LeakyHotPixelParams { period_us: 0, ..good }), range("period_us", 0, 1, 1 << 30));
    assert_eq!(
        LeakyHotPixel::try_new(SENSOR, good, [0; 19]).err(),
        Some(FilterError::MemoryTooShort { needed: 20, found: 19 })
    );
    let decimate = Decimate::try_new(SENSOR, DecimateParams { n: 0 }).err();
    assert_eq!(decimate, range("n", 0, 1, u32::MAX));
    let limit = |params| RateLimit::try_new(SENSOR, params, [0; 20]).err();
    let good = RateLimitParams { events: 1, period_us: 1, tile_shift: 0 };
    assert_eq!(limit(good), None);
    assert_eq!(limit(RateLimitParams { events: 0, ..good }), range("events", 0, 1, u32::MAX));
    assert_eq!(limit(RateLimitParams { tile_shift: 16, ..good }), range("tile_shift", 16, 0, 15));
    let flicker = |params| AntiFlicker::try_new(SENSOR, params, [0; 40]).err();
    let good = AntiFlickerParams::default();
    assert_eq!(flicker(good), None);
    assert_eq!(flicker(AntiFlickerParams { band_hz: 100, ..good }), range("band_hz", 100, 0, 99));
    assert_eq!(flicker(AntiFlickerParams { frequency_hz: 1, ..good }), range("frequency_hz", 1, 2, 50_000));
    assert_eq!(flicker(AntiFlickerParams { burst: 0, ..good }), range("burst", 0, 1, 255));
    assert_eq!(flicker(AntiFlickerParams { cycles: 0, ..good }), range("cycles", 0, 1, 255));
}

#[test]
fn a_double_window_refuses_parameters_that_keep_nothing_and_short_memory() {
    let good = DoubleWindowParams::default();
    let make = |params, len| DoubleWindow::try_new(SENSOR, params, vec![0; len]).err();
    let zero = |name| Some(FilterError::OutOfRange { name, value: 0, min: 1, max: 65535 });
    assert_eq!(make(DoubleWindowParams { window: 0, ..good }, 128), zero("window"));
    assert_eq!(make(DoubleWindowParams { distance_px: 0, ..good }, 128), zero("distance_px"));
    assert_eq!(make(DoubleWindowParams { support: 0, ..good }, 128), zero("support"));
    assert_eq!(make(good, 127), Some(FilterError::MemoryTooShort { needed: 128, found: 127 }));
    assert_eq!(make(good, 128), None);
}

#[test]
fn a_region_must_lie_on_the_sensor() {
    let at = |x, width| RegionOfInterest::try_new(SENSOR, RegionParams { x, y: 0, width, height: 4 });
    assert!(at(0, 5).is_ok() && at(4, 1).is_ok());
    assert!(at(1, 5).is_err() && at(u16::MAX, u16::MAX).is_err());
}

#[test]
fn a_map_refuses_what_it_cannot_tell_apart() {
    let make = |dt_us, shift| {
        let memory = [0u16; Refractory::<u16, ()>::required_len(SENSOR)];
        Refractory::<u16, _>::try_new(
            SENSOR,
            RefractoryParams { dt_us, refresh: Refresh::Kept, shift },
            memory,
        )
        .err()
    };
    use lobula_core::time_map::TimeMapError::*;
    assert_eq!(make((1 << 14) - 1, 0), None);
    assert_eq!(
        make(1 << 14, 0),
        Some(FilterError::TimeMap(DtTooLong { dt_us: 1 << 14, dt_us_max: (1 << 14) - 1 }))
    );
    assert_eq!(make((1 << 18) - 1, 4), None);
    assert_eq!(make(15, 4), Some(FilterError::TimeMap(DtBelowTick { dt_us: 15, tick_us: 16 })));
    assert_eq!(make(16, 19), Some(FilterError::TimeMap(ShiftTooLarge { shift: 19, shift_max: 18 })));
}

fn map<T: Clone + Default>(geometry: Geometry) -> Vec<T> {
    vec![T::default(); TimeMap::<T, ()>::required_len(geometry)]
}

chunk_invariance!(filter polarity, |geometry| PolarityFilter::new(geometry, PolarityParams { keep: Polarity::On }));
chunk_invariance!(filter region_of_interest, |geometry| {
    RegionOfInterest::try_new(geometry, RegionParams { x: 3, y: 1, width: 20, height: 2 }).unwrap()
});
chunk_invariance!(filter refractory, |geometry| {
    let params = RefractoryParams { dt_us: 30, refresh: Refresh::Kept, shift: 0 };
    Refractory::<u32, _>::try_new(geometry, params, map(geometry)).unwrap()
});
chunk_invariance!(filter background_activity, |geometry| {
    let params = BackgroundActivityParams { dt_us: 30, neighbours: Neighbours::Eight, shift: 0 };
    BackgroundActivity::<u32, _>::try_new(geometry, params, map(geometry)).unwrap()
});
chunk_invariance!(filter background_activity_u16, |geometry| {
    let params = BackgroundActivityParams { dt_us: 32, neighbours: Neighbours::Four, shift: 3 };
    BackgroundActivity::<u16, _>::try_new(geometry, params, map(geometry)).unwrap()
});
chunk_invariance!(filter hot_pixel, |geometry| {
    let words = vec![0x1111_0000u32; PixelMask::<()>::required_len(geometry)];
    HotPixelFilter::new(PixelMask::try_from_words(geometry, words).unwrap())
});
chunk_invariance!(filter denoise, |geometry| {
    let params = DenoiseParams { refractory_us: 10, support_us: 100, trail_us: 50, ..DenoiseParams::default() };
    Denoise::<u32, _>::try_new(geometry, params, vec![0; Denoise::<u32, ()>::required_len(geometry)]).unwrap()
});
chunk_invariance!(filter denoise_u16, |geometry| {
    let params = DenoiseParams { refractory_us: 0, support_us: 64, support: 1, shift: 3, ..DenoiseParams::default() };
    Denoise::<u16, _>::try_new(geometry, params, vec![0; Denoise::<u16, ()>::required_len(geometry)]).unwrap()
});

chunk_invariance!(filter double_window, |geometry| {
    let params = DoubleWindowParams { window: 7, distance_px: 3, support: 2 };
    DoubleWindow::try_new(geometry, params, [0; DoubleWindow::<()>::required_len(7)]).unwrap()
});

chunk_invariance!(filter stcf_u16, |geometry| {
    let params = StcfParams { dt_us: 64, support: 2, polarity_match: PolarityMatch::Same, shift: 3 };
    Stcf::<u16, _>::try_new(geometry, params, vec![0; Stcf::<u16, ()>::required_len(geometry)]).unwrap()
});
chunk_invariance!(filter mask, |geometry| {
    let words = vec![0x1111_0000u32; PixelMask::<()>::required_len(geometry)];
    MaskFilter::new(PixelMask::try_from_words(geometry, words).unwrap(), MaskKeep::Inside)
});
chunk_invariance!(filter leaky_hot_pixel, |geometry| {
    let params = LeakyHotPixelParams { limit: 1, leak: 1, period_us: 1000 };
    LeakyHotPixel::try_new(geometry, params, vec![0; geometry.pixels()]).unwrap()
});
chunk_invariance!(filter trail_u16, |geometry| {
    let params = TrailParams { dt_us: 64, mode: TrailMode::StcCutTrail, shift: 3 };
    Trail::<u16, _>::try_new(geometry, params, vec![0; Trail::<u16, ()>::required_len(geometry)]).unwrap()
});
chunk_invariance!(filter inceptive_u32, |geometry| {
    let params = InceptiveParams { dt_us: 50, keep: InceptiveKeep::Trailing, shift: 0 };
    let memory = vec![0; Inceptive::<u32, ()>::required_len(geometry)];
    Inceptive::<u32, _>::try_new(geometry, params, memory).unwrap()
});
chunk_invariance!(filter anti_flicker, |geometry| {
    let params = AntiFlickerParams { frequency_hz: 1000, band_hz: 990, burst: 1, cycles: 1, ..AntiFlickerParams::default() };
    let memory = vec![0; AntiFlicker::<()>::required_len(geometry, 3)];
    AntiFlicker::try_new(geometry, params, memory).unwrap()
});
chunk_invariance!(filter decimate, |geometry| Decimate::try_new(geometry, DecimateParams { n: 3 }).unwrap());
chunk_invariance!(filter rate_limit, |geometry| {
    let params = RateLimitParams { events: 3, period_us: 100, tile_shift: 2 };
    let memory = vec![0; RateLimit::<()>::required_len(geometry, 2)];
    RateLimit::try_new(geometry, params, memory).unwrap()
});

/// A tuple of filters, a chain of the same, and one after the other by hand.
#[cfg(all(feature = "alloc", feature = "serde"))]
mod chain {
    use super::*;
    use lobula_core::Transform;
    use lobula_core::chain::{Chain, Spec};

    /// A chain that is nothing but filters.
    struct Filters(Chain);

    impl Filter for Filters {
        fn keep(&mut self, _: Event) -> bool {
            unreachable!("blocks alone are given")
        }

        fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
            Ok(self.0.apply(block).unwrap())
        }
    }

    fn spec() -> Spec {
        serde_json::from_str(
            r#"[
                { "kind": "region_of_interest", "x": 0, "y": 0, "width": 4, "height": 4 },
                { "kind": "refractory", "dt_us": 1024, "refresh": "all" },
                { "kind": "background_activity", "dt_us": 1024, "shift": 4 }
            ]"#,
        )
        .unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn the_same_bits_as_a_tuple(events in stream(1 << 17), seeds: [u64; 2]) {
            let mut a = [0u32; Refractory::<u32, ()>::required_len(SENSOR)];
            let mut b = [0u16; BackgroundActivity::<u16, ()>::required_len(SENSOR)];
            let dt_us = DT_US;
            let mut tuple = (
                RegionOfInterest::try_new(SENSOR, RegionParams { x: 0, y: 0, width: 4, height: 4 }).unwrap(),
                Refractory::<u32, _>::try_new(SENSOR, RefractoryParams { dt_us, refresh: Refresh::All, shift: 0 }, &mut a[..]).unwrap(),
                BackgroundActivity::<u16, _>::try_new(
                    SENSOR,
                    BackgroundActivityParams { dt_us, neighbours: Neighbours::Eight, shift: 4 },
                    &mut b[..],
                ).unwrap(),
            );
            let mut chain = Filters(Chain::try_new(&spec(), SENSOR).unwrap());
            let kept = run(&mut chain, &events, seeds[0]);
            let chain = chain.0;
            prop_assert_eq!(&run(&mut tuple, &events, seeds[1]), &kept);
            prop_assert_eq!(chain.removed() as usize, events.len() - kept.len());
            prop_assert_eq!(chain.counts().map(|(_, n)| n).sum::<u64>(), chain.removed());
        }
    }
}
