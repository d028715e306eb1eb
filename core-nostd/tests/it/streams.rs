//! Streams of events to test stages with: random ones with everything a camera does and more, and one made by hand.

use lobula_core::{Block, Event, Geometry, Polarity, SPAN_MAX_US};
use proptest::prelude::*;

/// An event with its full time in µs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Timed {
    pub t: u64,
    pub event: Event,
}

impl Timed {
    pub fn new(t: u64, x: u16, y: u16, polarity: Polarity) -> Self {
        Self { t, event: Event::new(t as u32, x, y, polarity) }
    }
}

impl std::fmt::Debug for Timed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let e = self.event;
        write!(f, "t={} x={} y={} p={}", self.t, e.x(), e.y(), e.is_on() as u8)
    }
}

/// 100 hours in µs.
const GAP_MAX_US: u64 = 100 * 3600 * 1_000_000;
/// Latest start that encoders take.
pub const START_MAX_US: u64 = 1 << 40;

/// From one event to the next, in µs: mostly a burst, a small step back now and then, seldom hours of silence.
fn step() -> impl Strategy<Value = i64> {
    prop_oneof![
        30 => Just(0i64),
        30 => 1i64..40,
        10 => -20i64..0,
        10 => 40i64..20_000,
        3 => -5_000i64..0,
        4 => 20_000i64..10_000_000,
        1 => 0i64..(1 << 33),
        1 => 0i64..GAP_MAX_US as i64,
    ]
}

/// A start in µs: 0, anywhere up to 2^40, or just before a counter wraps.
fn start() -> impl Strategy<Value = u64> {
    prop_oneof![
        2 => Just(0u64),
        3 => 0u64..=START_MAX_US,
        3 => (prop::sample::select(vec![12u32, 24, 32, 34, 40]), 0u64..100).prop_map(|(bits, before)| (1 << bits) - before),
    ]
}

/// Pixels near each other, so that neighbourhoods and vectors fill; now and then one far away.
fn pixel(geometry: Geometry) -> impl Strategy<Value = (u16, u16)> {
    let Geometry { width, height } = geometry;
    prop_oneof![
        8 => (0..width.min(40), 0..height.min(4)),
        2 => (0..width, 0..height),
    ]
}

/// A stream of up to `len_max` events on a sensor of this size. Times step back now and then and never pass below 0.
pub fn stream(geometry: Geometry, len_max: usize) -> impl Strategy<Value = Vec<Timed>> {
    let one = (step(), pixel(geometry), any::<bool>());
    (start(), prop::collection::vec(one, 0..=len_max)).prop_map(|(start, steps)| {
        let mut t = start;
        let mut timed = |(step, (x, y), on): (i64, (u16, u16), bool)| {
            t = t.saturating_add_signed(step);
            Timed::new(t, x, y, Polarity::from_bit(on as u16))
        };
        steps.into_iter().map(&mut timed).collect()
    })
}

/// A stream whose time steps back: within a µs, over a TIME_HIGH of every format, to the very start, and twice at one
/// pixel. By hand, so that it is the same in every test.
pub fn stepping_back() -> Vec<Timed> {
    let times = [
        4090, 4095, 4097, 4093, 4095, 4100, 4200, 4099, 8192, 8191, 8192, 8190, 70_000, 69_999, 70_000,
        66_000, 90_000, 89_999, 89_999, 90_001, 1_000_000, 999_999, 1_000_063, 1_000_064, 1_000_063,
        1_000_128, 1_000_000, 2_000_000,
    ];
    let timed = |(i, t): (usize, &u64)| Timed::new(*t, 3 + i as u16 % 5, 2, Polarity::from_bit(i as u16 / 5));
    times.iter().enumerate().map(timed).collect()
}

/// How many of the first events fit one block: none lies [`SPAN_MAX_US`] or more from the first.
pub fn block_len(events: &[Timed]) -> usize {
    let Some(first) = events.first() else { return 0 };
    events.iter().take_while(|timed| timed.t.abs_diff(first.t) < SPAN_MAX_US).count()
}

/// The events of a block, which the caller made sure fit one.
pub fn block_events(events: &[Timed]) -> Vec<Event> {
    events.iter().map(|timed| timed.event).collect()
}

/// A block over `memory`, which holds the events of `events`, one at least.
pub fn block<'a>(events: &[Timed], memory: &'a mut [Event], geometry: Geometry) -> Block<'a> {
    let (first, last) = (events.first().unwrap(), events.last().unwrap());
    Block::new(first.t, last.t, geometry, memory)
}
