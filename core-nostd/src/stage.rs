//! The five traits of a pipeline, over blocks, since packets and not single events are the unit.
//!
//! The law for every implementer is chunk invariance: any split of the input gives the same output.

use crate::representation::Overlap;
use crate::{Block, Counters, Event, Geometry, Sink, Span, Trigger, WrongGeometry};
use bytemuck::{Pod, Zeroable};

/// Bytes of a camera in, events out. Infallible, resumable at any byte.
///
/// For implementers: stop only between words, and only when the sink has less room than one word can need, refuses
/// the event's time, or has no room for a trigger. Count malformed words and skip them. Emit nothing before the stream
/// has told its time (and row).
pub trait Decode {
    /// Decodes into `sink` and returns how many bytes were taken; fewer than given means: empty the sink, call again.
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> usize;

    /// The stream has ended: the bytes of a word cut short become a fault.
    fn finish(&mut self);

    /// Bytes were lost here. Forgets what may be stale and emits nothing until time and row are known again.
    /// `near` is the stream time expected now, if known: it settles how often a counter wrapped meanwhile.
    fn gap(&mut self, near: Option<u64>);

    /// Stream time in µs, also when there are no events.
    fn now(&self) -> u64;

    /// The sensor's size; events off it are counted and dropped.
    fn geometry(&self) -> Geometry;

    /// Bytes of a word that is not complete yet.
    fn pending(&self) -> usize;

    /// What was done so far.
    fn counters(&self) -> &Counters;
}

/// Why an encoder refuses an event: the format cannot hold it. Nothing is ever wrapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The first event lies beyond 2^40 µs, as epoch times do: rebase the recording first.
    StartTooLate {
        /// Its time in µs.
        t: u64,
    },
    /// A step back in time that the format would read as a wrap.
    StepBack {
        /// Time before, in µs.
        from: u64,
        /// Time after, in µs.
        to: u64,
    },
    /// A coordinate beyond what the format's bits hold.
    OffFormat {
        /// Column.
        x: u16,
        /// Row.
        y: u16,
    },
    /// A trigger input beyond what the format's bits hold.
    NoChannel {
        /// Its number.
        channel: u8,
    },
}

impl core::fmt::Display for Refused {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::StartTooLate { t } => {
                write!(f, "starts at {t} µs, beyond the 2^40 µs the format can tell: write it with --rebase")
            }
            Self::StepBack { from, to } => {
                write!(
                    f,
                    "time steps back from {from} to {to} µs, which the format would read as a wrap: sort first"
                )
            }
            Self::OffFormat { x, y } => {
                write!(f, "pixel ({x}, {y}) is beyond the format's 2048x2048: crop first")
            }
            Self::NoChannel { channel } => {
                write!(f, "trigger input {channel} is beyond the format's: leave it out")
            }
        }
    }
}

impl core::error::Error for Refused {}

/// What one call of an encoder did. What was done before a refusal is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// Events taken.
    pub events: usize,
    /// Bytes written.
    pub bytes: usize,
    /// Why the event after those taken can never be.
    pub refused: Option<Refused>,
}

/// Events in, bytes of a camera's format out: the inverse of [`Decode`].
///
/// Output is bounded by the caller's buffer and resumable at any byte, since one event may need many words (a silent
/// gap of hours). Any split of input and output gives the same bytes.
pub trait Encode {
    /// Encodes `span` into `out`; call again with the events not taken. Zero progress with room left means refusal.
    fn encode(&mut self, span: Span<'_>, out: &mut [u8]) -> Encoded;

    /// Encodes an edge of a trigger input after the events taken so far; its ordinal is not looked at. `events` is 1
    /// once it is taken: until then, call again with it.
    fn trigger(&mut self, trigger: Trigger, out: &mut [u8]) -> Encoded;

    /// Writes what is held back (a vector still open); returns the bytes written, 0 when all is out.
    fn finish(&mut self, out: &mut [u8]) -> usize;
}

/// Thins a block.
///
/// For implementers: the answer for an event depends on the events before it only.
pub trait Filter {
    /// Tells the stream time before events are given, so that 32-bit maps know of long silence. `retain` does it;
    /// call it yourself only where you drive `keep` by hand.
    fn advance(&mut self, now: u64) {
        let _ = now;
    }

    /// Whether to keep the event.
    fn keep(&mut self, event: Event) -> bool;

    /// Keeps what [`keep`](Self::keep) keeps, in place and in order; returns how many are left.
    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry>;
}

/// Moves events: to other pixels, times or polarities.
///
/// For implementers: what becomes of an event depends on it and the events before it only. What has no place on the
/// sensor after it, or lies before time 0, is dropped, never wrapped: `block.len()` before less what is returned tells
/// how many. An event off the sensor, which no decoder gives, is dropped or stays off the sensor
/// (where rows beyond the last can be told at all: of 32768 there are none).
pub trait Transform {
    /// The sensor's size after it.
    fn output_geometry(&self) -> Geometry;

    /// Longest reach (see [`Span::reach`]) of a block that it takes, so that the block reaches at most `after` when it
    /// is done. Other than `after` only where it moves events in time.
    fn reach_max(&self, after: u64) -> u64 {
        after
    }

    /// Where a time of the stream, in µs, is after it, for what comes beside events; `None` where nothing is any more.
    fn time(&self, t: u64) -> Option<u64> {
        Some(t)
    }

    /// Changes a block in place, its geometry and its times included; returns how many events are left. A block that
    /// it does not take is not touched.
    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit>;
}

/// Why a transform does not take a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unfit {
    /// It is of another sensor.
    Geometry(WrongGeometry),
    /// Its times would lie too far apart afterwards for one block. No event is lost: give it in shorter blocks,
    /// [`Span::fitting`] says where to cut.
    Reach {
        /// Longest reach taken, in µs.
        reach_max: u64,
    },
}

impl From<WrongGeometry> for Unfit {
    fn from(wrong: WrongGeometry) -> Self {
        Self::Geometry(wrong)
    }
}

impl core::fmt::Display for Unfit {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Geometry(wrong) => wrong.fmt(f),
            Self::Reach { reach_max } => {
                write!(f, "block spans too long to be moved in time: give blocks of at most {reach_max} µs")
            }
        }
    }
}

impl core::error::Error for Unfit {}

/// A half-open stretch of stream time, `[t0, t1)` in µs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Start, inclusive.
    pub t0: u64,
    /// End, exclusive; the reference of decays and bins.
    pub t1: u64,
}

/// Extent of a tensor, outermost first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Planes: bins, polarities.
    pub channels: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

impl Shape {
    /// Number of elements.
    pub const fn len(self) -> usize {
        self.channels * self.height * self.width
    }

    /// Whether it has no element.
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

/// Builds a dense tensor from the events of a window, in the caller's memory (such as a shared-memory sample on loan).
///
/// For implementers: `begin` and `finish` between them write every element of `out`, whatever was there. An event
/// before the window's start counts at its start. `out` of another length than `shape().len()` is left alone where it
/// ends and never a panic.
pub trait Representation {
    /// Element of the tensor.
    type Pixel: Pod;

    /// Extent of the tensor, row-major.
    fn shape(&self) -> Shape;

    /// A window opens. What is given is for [sparse](Self::is_sparse) tensors and zeroes `out`.
    fn begin(&mut self, window: Window, out: &mut [Self::Pixel]) {
        self.begin_blank(window);
        out.fill(Self::Pixel::zeroed());
    }

    /// Events of the open window, in stream order.
    fn accumulate(&mut self, span: Span<'_>, out: &mut [Self::Pixel]) -> Result<(), WrongGeometry>;

    /// The window closes: `out` is complete.
    fn finish(&mut self, out: &mut [Self::Pixel]);

    /// Whether its tensors are zero but where events fell: all that [`begin`](Self::begin) does to `out` is to zero it,
    /// [`accumulate`](Self::accumulate) changes elements of the events' pixels only, in any plane, and
    /// [`finish`](Self::finish) changes none. Such a tensor can be erased where it was drawn, see
    /// [`Eraser`](crate::representation::Eraser).
    fn is_sparse(&self) -> bool {
        false
    }

    /// Of a sparse one: a window opens in memory that is zero already.
    fn begin_blank(&mut self, window: Window) {
        let _ = window;
    }

    /// How the tensors of windows that overlap are built, see [`Sliding`](crate::representation::Sliding). An
    /// [`Overlap::Sum`] depends neither on the window nor on the events' order; `finish` of it or of an [`Overlap::OwnSum`]
    /// changes nothing but `out`.
    fn overlap(&self) -> Overlap {
        Overlap::Anew
    }

    /// Of a sum: adds events to what is kept from window to window, which begins as a tensor does and is as long. That is the
    /// tensor itself, unless it does not tell what is left when an event leaves.
    fn add(&mut self, span: Span<'_>, sum: &mut [Self::Pixel]) -> Result<(), WrongGeometry> {
        self.accumulate(span, sum)
    }

    /// Of a sum: draws the tensor.
    fn show(&mut self, sum: &[Self::Pixel], out: &mut [Self::Pixel]) {
        out.iter_mut().zip(sum).for_each(|(out, sum)| *out = *sum);
        self.finish(out);
    }

    /// Of a sum: takes away events that were [added](Self::add). Returns whether it is then the sum of the others; if not,
    /// because an element had more events than it can count, it has to be drawn anew.
    fn take_away(&mut self, span: Span<'_>, sum: &mut [Self::Pixel]) -> Result<bool, WrongGeometry> {
        let _ = (span, sum);
        Ok(false)
    }

    /// Of a sparse one: the planes that these events of the open window change, or more. Plane `n` is bit `n % 16`.
    fn planes(&self, events: &[Event]) -> u16 {
        let _ = events;
        u16::MAX
    }
}

/// Finds features: corners, clusters, flow.
pub trait Detector {
    /// One feature.
    type Feature: Copy;

    /// Looks at a block and puts features into `out`; returns how many events were taken (fewer than there are when
    /// `out` is full) and how many features written.
    fn detect(&mut self, span: Span<'_>, out: &mut [Self::Feature]) -> Result<(usize, usize), WrongGeometry>;
}
