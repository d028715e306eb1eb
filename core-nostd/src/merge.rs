//! Several streams as one, in order of time.

use crate::{Geometry, Sink, Span, WrongGeometry, full_time};

/// What is at hand of one of the streams: the events not merged yet, and what is known of those to come.
#[derive(Clone, Copy, Debug)]
pub struct MergeInput<'a> {
    /// Events to merge; those merged are taken from its start.
    pub span: Span<'a>,
    /// No event to come is older, in µs: the stream's time, as [`Decode::now`](crate::Decode::now) tells. `u64::MAX` once it
    /// has ended.
    pub now: u64,
}

impl<'a> MergeInput<'a> {
    /// Events of a stream of which nothing else is known: those to come are as new as the last of these at least.
    pub fn new(span: Span<'a>) -> Self {
        let now = span.events.last().map_or(span.t_last, |event| span.time(*event));
        Self { span, now }
    }

    /// The last events of a stream.
    pub const fn last(span: Span<'a>) -> Self {
        Self { span, now: u64::MAX }
    }

    fn next(&self) -> Option<u64> {
        self.span.events.first().map(|event| self.span.time(*event))
    }
}

/// Merges sorted streams by time; events of one time come in the order of the streams, each stream's in its own.
///
/// It keeps nothing: memory is that of the inputs' events not merged yet, which is what the caller holds. Delay: an event
/// comes out once each of the other streams has shown a later event, or time, so that it waits for the stream that is the
/// furthest behind and for no other. However streams are cut, what comes out is the same.
///
/// A stream that steps back in time is no sorted one: its event then comes out at once, late.
///
/// ```
/// use lobula_core::{Event, Geometry, Polarity, Sink, Span};
/// use lobula_core::merge::{Merge, MergeInput};
/// let geometry = Geometry::new(4, 1);
/// let of = |x| move |t| Event::new(t, x, 0, Polarity::On);
/// let (left, right) = ([10, 30, 50].map(of(0)), [20, 30].map(of(1)));
/// let span = |events| Span { t_first: 0, t_last: 50, geometry, events };
/// let mut memory = [Event::default(); 64];
/// let mut sink = Sink::new(&mut memory);
/// let mut inputs = [MergeInput::new(span(&left[..])), MergeInput::new(span(&right[..]))];
/// Merge::new(geometry).merge(&mut inputs, &mut sink)?;
/// let merged: Vec<_> = sink.block(geometry).span().events.iter().map(|event| (event.t(), event.x())).collect();
/// assert_eq!(merged, [(10, 0), (20, 1), (30, 0), (30, 1)]); // 50 may still be preceded on the right
/// assert_eq!(inputs[0].span.events.len(), 1);
/// # Ok::<(), lobula_core::WrongGeometry>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Merge {
    geometry: Geometry,
}

impl Merge {
    /// For streams of sensors that fit into this one.
    pub const fn new(geometry: Geometry) -> Self {
        Self { geometry }
    }

    /// The smallest sensor into which all fit.
    pub fn fitting(sensors: impl IntoIterator<Item = Geometry>) -> Self {
        let larger = |a: Geometry, b: Geometry| Geometry::new(a.width.max(b.width), a.height.max(b.height));
        Self::new(sensors.into_iter().fold(Geometry::new(0, 0), larger))
    }

    /// The sensor of what comes out.
    pub const fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// Moves events from the inputs into `sink` until it refuses one (empty it and call again), or until more must be
    /// known of an input that has none left; returns how many.
    pub fn merge(&self, inputs: &mut [MergeInput<'_>], sink: &mut Sink<'_>) -> Result<usize, WrongGeometry> {
        for input in inputs.iter() {
            let found = input.span.geometry;
            if found.width > self.geometry.width || found.height > self.geometry.height {
                return Err(WrongGeometry { expected: self.geometry, found });
            }
        }
        let before = sink.len();
        while let Some((first, end)) = run(inputs) {
            let Some(input) = inputs.get_mut(first) else { break };
            let taken = take(input, end, sink);
            let blocked = input.next().is_some_and(|next| next < end);
            if blocked || taken == 0 {
                break;
            }
        }
        Ok(sink.len() - before)
    }
}

/// Which input is to give events, and until which time, exclusive; `None` where that is not known.
fn run(inputs: &[MergeInput<'_>]) -> Option<(usize, u64)> {
    let (mut best, mut t_best) = (None, u64::MAX);
    for (i, input) in inputs.iter().enumerate() {
        if let Some(t) = input.next()
            && (best.is_none() || t < t_best)
        {
            (best, t_best) = (Some(i), t);
        }
    }
    let best = best?;
    let mut end = u64::MAX;
    for (i, input) in inputs.iter().enumerate().filter(|(i, _)| *i != best) {
        // Of one time, streams before the best go first and those after it later.
        let bound = input.next().unwrap_or(input.now).saturating_add(u64::from(i > best));
        end = end.min(bound);
    }
    (t_best < end || (end == u64::MAX && t_best == end)).then_some((best, end))
}

/// Moves the events of before `end`; returns how many.
fn take(input: &mut MergeInput<'_>, end: u64, sink: &mut Sink<'_>) -> usize {
    let mut taken = 0;
    let anchor = input.span.t_first;
    for event in input.span.events {
        let t = full_time(anchor, event.t());
        if t >= end || !sink.push(t, *event) {
            break;
        }
        taken += 1;
    }
    input.span.events = input.span.events.get(taken..).unwrap_or_default();
    taken
}
