//! The law of every stage: however its input is split, its output is the same.
//!
//! To put a stage under it, add one line to the tests of its family, with a closure that makes a fresh stage:
//!
//! ```ignore
//! chunk_invariance!(decoder evt2, |geometry| evt2::Decoder::new(geometry), encoded by evt2::Encoder::new());
//! chunk_invariance!(encoder evt2, || evt2::Encoder::new());
//! chunk_invariance!(filter refractory, |geometry| Refractory::try_new(...).unwrap());
//! chunk_invariance!(transform flip, |geometry| FlipX::new(geometry));
//! chunk_invariance!(representation voxel, |geometry| Voxel::try_new(...).unwrap());
//! chunk_invariance!(detector fast, |geometry| Fast::try_new(...).unwrap());
//! ```
//!
//! A stage of no family (a slicer, a whole pipeline) gives a strategy of its inputs and a function that feeds an input
//! in the pieces that a [`Splits`] names, and returns all that can be seen of the result:
//!
//! ```ignore
//! chunk_invariance!(custom slicer, streams::stream(GEOMETRY, 300), |events, splits| run(events, splits));
//! ```
//!
//! Each line is a module of two tests: random inputs, each run whole, one element at a time and in random pieces; and
//! (but for `custom`) the hand-made stream whose time steps back.

use crate::streams::{self, Timed};
use lobula_core::{
    Counters, Decode, Detector, Encode, Event, Filter, Geometry, Refused, Representation, SPAN_MAX_US, Sink,
    Span, Transform, Trigger, Window,
};
use proptest::collection::vec;
use proptest::prelude::{Strategy, any};
use proptest::test_runner::{Config, TestRunner};

/// The sensor of the random streams. Not of a round size, and larger than the pixels that streams favour.
pub const GEOMETRY: Geometry = Geometry::new(123, 45);
/// The sensor of the streams that become tensors, each element of which is looked at in every window.
pub const TENSOR_GEOMETRY: Geometry = Geometry::new(67, 9);
/// Longest random stream, in events.
pub const LEN_MAX: usize = 200;

/// Says where to cut: the lengths of the pieces, one after the other.
#[derive(Clone, Debug)]
pub enum Splits {
    /// All in one piece.
    Whole,
    /// Pieces of one element.
    Ones,
    /// Pieces of random length by this state, one element about as often as many.
    Random(u64),
}

impl Splits {
    /// Length of the next piece, from 1 to `left` (0 when nothing is left).
    pub fn next(&mut self, left: usize) -> usize {
        match self {
            Self::Whole => left,
            Self::Ones => left.min(1),
            Self::Random(state) => {
                // xorshift64*: any sequence will do, as long as the test's seed repeats it.
                *state ^= *state >> 12;
                *state ^= *state << 25;
                *state ^= *state >> 27;
                let random = state.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32;
                let bound = [1, 3, 17, 100, 1000][random as usize % 5];
                left.min(1 + (random as usize >> 4) % bound)
            }
        }
    }

    /// The random pieces of a seed.
    pub fn random(seed: u64) -> Self {
        Self::Random(seed | 1)
    }
}

/// Runs `run` on the input whole and in pieces and asserts that nothing differs.
pub fn assert_invariant<I: ?Sized, O: PartialEq + std::fmt::Debug>(
    input: &I,
    seeds: &[u64],
    run: impl Fn(&I, &mut Splits) -> O,
) {
    let whole = run(input, &mut Splits::Whole);
    assert_eq!(run(input, &mut Splits::Ones), whole, "pieces of one");
    for seed in seeds {
        assert_eq!(run(input, &mut Splits::random(*seed)), whole, "pieces of seed {seed}");
    }
}

/// Checks random inputs, each with three random ways to split it. A property's inputs and its search for the smallest
/// failure are compiled once a type of input, not once a stage.
pub fn for_any<S: Strategy>(inputs: S, check: &dyn Fn(&S::Value, &[u64])) {
    let mut runner = TestRunner::new(Config { failure_persistence: None, ..Config::default() });
    let checked = runner.run(&(inputs, any::<[u64; 3]>()), |(input, seeds)| {
        check(&input, &seeds);
        Ok(())
    });
    if let Err(error) = checked {
        panic!("{error}");
    }
}

/// Checks random streams of a sensor.
pub fn for_any_stream(geometry: Geometry, check: &dyn Fn(&[Timed], &[u64])) {
    for_any(streams::stream(geometry, LEN_MAX), &|events: &Vec<Timed>, seeds| check(events, seeds));
}

/// Checks bytes of no meaning.
pub fn for_any_bytes(check: &dyn Fn(&[u8], &[u64])) {
    for_any(vec(any::<u8>(), 0..2000), &|bytes: &Vec<u8>, seeds| check(bytes, seeds));
}

/// Checks random streams as `encode` writes them, of a larger sensor, so that some events are off it, with bytes of it
/// changed.
pub fn for_any_damage(encode: &dyn Fn(&[Timed]) -> Vec<u8>, check: &dyn Fn(&[u8], &[u64])) {
    let changes = vec(any::<(u16, u8)>(), 0..20);
    for_any((streams::stream(Geometry::new(140, 50), LEN_MAX), changes), &|(events, changes), seeds| {
        let mut bytes = encode(events);
        // Hours of silence are thousands of words of some formats, told from the end.
        let mut bytes = bytes.split_off(bytes.len().saturating_sub(4000));
        let len = bytes.len().max(1);
        for (at, byte) in changes {
            if let Some(slot) = bytes.get_mut(usize::from(*at) % len) {
                *slot = *byte;
            }
        }
        check(&bytes, seeds);
    });
}

/// All that a decoder shows.
#[derive(Debug, PartialEq)]
pub struct Decoded {
    pub events: Vec<Timed>,
    pub triggers: Vec<Trigger>,
    pub counters: Counters,
    pub now: u64,
}

/// Decodes pieces of `bytes` into sinks of random room.
pub fn decode(mut decoder: impl Decode, bytes: &[u8], splits: &mut Splits) -> Decoded {
    let mut out = Decoded { events: vec![], triggers: vec![], counters: Counters::new(), now: 0 };
    let mut memory = [Event::default(); Sink::LEN_MIN + 200];
    let mut triggers = [Trigger::default(); 8];
    let mut rest = bytes;
    let mut taken = 0;
    while !rest.is_empty() {
        let (mut piece, after) = rest.split_at(splits.next(rest.len()));
        rest = after;
        while !piece.is_empty() {
            let room = Sink::LEN_MIN - 1 + splits.next(200);
            let triggers_room = splits.next(triggers.len());
            let mut sink = Sink::with_triggers(&mut memory[..room], &mut triggers[..triggers_room]);
            let n = decoder.decode(piece, &mut sink);
            assert!(n > 0, "an empty sink of {room} events made no progress");
            taken += n as u64;
            piece = &piece[n..];
            out.triggers.extend(sink.triggers());
            let block = sink.block(decoder.geometry());
            assert!(block.events_on_sensor());
            out.events.extend(
                block.span().events.iter().map(|event| Timed { t: block.span().time(*event), event: *event }),
            );
            assert_ledger(&decoder, taken, out.events.len() as u64);
        }
    }
    decoder.finish();
    assert_eq!(decoder.pending(), 0);
    assert_ledger(&decoder, taken, out.events.len() as u64);
    out.counters = *decoder.counters();
    out.now = decoder.now();
    out
}

/// Every byte and every event is in exactly one count, at any time.
fn assert_ledger(decoder: &impl Decode, bytes: u64, events: u64) {
    let counters = decoder.counters();
    assert_eq!(counters.bytes_decoded + counters.bytes_faulty + decoder.pending() as u64, bytes);
    assert_eq!(counters.events - counters.off_sensor, events);
}

trait OnSensor {
    fn events_on_sensor(&self) -> bool;
}

impl OnSensor for lobula_core::Block<'_> {
    fn events_on_sensor(&self) -> bool {
        self.span().events.iter().all(|event| self.geometry.contains(event.x(), event.y()))
    }
}

/// Encodes pieces of a stream into buffers of random length; what is refused is noted and left out.
pub fn encode(mut encoder: impl Encode, events: &[Timed], splits: &mut Splits) -> (Vec<u8>, Vec<Refused>) {
    let (mut bytes, mut refused) = (vec![], vec![]);
    let mut out = [0; 1000];
    let memory = streams::block_events(events);
    // A silence of hours is many words, each a call with room for one: what fits a block is looked up once an event.
    let (mut at, mut fitting) = (0, (usize::MAX, 0));
    while at < events.len() {
        if fitting.0 != at {
            fitting = (at, streams::block_len(&events[at..]));
        }
        let piece = at..at + splits.next(fitting.1);
        let span = Span {
            t_first: events[at].t,
            t_last: events[piece.end - 1].t,
            geometry: GEOMETRY,
            events: &memory[piece],
        };
        let out = &mut out[..splits.next(1000)];
        let done = encoder.encode(span, out);
        assert!(
            done.events + done.bytes > 0 || done.refused.is_some(),
            "room for {} and no progress",
            out.len()
        );
        bytes.extend(&out[..done.bytes]);
        at += done.events;
        if let Some(reason) = done.refused {
            refused.push(reason);
            at += 1;
        }
    }
    loop {
        let n = encoder.finish(&mut out[..splits.next(1000)]);
        if n == 0 {
            break (bytes, refused);
        }
        bytes.extend(&out[..n]);
    }
}

/// Encodes a stream in one go.
pub fn encode_whole(encoder: impl Encode, events: &[Timed]) -> Vec<u8> {
    encode(encoder, events, &mut Splits::Whole).0
}

/// Calls `with` with pieces of the stream, each fit to be a block.
fn for_each_piece(events: &[Timed], splits: &mut Splits, mut with: impl FnMut(&[Timed])) {
    let mut rest = events;
    while !rest.is_empty() {
        let (piece, after) = rest.split_at(splits.next(streams::block_len(rest)));
        with(piece);
        rest = after;
    }
}

/// Filters pieces of a stream; what is left of it.
pub fn filter(mut filter: impl Filter, events: &[Timed], splits: &mut Splits) -> Vec<Timed> {
    let mut out = vec![];
    for_each_piece(events, splits, |piece| {
        let mut memory = streams::block_events(piece);
        let mut block = streams::block(piece, &mut memory, GEOMETRY);
        let left = filter.retain(&mut block).unwrap();
        assert_eq!(left, block.len());
        out.extend(
            block.span().events.iter().map(|event| Timed { t: block.span().time(*event), event: *event }),
        );
    });
    out
}

/// Transforms pieces of a stream, each of a reach that the stage takes; what becomes of it.
pub fn transform(mut transform: impl Transform, events: &[Timed], splits: &mut Splits) -> Vec<Timed> {
    let mut out = vec![];
    let reach_max = transform.reach_max(SPAN_MAX_US - 1);
    for_each_piece(events, splits, |piece| {
        let mut rest = piece;
        while !rest.is_empty() {
            let mut memory = streams::block_events(rest);
            let fitting = streams::block(rest, &mut memory, GEOMETRY).span().fitting(reach_max);
            let (piece, after) = rest.split_at(fitting);
            let mut block = streams::block(piece, &mut memory[..fitting], GEOMETRY);
            let left = transform.apply(&mut block).unwrap();
            assert_eq!(left, block.len());
            assert_eq!(block.geometry, transform.output_geometry());
            assert!(block.events_on_sensor());
            out.extend(
                block.span().events.iter().map(|event| Timed { t: block.span().time(*event), event: *event }),
            );
            rest = after;
        }
    });
    out
}

/// Period in µs of the windows that representations are tested with; windows of a silent stretch are left out.
const PERIOD_US: u64 = 10_000;

/// Windows on a grid, each with the events from the first of it to the first at or after its end.
fn windows(events: &[Timed]) -> Vec<(Window, &[Timed])> {
    let mut windows = vec![];
    let mut rest = events;
    while let Some(first) = rest.first() {
        let t0 = first.t / PERIOD_US * PERIOD_US;
        let window = Window { t0, t1: t0 + PERIOD_US };
        let len = rest.iter().take_while(|timed| timed.t < window.t1).count();
        let (inside, after) = rest.split_at(len);
        windows.push((window, inside));
        rest = after;
    }
    windows
}

/// Builds the tensor of each window from pieces of its events; the tensors' bytes, so that equal means the same bits.
pub fn represent<R: Representation>(mut stage: R, events: &[Timed], splits: &mut Splits) -> Vec<Vec<u8>> {
    let tensor = |(window, inside): (Window, &[Timed])| {
        // Whatever was in the memory before, begin and finish write every element.
        let garbage = splits.next(256) as u8;
        let len = stage.shape().len() * size_of::<R::Pixel>();
        let mut memory = vec![<R::Pixel as bytemuck::Zeroable>::zeroed(); stage.shape().len()];
        bytemuck::cast_slice_mut::<R::Pixel, u8>(&mut memory).copy_from_slice(&vec![garbage; len]);
        stage.begin(window, &mut memory);
        for_each_piece(inside, splits, |piece| {
            let mut events = streams::block_events(piece);
            let block = streams::block(piece, &mut events, TENSOR_GEOMETRY);
            stage.accumulate(block.span(), &mut memory).unwrap();
        });
        stage.finish(&mut memory);
        bytemuck::cast_slice(&memory).to_vec()
    };
    windows(events).into_iter().map(tensor).collect()
}

/// Detects in pieces of a stream, into buffers of random length.
pub fn detect<D: Detector>(mut stage: D, events: &[Timed], splits: &mut Splits) -> Vec<String>
where
    D::Feature: Default + std::fmt::Debug,
{
    let mut found = vec![];
    let mut out = [D::Feature::default(); 64];
    for_each_piece(events, &mut splits.clone(), |piece| {
        let mut rest = piece;
        while !rest.is_empty() {
            let mut memory = streams::block_events(rest);
            let block = streams::block(rest, &mut memory, GEOMETRY);
            let out = &mut out[..splits.next(64)];
            let (taken, features) = stage.detect(block.span(), out).unwrap();
            assert!(taken > 0, "room for {} features and no progress", out.len());
            found.extend(out[..features].iter().map(|feature| format!("{feature:?}")));
            rest = &rest[taken..];
        }
    });
    found
}

/// Puts a stage under the law; see the module.
macro_rules! chunk_invariance {
    (custom $name:ident, $inputs:expr, $run:expr) => {
        mod $name {
            #[allow(unused_imports)]
            use super::*;

            #[test]
            fn any_split_gives_the_same() {
                $crate::chunk_invariance::for_any($inputs, &|input, seeds| {
                    $crate::chunk_invariance::assert_invariant(input, seeds, $run);
                });
            }
        }
    };
    (events $name:ident, $run:expr) => {
        chunk_invariance!(events $name, $crate::chunk_invariance::GEOMETRY, $run);
    };
    (events $name:ident, $geometry:expr, $run:expr) => {
        mod $name {
            #[allow(unused_imports)]
            use super::*;
            #[allow(unused_imports)]
            use $crate::chunk_invariance::GEOMETRY;
            use $crate::chunk_invariance::{Splits, assert_invariant, for_any_stream};
            use $crate::streams::{self, Timed};

            fn check(events: &[Timed], seeds: &[u64]) {
                assert_invariant(events, seeds, |events: &[Timed], splits: &mut Splits| $run(events, splits));
            }

            #[test]
            fn any_split_gives_the_same() {
                for_any_stream($geometry, &check);
            }

            #[test]
            fn steps_back_are_the_same_in_any_split() {
                let seeds: [u64; 32] = std::array::from_fn(|i| i as u64);
                check(&streams::stepping_back(), &seeds);
            }
        }
    };
    (decoder $name:ident, $new:expr, encoded by $encoder:expr) => {
        mod $name {
            #[allow(unused_imports)]
            use super::*;
            use $crate::chunk_invariance::{assert_invariant, decode, encode_whole, for_any_bytes, for_any_damage};
            use $crate::streams;

            fn check(bytes: &[u8], seeds: &[u64]) {
                let new = $new;
                assert_invariant(bytes, seeds, |bytes, splits| decode(new($crate::chunk_invariance::GEOMETRY), bytes, splits));
            }

            #[test]
            fn any_split_gives_the_same() {
                for_any_damage(&|events| encode_whole($encoder, events), &check);
            }

            #[test]
            fn any_split_of_noise_gives_the_same() {
                for_any_bytes(&check);
            }

            #[test]
            fn steps_back_are_the_same_in_any_split() {
                let seeds: [u64; 32] = std::array::from_fn(|i| i as u64);
                check(&encode_whole($encoder, &streams::stepping_back()), &seeds);
            }
        }
    };
    (encoder $name:ident, $new:expr) => {
        chunk_invariance!(events $name, |events, splits| {
            let new = $new;
            $crate::chunk_invariance::encode(new(), events, splits)
        });
    };
    (filter $name:ident, $new:expr) => {
        chunk_invariance!(events $name, |events, splits| {
            let new = $new;
            $crate::chunk_invariance::filter(new(GEOMETRY), events, splits)
        });
    };
    (transform $name:ident, $new:expr) => {
        chunk_invariance!(events $name, |events, splits| {
            let new = $new;
            $crate::chunk_invariance::transform(new(GEOMETRY), events, splits)
        });
    };
    (representation $name:ident, $new:expr) => {
        chunk_invariance!(events $name, $crate::chunk_invariance::TENSOR_GEOMETRY, |events, splits| {
            let new = $new;
            $crate::chunk_invariance::represent(new($crate::chunk_invariance::TENSOR_GEOMETRY), events, splits)
        });
    };
    (detector $name:ident, $new:expr) => {
        chunk_invariance!(events $name, |events, splits| {
            let new = $new;
            $crate::chunk_invariance::detect(new(GEOMETRY), events, splits)
        });
    };
}

/// The law bites: a stage that counts its pieces breaks it.
#[test]
#[should_panic(expected = "pieces of one")]
fn a_stage_that_minds_the_split_is_found() {
    let pieces = |events: &[Timed], splits: &mut Splits| {
        let mut n = 0;
        for_each_piece(events, splits, |_| n += 1);
        n
    };
    assert_invariant(&streams::stepping_back()[..], &[], pieces);
}

/// A stage that does nothing, so that every family of the macro is used and stands.
struct Still;

impl Filter for Still {
    fn keep(&mut self, _: Event) -> bool {
        true
    }

    fn retain(&mut self, block: &mut lobula_core::Block<'_>) -> Result<usize, lobula_core::WrongGeometry> {
        Ok(block.len())
    }
}

impl Transform for Still {
    fn output_geometry(&self) -> Geometry {
        GEOMETRY
    }

    fn apply(&mut self, block: &mut lobula_core::Block<'_>) -> Result<usize, lobula_core::Unfit> {
        Ok(block.len())
    }
}

impl Detector for Still {
    type Feature = u64;

    fn detect(
        &mut self,
        span: Span<'_>,
        out: &mut [u64],
    ) -> Result<(usize, usize), lobula_core::WrongGeometry> {
        let n = span.events.len().min(out.len());
        for (feature, event) in out.iter_mut().zip(span.events) {
            *feature = span.time(*event);
        }
        Ok((n, n))
    }
}

impl Representation for Still {
    type Pixel = u8;

    fn shape(&self) -> lobula_core::Shape {
        lobula_core::Shape { channels: 1, height: 9, width: 67 }
    }

    fn begin(&mut self, _: Window, out: &mut [u8]) {
        out.fill(0);
    }

    fn accumulate(&mut self, span: Span<'_>, out: &mut [u8]) -> Result<(), lobula_core::WrongGeometry> {
        for event in span.events {
            out[TENSOR_GEOMETRY.index(event.x(), event.y())] += 1;
        }
        Ok(())
    }

    fn finish(&mut self, _: &mut [u8]) {}
}

chunk_invariance!(filter still_filter, |_| Still);
chunk_invariance!(transform still_transform, |_| Still);
chunk_invariance!(representation still_representation, |_| Still);
chunk_invariance!(detector still_detector, |_| Still);
chunk_invariance!(custom still_custom, streams::stream(GEOMETRY, LEN_MAX), |events: &Vec<Timed>, splits: &mut Splits| {
    filter(Still, events, splits)
});
