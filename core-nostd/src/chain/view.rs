//! A view: tensors of a stream at a fixed period, from settings, into bytes that someone else owns.
//!
//! The daemon drives it over shared-memory samples, the offline reader over memory of its own: the same code, so the
//! same bytes.

use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use super::cut::{Cut, Part};
use crate::representation::{
    BadRepresentation, Build, Dtype, Eraser, KeptSlice, Kind, Overlap, Parameters, Pixel, Sliding,
    for_each_parameter,
};
use crate::sliding_slicer::Strides;
use crate::{
    BadGrid, BadPeriod, Closed, CountSlicer, Event, Geometry, Grid, Piece, Representation, Shape, Slicer,
    Slide, SlidingSlicer, Span, Window, WrongGeometry, for_each_representation,
};

/// Where ages are counted from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// The end of the window.
    #[default]
    WindowEnd,
    /// The newest event of the slice: its events are kept until then ([`KeptSlice`]).
    LastEvent,
}

macro_rules! view_spec {
    ($($(#[$doc:meta])* $key:ident: $type:ty = $default:expr, $($kind:ident)*;)*) => {
        /// Settings of a view. Keys that are unknown or mean nothing to the kind are errors.
        ///
        /// ```
        /// use lobula_core::Geometry;
        /// use lobula_core::chain::{View, ViewSpec};
        /// let spec: ViewSpec = serde_json::from_str(r#"{"name": "vox", "kind": "voxel_grid", "period_us": 10000}"#)?;
        /// let view = View::try_new(&spec, Geometry::new(1280, 720))?;
        /// assert_eq!(view.len_bytes(), 5 * 720 * 1280 * 4);
        /// # Ok::<(), Box<dyn std::error::Error>>(())
        /// ```
        #[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct ViewSpec {
            /// Name under which it is published.
            pub name: String,
            /// What kind of tensor.
            pub kind: Kind,
            /// Length of its windows in µs, 1 to 2^30 - 1; they begin at multiples of it, or of `stride_us`. None (0) with
            /// `slice_events`.
            #[serde(default, skip_serializing_if = "is_zero")]
            pub period_us: u32,
            /// From the start of one window to that of the next, in µs: a whole part of `period_us`, 1/1024 of it at
            /// least. Shorter than it, windows overlap ([`SlidingSlicer`]). Default `period_us`.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub stride_us: Option<u32>,
            /// Number of events of its windows, in place of `period_us`: 1 to 2^28. The reference is the last event.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub slice_events: Option<u32>,
            /// From the first event of one window to that of the next: a whole part of `slice_events`, 1/1024 of it at
            /// least. Fewer than it, windows overlap. Default `slice_events`.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub stride_events: Option<u32>,
            /// Where ages are counted from: `"window_end"` (default) or `"last_event"`.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub reference: Option<Reference>,
            /// With the last event as reference: how far back the window reaches in µs, 1 to 2^30; older events are
            /// dropped and counted. Default: to the oldest event.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub window_us: Option<u32>,
            /// With windows that overlap, or the last event as reference: how many events of a window are kept, 1 to 2^28;
            /// those beyond are dropped and counted. Default 2^20, with `slice_events` as many.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub events_max: Option<u32>,
            /// Type of element; default u8 for counts, f32 else.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub dtype: Option<Dtype>,
            $($(#[$doc])* #[serde(default, skip_serializing_if = "Option::is_none")] pub $key: Option<$type>,)*
        }

        impl ViewSpec {
            /// A view with the defaults of its kind.
            pub fn new(name: impl Into<String>, kind: Kind, period_us: u32) -> Self {
                Self {
                    name: name.into(),
                    kind,
                    period_us,
                    stride_us: None,
                    slice_events: None,
                    stride_events: None,
                    reference: None,
                    window_us: None,
                    events_max: None,
                    dtype: None,
                    $($key: None,)*
                }
            }

            fn parameters(&self) -> Result<Parameters, BadView> {
                let (kind, mut parameters) = (self.kind, Parameters::default());
                $(if let Some(value) = self.$key {
                    if ![$(Kind::$kind),*].contains(&kind) {
                        return Err(BadView::NotForKind { key: stringify!($key), kind });
                    }
                    parameters.$key = value;
                })*
                Ok(parameters)
            }
        }
    };
}

for_each_parameter!(view_spec);

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
fn is_zero(number: &u32) -> bool {
    *number == 0
}

impl ViewSpec {
    /// The most events that are kept of a slice: 2 GiB of them.
    const EVENTS_MAX: u32 = 1 << 28;
    /// How many are kept unless told otherwise: 8 MiB of them.
    const EVENTS_DEFAULT: u32 = 1 << 20;

    fn cut(&self, geometry: Geometry) -> Result<Cut, BadView> {
        self.check_slices()?;
        if let Some(grid) = self.overlapping() {
            let strides = zeroed(grid.strides().map_err(BadView::Grid)?)?;
            let sliding = SlidingSlicer::try_new(grid, geometry, strides, zeroed(self.events_max()?)?);
            return sliding.map(Cut::Sliding).map_err(BadView::Grid);
        }
        let strides = match self.slice_events {
            None => Slicer::try_new(self.period_us).map(Strides::Time).map_err(BadView::Period),
            Some(events) => {
                let slicer = CountSlicer::try_new(events).map(Strides::Events);
                slicer.ok_or(events_range("slice_events", events))
            }
        };
        strides.map(Cut::Apart)
    }

    /// Refuses settings of windows of time beside those of windows of events, and the other way around.
    fn check_slices(&self) -> Result<(), BadView> {
        if self.slice_events.is_none() {
            let (key, without) = ("stride_events", "slice_events");
            return if self.stride_events.is_none() {
                Ok(())
            } else {
                Err(BadView::NotWithout { key, without })
            };
        }
        let meaningless = [
            ("period_us", self.period_us != 0),
            ("stride_us", self.stride_us.is_some()),
            ("reference", self.reference == Some(Reference::WindowEnd)),
        ];
        match meaningless.into_iter().find(|(_, given)| *given) {
            Some((key, _)) => Err(BadView::NotWith { key, with: "slice_events" }),
            None => Ok(()),
        }
    }

    /// The grid of its windows, if they overlap.
    fn overlapping(&self) -> Option<Grid> {
        let Self { period_us, stride_us, slice_events, stride_events, .. } = *self;
        match slice_events {
            None => {
                stride_us.filter(|us| *us != period_us).map(|stride_us| Grid::Time { period_us, stride_us })
            }
            Some(slice_events) => stride_events
                .filter(|events| *events != slice_events)
                .map(|stride_events| Grid::Events { slice_events, stride_events }),
        }
    }

    /// How many events of a window are kept, where they are.
    fn events_max(&self) -> Result<usize, BadView> {
        let (key, events) = match (self.events_max, self.slice_events) {
            (Some(events), _) => ("events_max", events),
            (None, Some(events)) => ("slice_events", events),
            (None, None) => ("events_max", Self::EVENTS_DEFAULT),
        };
        if !(1..=Self::EVENTS_MAX).contains(&events) {
            return Err(events_range(key, events));
        }
        Ok(events as usize)
    }

    /// What its slices are kept in, if they are. Windows of events that overlap are kept by their slicer, and end at the
    /// newest event already.
    fn kept(&self) -> Result<Option<KeptSlice<Box<[Event]>>>, BadView> {
        let overlap = self.overlapping().is_some();
        let keeps = match self.slice_events {
            None => self.reference == Some(Reference::LastEvent),
            Some(_) => !overlap || self.window_us.is_some(),
        };
        if keeps {
            let memory = zeroed(self.events_max()?)?;
            return KeptSlice::try_new(self.window_us, memory).map(Some).map_err(BadView::Representation);
        }
        let without = "a reference of last_event";
        match (self.window_us, self.events_max) {
            (Some(_), _) => Err(BadView::NotWithout { key: "window_us", without }),
            (_, Some(_)) if !overlap => {
                let without = "windows that overlap or a reference of last_event";
                Err(BadView::NotWithout { key: "events_max", without })
            }
            _ => Ok(None),
        }
    }
}

fn events_range(key: &'static str, found: u32) -> BadView {
    let (found, range) = (found.into(), "1 to 2^28 events");
    BadView::Representation(BadRepresentation::Parameter { key, found, range })
}

/// Why settings make no view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadView {
    /// The period.
    Period(BadPeriod),
    /// The period and the stride.
    Grid(BadGrid),
    /// A parameter of the representation.
    Representation(BadRepresentation),
    /// There is no memory for its state.
    OutOfMemory {
        /// Bytes it needs.
        bytes: usize,
    },
    /// The kind has no tensors of this type.
    Dtype {
        /// The kind.
        kind: Kind,
        /// The type asked for.
        dtype: Dtype,
    },
    /// Two settings that exclude each other.
    NotWith {
        /// The one to remove.
        key: &'static str,
        /// Beside which it means nothing.
        with: &'static str,
    },
    /// A setting that needs another.
    NotWithout {
        /// The one to remove.
        key: &'static str,
        /// What it needs.
        without: &'static str,
    },
    /// A parameter that means nothing to the kind.
    NotForKind {
        /// The parameter's name in settings.
        key: &'static str,
        /// The kind.
        kind: Kind,
    },
}

impl core::fmt::Display for BadView {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Period(error) => error.fmt(f),
            Self::Grid(error) => error.fmt(f),
            Self::Representation(error) => error.fmt(f),
            Self::OutOfMemory { bytes } => write!(f, "no memory for its state of {bytes} bytes"),
            Self::Dtype { kind, dtype } => {
                write!(f, "a {} view has no elements of type {}: give one of", kind.name(), dtype.name())?;
                dtypes(*kind, |dtype| write!(f, " {}", dtype.name()))
            }
            Self::NotWith { key, with } => write!(f, "{key} means nothing beside {with}: remove it"),
            Self::NotWithout { key, without } => {
                write!(f, "{key} means nothing without {without}: remove it")
            }
            Self::NotForKind { key, kind } => {
                write!(f, "{key} means nothing to a {} view: remove it", kind.name())
            }
        }
    }
}

impl core::error::Error for BadView {}

/// Why a block was not drawn, or not whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PushError {
    /// The block is of another sensor; nothing was done.
    Geometry(WrongGeometry),
    /// The [`Canvas`] lent memory of a wrong length or alignment: those windows are lost, the view goes on.
    Memory {
        /// Bytes needed.
        expected: usize,
        /// Bytes lent.
        found: usize,
    },
}

impl core::fmt::Display for PushError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Geometry(error) => error.fmt(f),
            Self::Memory { expected, found } => {
                write!(
                    f,
                    "a tensor of {expected} bytes was lent {found} or misaligned ones: lend 64-byte aligned memory"
                )
            }
        }
    }
}

impl core::error::Error for PushError {}

impl From<WrongGeometry> for PushError {
    fn from(error: WrongGeometry) -> Self {
        Self::Geometry(error)
    }
}

/// Where a view draws: lends memory for each window and takes the complete tensor.
pub trait Canvas {
    /// A window opens: make memory ready, such as a sample on loan.
    fn begin(&mut self, window: Window);

    /// The memory of the open window: [`View::len_bytes`] bytes, aligned for the element, with any content. The same
    /// until `end`. None leaves this window out; a surface takes note of its events all the same.
    fn memory(&mut self) -> Option<&mut [u8]>;

    /// The window closes: the memory holds its tensor. Send it.
    fn end(&mut self, closed: Closed);

    /// Whether it lends the same memory for every window and lets nobody else write to it. A view then erases what it
    /// drew before and no more, which is quicker where few events fall into a window; the tensors are the same.
    fn keeps(&self) -> bool {
        false
    }
}

type State = Box<[u32]>;

/// Memory for so many elements: the state of a representation, the events of a slice, a tensor.
fn zeroed<T: Default + Clone>(len: usize) -> Result<Box<[T]>, BadView> {
    let mut memory = Vec::new();
    memory
        .try_reserve_exact(len)
        .map_err(|_| BadView::OutOfMemory { bytes: len.saturating_mul(size_of::<T>()) })?;
    memory.resize(len, T::default());
    Ok(memory.into_boxed_slice())
}

/// Tensors of a stream at a fixed period.
#[derive(Debug)]
pub struct View {
    cut: Cut,
    geometry: Geometry,
    representation: AnyRepresentation,
    kept: Option<KeptSlice<Box<[Event]>>>,
    /// Where windows overlap and each is the sum of the one before and more.
    sum: Option<Sum>,
    /// What was drawn where; made for the first canvas that keeps its memory.
    eraser: Option<Eraser<Box<[u32]>>>,
}

/// A tensor that goes on from window to window.
#[derive(Debug)]
struct Sum {
    sliding: Sliding,
    lines: Box<[Line]>,
}

impl View {
    /// Makes the view that the settings describe, for a sensor of this size.
    pub fn try_new(spec: &ViewSpec, geometry: Geometry) -> Result<Self, BadView> {
        let cut = spec.cut(geometry)?;
        let dtype = spec.dtype.unwrap_or(spec.kind.dtype());
        let representation = AnyRepresentation::try_new(spec.kind, dtype, &spec.parameters()?, geometry)?;
        let kept = spec.kept()?;
        let is_sum = kept.is_none() && matches!(cut, Cut::Sliding(_));
        let sum = if is_sum { representation.sum()? } else { None };
        Ok(Self { cut, geometry, representation, kept, sum, eraser: None })
    }

    /// Extent of its tensors.
    pub fn shape(&self) -> Shape {
        self.representation.shape()
    }

    /// Type of its tensors' elements.
    pub fn dtype(&self) -> Dtype {
        self.representation.dtype()
    }

    /// Bytes of a tensor.
    pub fn len_bytes(&self) -> usize {
        self.shape().len() * self.dtype().bytes()
    }

    /// The sensor's size.
    pub const fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// Events that came after their window had closed, since the start.
    pub fn late(&self) -> u64 {
        self.cut.late()
    }

    /// Empty windows left out, since the start.
    pub fn skipped(&self) -> u64 {
        self.cut.skipped()
    }

    /// Events dropped since they were older than `window_us` before their slice's last event, since the start.
    pub fn older(&self) -> u64 {
        self.kept.as_ref().map_or(0, KeptSlice::older)
    }

    /// Events dropped since their slice or window had more than `events_max`, since the start.
    pub fn overflowed(&self) -> u64 {
        self.cut.overflowed() + self.kept.as_ref().map_or(0, KeptSlice::overflowed)
    }

    /// Events that a pixel could not count any more, since the start; where windows overlap, each time it was drawn.
    pub fn saturated(&self) -> u64 {
        self.representation.saturated()
    }

    /// Draws the events of a block.
    pub fn push(&mut self, span: Span<'_>, canvas: &mut impl Canvas) -> Result<(), PushError> {
        if span.geometry != self.geometry {
            let (expected, found) = (self.geometry, span.geometry);
            return Err(PushError::Geometry(WrongGeometry { expected, found }));
        }
        let (cut, mut pen) = Pen::new(self, canvas);
        cut.push(span, |part| pen.draw(part));
        pen.done
    }

    /// Stream time has come to `now` µs, also without events: see [`Slicer::advance`].
    pub fn advance(&mut self, now: u64, canvas: &mut impl Canvas) -> Result<(), PushError> {
        let (cut, mut pen) = Pen::new(self, canvas);
        cut.advance(now, |part| pen.draw(part));
        pen.done
    }

    /// The stream has ended at `now` µs: see [`Slicer::finish`].
    pub fn finish(&mut self, now: u64, canvas: &mut impl Canvas) -> Result<(), PushError> {
        let (cut, mut pen) = Pen::new(self, canvas);
        cut.finish(now, |part| pen.draw(part));
        pen.done
    }
}

/// Draws pieces onto a canvas and remembers if that could not be.
struct Pen<'a, C> {
    representation: &'a mut AnyRepresentation,
    kept: &'a mut Option<KeptSlice<Box<[Event]>>>,
    sum: &'a mut Option<Sum>,
    eraser: Option<&'a mut Eraser<Box<[u32]>>>,
    geometry: Geometry,
    canvas: &'a mut C,
    done: Result<(), PushError>,
}

impl<'a, C: Canvas> Pen<'a, C> {
    fn new(view: &'a mut View, canvas: &'a mut C) -> (&'a mut Cut, Self) {
        let View { cut, geometry, representation, kept, sum, eraser } = view;
        if !canvas.keeps() {
            *eraser = None;
        } else if eraser.is_none() && sum.is_none() && representation.is_sparse() {
            // Without memory for it, tensors are zeroed whole.
            let shape = representation.shape();
            let log = zeroed(Eraser::<Box<[u32]>>::state_len(shape));
            *eraser = log.ok().map(|log| Eraser::new(shape, log));
        }
        let (eraser, geometry) = (eraser.as_mut(), *geometry);
        (cut, Self { representation, kept, sum, eraser, geometry, canvas, done: Ok(()) })
    }

    fn draw(&mut self, part: Part<'_, '_>) {
        match (part, &mut *self.sum) {
            (Part::Piece(piece), _) => self.draw_piece(piece),
            (Part::Slide(slide), Some(_)) => self.draw_sum(slide),
            (Part::Slide(slide), None) => {
                slide.pieces(self.representation.overlap(), |piece| self.draw_piece(piece));
            }
        }
    }

    /// A window that is the sum of the one before and more.
    fn draw_sum(&mut self, slide: &Slide<'_>) {
        let Some(sum) = self.sum else { return };
        self.canvas.begin(slide.closed.window);
        let drawn = self.representation.slide(slide, sum, self.canvas.memory().unwrap_or_default());
        self.done = self.done.and(drawn);
        self.canvas.end(slide.closed);
    }

    fn draw_piece(&mut self, piece: Piece<'_>) {
        if let Piece::Begin(window) = piece {
            self.canvas.begin(window);
        }
        let memory = self.canvas.memory().unwrap_or_default();
        let mut hand = Hand { representation: self.representation, eraser: self.eraser.as_deref_mut() };
        let drawn = match self.kept.as_mut() {
            None => hand.draw(piece, memory),
            Some(kept) => draw_kept(&mut hand, kept, self.geometry, piece, memory),
        };
        let piece = drawn.unwrap_or_else(|error| {
            self.done = Err(error);
            piece
        });
        if let Piece::End(closed) = piece {
            self.canvas.end(closed);
        }
    }
}

/// A representation with what it needs to draw.
struct Hand<'a> {
    representation: &'a mut AnyRepresentation,
    eraser: Option<&'a mut Eraser<Box<[u32]>>>,
}

impl Hand<'_> {
    fn draw<'a>(&mut self, piece: Piece<'a>, memory: &mut [u8]) -> Result<Piece<'a>, PushError> {
        self.representation.draw(piece, memory, self.eraser.as_deref_mut())
    }
}

/// One piece of a slice that is kept until it ends, and drawn then. Its window is then known.
fn draw_kept<'a>(
    hand: &mut Hand<'_>,
    kept: &mut KeptSlice<Box<[Event]>>,
    geometry: Geometry,
    piece: Piece<'a>,
    memory: &mut [u8],
) -> Result<Piece<'a>, PushError> {
    match piece {
        Piece::Begin(_) => kept.begin(),
        Piece::Events(span) => kept.push(span),
        Piece::End(closed) => {
            let (window, span) = kept.end(closed.window, geometry);
            let closed = Closed { window, ..closed };
            // All of it, also where the memory is of no use: a surface takes note of the events.
            let begun = hand.draw(Piece::Begin(window), memory);
            let drawn = hand.draw(Piece::Events(span), memory);
            return begun.and(drawn).and(hand.draw(Piece::End(closed), memory));
        }
    }
    Ok(piece)
}

/// The elements of a tensor that are lent, and whether they are of use. Without usable memory a representation draws into
/// an empty tensor, which costs nothing and keeps its state.
fn lent<'a, R: Representation>(
    stage: &R,
    memory: &'a mut [u8],
) -> (&'a mut [R::Pixel], Result<(), PushError>) {
    let (expected, found) = (stage.shape().len() * size_of::<R::Pixel>(), memory.len());
    let pixels = if found == expected { bytemuck::try_cast_slice_mut(memory).ok() } else { None };
    let usable = pixels.is_some() || found == 0;
    let lent = if usable { Ok(()) } else { Err(PushError::Memory { expected, found }) };
    (pixels.unwrap_or_default(), lent)
}

/// One piece into memory that may be none.
fn draw<'a, R: Representation>(
    representation: &mut R,
    piece: Piece<'a>,
    memory: &mut [u8],
    eraser: Option<&mut Eraser<Box<[u32]>>>,
) -> Result<Piece<'a>, PushError> {
    let (out, lent) = lent(representation, memory);
    match (piece, eraser) {
        (Piece::Begin(window), Some(eraser)) => eraser.begin(representation, window, out),
        (Piece::Begin(window), None) => representation.begin(window, out),
        (Piece::Events(span), Some(eraser)) => eraser.accumulate(representation, span, out)?,
        (Piece::Events(span), None) => representation.accumulate(span, out)?,
        (Piece::End(_), _) => representation.finish(out),
    }
    lent.map(|()| piece)
}

/// A window that overlaps the one before it, into memory that may be none.
fn slide<R: Representation>(
    representation: &mut R,
    slide: &Slide<'_>,
    sum: &mut Sum,
    memory: &mut [u8],
) -> Result<(), PushError> {
    let (out, lent) = lent(representation, memory);
    let elements: &mut [R::Pixel] = bytemuck::cast_slice_mut(&mut sum.lines);
    let elements = elements.get_mut(..Sliding::sum_len(representation)).unwrap_or_default();
    sum.sliding.draw(representation, slide, elements, out)?;
    lent
}

/// The memory of a sum, where there is one.
fn sum<R: Representation>(representation: &R) -> Result<Option<Sum>, BadView> {
    if !matches!(representation.overlap(), Overlap::Sum | Overlap::OwnSum) {
        return Ok(None);
    }
    let bytes = Sliding::sum_len(representation) * size_of::<R::Pixel>();
    let lines = zeroed(bytes.div_ceil(size_of::<Line>()))?;
    Ok(Some(Sum { sliding: Sliding::new(), lines }))
}

macro_rules! any_representation {
    ($($variant:ident $kind:ident $type:ty;)*) => {
        /// Any of the representations, chosen at run time.
        #[derive(Debug)]
        enum AnyRepresentation {
            $($variant($type),)*
        }

        impl AnyRepresentation {
            fn try_new(
                kind: Kind,
                dtype: Dtype,
                parameters: &Parameters,
                geometry: Geometry,
            ) -> Result<Self, BadView> {
                $(
                    if kind == Kind::$kind && dtype == <$type as Representation>::Pixel::DTYPE {
                        let state: State = zeroed(<$type as Build<State>>::state_len(parameters, geometry))?;
                        return <$type>::build(parameters, geometry, state)
                            .map(Self::$variant)
                            .map_err(BadView::Representation);
                    }
                )*
                Err(BadView::Dtype { kind, dtype })
            }

            fn shape(&self) -> Shape {
                match self {
                    $(Self::$variant(representation) => representation.shape(),)*
                }
            }

            fn dtype(&self) -> Dtype {
                match self {
                    $(Self::$variant(_) => <$type as Representation>::Pixel::DTYPE,)*
                }
            }

            fn saturated(&self) -> u64 {
                match self {
                    $(Self::$variant(representation) => Build::<State>::saturated(representation),)*
                }
            }

            fn is_sparse(&self) -> bool {
                match self {
                    $(Self::$variant(representation) => representation.is_sparse(),)*
                }
            }

            fn overlap(&self) -> Overlap {
                match self {
                    $(Self::$variant(representation) => representation.overlap(),)*
                }
            }

            fn sum(&self) -> Result<Option<Sum>, BadView> {
                match self {
                    $(Self::$variant(representation) => sum(representation),)*
                }
            }

            fn slide(&mut self, window: &Slide<'_>, sum: &mut Sum, memory: &mut [u8]) -> Result<(), PushError> {
                match self {
                    $(Self::$variant(representation) => slide(representation, window, sum, memory),)*
                }
            }

            fn draw<'a>(
                &mut self,
                piece: Piece<'a>,
                memory: &mut [u8],
                eraser: Option<&mut Eraser<Box<[u32]>>>,
            ) -> Result<Piece<'a>, PushError> {
                match self {
                    $(Self::$variant(representation) => draw(representation, piece, memory, eraser),)*
                }
            }
        }

        /// Calls `each` with every type of element that a kind has.
        fn dtypes(
            kind: Kind,
            mut each: impl FnMut(Dtype) -> core::fmt::Result,
        ) -> core::fmt::Result {
            $(
                if kind == Kind::$kind {
                    each(<$type as Representation>::Pixel::DTYPE)?;
                }
            )*
            Ok(())
        }
    };
}

for_each_representation!(any_representation, State);

/// 64 bytes at a multiple of 64: tensors are made of them, so that any element is aligned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Line(pub [u8; 64]);

impl Default for Line {
    fn default() -> Self {
        Self::zeroed()
    }
}

/// A canvas of its own memory, which it reuses: calls a function with each complete tensor.
///
/// ```
/// use lobula_core::chain::{Offline, View, ViewSpec};
/// use lobula_core::representation::Kind;
/// use lobula_core::{Event, Geometry, Polarity, Span};
/// let geometry = Geometry::new(2, 1);
/// let events = [Event::new(30, 1, 0, Polarity::On), Event::new(130, 0, 0, Polarity::Off)];
/// let span = Span { t_first: 30, t_last: 130, geometry, events: &events };
/// let mut view = View::try_new(&ViewSpec::new("count", Kind::Count, 100), geometry)?;
/// let mut tensors = Vec::new();
/// let mut canvas = Offline::new(view.len_bytes(), |closed, bytes| tensors.push((closed.window.t0, bytes.to_vec())));
/// view.push(span, &mut canvas)?;
/// view.finish(130, &mut canvas)?;
/// assert_eq!(tensors, [(0, vec![0, 1]), (100, vec![1, 0])]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Offline<F> {
    lines: Box<[Line]>,
    len_bytes: usize,
    each: F,
}

impl<F: FnMut(Closed, &[u8])> Offline<F> {
    /// For tensors of `len_bytes` ([`View::len_bytes`]).
    pub fn new(len_bytes: usize, each: F) -> Self {
        let lines = vec![Line::zeroed(); len_bytes.div_ceil(size_of::<Line>())];
        Self { lines: lines.into_boxed_slice(), len_bytes, each }
    }
}

impl<F: FnMut(Closed, &[u8])> Canvas for Offline<F> {
    fn begin(&mut self, _: Window) {}

    fn memory(&mut self) -> Option<&mut [u8]> {
        bytemuck::cast_slice_mut(&mut self.lines).get_mut(..self.len_bytes)
    }

    fn end(&mut self, closed: Closed) {
        let bytes = bytemuck::cast_slice(&self.lines).get(..self.len_bytes).unwrap_or_default();
        (self.each)(closed, bytes);
    }

    fn keeps(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Event, Polarity};
    use alloc::string::ToString;

    const GEOMETRY: Geometry = Geometry::new(5, 3);

    fn spec(json: &str) -> Result<ViewSpec, serde_json::Error> {
        serde_json::from_str(json)
    }

    fn view(json: &str) -> Result<View, BadView> {
        View::try_new(&spec(json).unwrap(), GEOMETRY)
    }

    /// Thousands of events over 100 ms, with steps back.
    fn events() -> Vec<Event> {
        (0..5_000u32)
            .map(|i| {
                let t = (i * 20).saturating_sub(if i % 97 == 0 { 300 } else { 0 });
                Event::new(t, (i * 7 % 5) as u16, (i % 3) as u16, Polarity::from_bit((i / 11) as u16))
            })
            .collect()
    }

    fn span(geometry: Geometry, events: &[Event]) -> Span<'_> {
        let (t_first, t_last) = (events[0].t().into(), events[events.len() - 1].t().into());
        Span { t_first, t_last, geometry, events }
    }

    /// What a view gives for events in blocks of `len`, up to 100 ms.
    fn drawn(view: &mut View, events: &[Event], len: usize) -> Vec<(Closed, Vec<u8>)> {
        let mut out = Vec::new();
        let mut canvas =
            Offline::new(view.len_bytes(), |closed, bytes: &[u8]| out.push((closed, bytes.to_vec())));
        for events in events.chunks(len) {
            view.push(span(GEOMETRY, events), &mut canvas).unwrap();
        }
        view.finish(100_000, &mut canvas).unwrap();
        out
    }

    /// What one with these settings gives for [`events`].
    fn tensors(spec: &ViewSpec, len: usize) -> Vec<(Closed, Vec<u8>)> {
        drawn(&mut View::try_new(spec, GEOMETRY).unwrap(), &events(), len)
    }

    #[test]
    fn every_kind_and_type_gives_the_same_bytes_in_any_split() {
        for kind in Kind::ALL.iter().copied() {
            dtypes(kind, |dtype| {
                let spec = ViewSpec { dtype: Some(dtype), ..ViewSpec::new("v", kind, 7_000) };
                let whole = tensors(&spec, 5_000);
                assert_eq!(whole.len(), 15, "{kind:?} {dtype:?}");
                assert_eq!(whole.iter().map(|(closed, _)| closed.events).sum::<u64>(), 5_000);
                assert!(whole.iter().any(|(_, bytes)| bytes.iter().any(|byte| *byte != 0)));
                for len in [1, 63, 1_000] {
                    assert_eq!(tensors(&spec, len), whole, "{kind:?} {dtype:?} blocks of {len}");
                }
                Ok(())
            })
            .unwrap();
        }
    }

    #[test]
    fn every_way_to_cut_and_to_count_ages_gives_the_same_bytes_in_any_split() {
        let last =
            ViewSpec { reference: Some(Reference::LastEvent), ..ViewSpec::new("v", Kind::Tencode, 7_000) };
        let short = ViewSpec { window_us: Some(500), events_max: Some(100), ..last.clone() };
        let counted = ViewSpec { slice_events: Some(333), ..ViewSpec::new("v", Kind::VoxelGrid, 0) };
        let sliding = ViewSpec { stride_events: Some(111), ..counted.clone() };
        let reaching = ViewSpec { window_us: Some(500), ..sliding.clone() };
        // Each event in three windows, but for those of the first two strides and of the last two, of 111 and of 5.
        let thrice = 3 * 5_000 - (2 + 1) * 111 - (111 + 2 * 5);
        for (spec, windows, events) in [
            (last, 15, 5_000),
            (short, 15, 5_000),
            (counted, 16, 5_000),
            (sliding, 44, thrice),
            (reaching, 44, thrice),
        ] {
            let whole = tensors(&spec, 5_000);
            assert_eq!(whole.len(), windows);
            assert_eq!(whole.iter().map(|(closed, _)| closed.events).sum::<u64>(), events);
            for len in [1, 63, 1_000] {
                assert_eq!(tensors(&spec, len), whole, "{spec:?} blocks of {len}");
            }
        }
    }

    /// Every 1 ms of 7 ms, every 50 events of 350. Each seventh is a window of those that do not overlap, to the bit, but
    /// for surfaces that remember late events from windows before.
    #[test]
    fn windows_that_overlap_give_the_same_bytes_in_any_split() {
        for kind in Kind::ALL.iter().copied() {
            let apart = ViewSpec::new("v", kind, 7_000);
            let spec = ViewSpec { stride_us: Some(1_000), ..apart.clone() };
            let same = ViewSpec { stride_us: Some(7_000), ..apart.clone() };
            let last = ViewSpec { reference: Some(Reference::LastEvent), ..spec.clone() };
            assert!(tensors(&last, 63) == tensors(&last, 5_000), "{kind:?}");
            let counted = ViewSpec { slice_events: Some(350), ..ViewSpec::new("v", kind, 0) };
            let every_50 = ViewSpec { stride_events: Some(50), ..counted.clone() };
            let every_350 = ViewSpec { stride_events: Some(350), ..counted.clone() };
            let remembers =
                View::try_new(&spec, GEOMETRY).unwrap().representation.overlap() == Overlap::Memory;
            for (spec, same, apart, windows, exact) in
                [(spec, same, apart, 95, !remembers), (every_50, every_350, counted, 94, true)]
            {
                let (whole, apart) = (tensors(&spec, 5_000), tensors(&apart, 5_000));
                assert_eq!(whole.len(), windows);
                assert!(tensors(&spec, 63) == whole && tensors(&same, 63) == apart, "{kind:?}");
                for ((closed, tensor), (of, expected)) in whole.iter().step_by(7).zip(apart) {
                    assert_eq!((closed.window, closed.events), (of.window, of.events));
                    assert!(!exact || *tensor == expected, "{kind:?} {closed:?}");
                }
            }
        }
    }

    /// Each window counts what its strides do, but for what there was no room to keep.
    #[test]
    fn windows_that_overlap_count_what_their_strides_do() {
        let stride = ViewSpec { dtype: Some(Dtype::U16), ..ViewSpec::new("v", Kind::Count, 1_000) };
        let spec = ViewSpec { stride_us: Some(1_000), period_us: 5_000, ..stride.clone() };
        let total = |tensor: &[u8]| {
            let counts = tensor.as_chunks().0.iter().map(|count| u64::from(u16::from_ne_bytes(*count)));
            counts.sum::<u64>()
        };
        let strides: Vec<u64> = tensors(&stride, 5_000).iter().map(|(closed, _)| closed.events).collect();
        let windows = tensors(&spec, 63);
        assert_eq!(windows.len() + 4, strides.len());
        for ((closed, tensor), strides) in windows.iter().zip(strides.windows(5)) {
            assert_eq!((closed.events, total(tensor)), (strides.iter().sum(), strides.iter().sum()));
        }
        let few = ViewSpec { events_max: Some(120), ..spec };
        let mut view = View::try_new(&few, GEOMETRY).unwrap();
        let kept = drawn(&mut view, &events(), 5_000).iter().map(|(_, tensor)| total(tensor)).max();
        assert_eq!(kept, Some(120));
        // Of the 250 events of 5 ms, half: the last 2 ms and more of each 5.
        assert!((2_500..2_700).contains(&view.overflowed()), "{}", view.overflowed());
    }

    /// A window that ends at the newest event, whatever the grid; what is dropped is counted.
    #[test]
    fn the_last_event_is_the_reference() {
        let mut view = view(
            r#"{"name": "v", "kind": "tencode", "period_us": 1000, "reference": "last_event", "window_us": 100,
                "events_max": 3}"#,
        )
        .unwrap();
        let events = [650, 800, 900, 950].map(|t| Event::new(t, (t % 4) as u16, 0, Polarity::On));
        let (closed, bytes) = &drawn(&mut view, &events, 4)[0];
        assert_eq!((closed.window, closed.events), (Window { t0: 800, t1: 900 }, 4));
        assert_eq!((view.older(), view.overflowed()), (1, 1));
        let ages = &bytes[GEOMETRY.pixels()..][..4];
        assert_eq!((bytes[0], ages), (255, [0, 0, 0, 0].as_slice()));
    }

    /// Memory that is never what it was: nothing is left of the window before.
    struct Fresh(Vec<Line>, usize, Vec<Vec<u8>>);

    impl Canvas for Fresh {
        fn begin(&mut self, _: Window) {
            self.0.fill(Line([0x5A; 64]));
        }

        fn memory(&mut self) -> Option<&mut [u8]> {
            Some(&mut bytemuck::cast_slice_mut(&mut self.0)[..self.1])
        }

        fn end(&mut self, _: Closed) {
            let tensor = self.memory().unwrap().to_vec();
            self.2.push(tensor);
        }
    }

    /// Windows of few events, of more than the log holds, and of none.
    #[test]
    fn memory_that_is_kept_gives_the_same_bytes() {
        let geometry = Geometry::new(37, 29);
        let events: Vec<Event> = (0..40_000u32)
            .map(|i| {
                let (t, at) =
                    (i / 8 * (1 + i / 9_000) + i / 16_000 * 9_000, i.wrapping_mul(0x9E37_79B1) >> 8);
                Event::new(t, (at % 37) as u16, (at / 37 % 29) as u16, Polarity::from_bit(at as u16 >> 5))
            })
            .collect();
        for kind in Kind::ALL {
            let mut erased = 0;
            for (period_us, len) in [(20, 7), (70, 4096), (330, 100), (1_500, 4096)] {
                let mut views =
                    [0; 2].map(|_| View::try_new(&ViewSpec::new("v", *kind, period_us), geometry).unwrap());
                let len_bytes = views[0].len_bytes();
                let mut fresh = Fresh(vec![Line::zeroed(); len_bytes.div_ceil(64)], len_bytes, vec![]);
                let mut kept = Vec::new();
                let mut offline = Offline::new(len_bytes, |_, bytes: &[u8]| kept.push(bytes.to_vec()));
                for events in events.chunks(len) {
                    views[0].push(span(geometry, events), &mut fresh).unwrap();
                    views[1].push(span(geometry, events), &mut offline).unwrap();
                    erased += u32::from(views[1].eraser.as_ref().is_some_and(Eraser::knows));
                }
                assert!(kept.len() > 10, "{kind:?} {period_us}");
                assert!(kept == fresh.2, "{kind:?} {period_us}");
            }
            let view = View::try_new(&ViewSpec::new("v", *kind, 10), geometry).unwrap();
            assert_eq!(erased > 0, view.representation.is_sparse(), "{kind:?}");
        }
    }

    #[test]
    fn refuses_settings_that_mean_nothing() {
        for (settings, text) in [
            (r#""kind": "count", "period_us": 0"#, "period_us = 0 is not a period: give 1 to 1073741823 µs"),
            (r#""kind": "count""#, "period_us = 0 is not a period: give 1 to 1073741823 µs"),
            (
                r#""kind": "count", "slice_events": 9, "period_us": 3"#,
                "period_us means nothing beside slice_events: remove it",
            ),
            (
                r#""kind": "count", "slice_events": 9, "reference": "window_end""#,
                "reference means nothing beside slice_events: remove it",
            ),
            (
                r#""kind": "count", "slice_events": 9, "stride_us": 3"#,
                "stride_us means nothing beside slice_events: remove it",
            ),
            (
                r#""kind": "count", "slice_events": 9, "stride_events": 2"#,
                "stride_events = 2 is no stride of windows of 9 events: give a whole part of them, 1/1024 at least",
            ),
            (
                r#""kind": "count", "period_us": 9, "stride_events": 3"#,
                "stride_events means nothing without slice_events: remove it",
            ),
            (
                r#""kind": "count", "period_us": 9, "stride_us": 2"#,
                "stride_us = 2 is no stride of windows of 9 µs: give a whole part of them, 1/1024 at least",
            ),
            (
                r#""kind": "count", "period_us": 9, "stride_us": 3, "events_max": 0"#,
                "events_max = 0 is out of range: give 1 to 2^28 events",
            ),
            (
                r#""kind": "count", "period_us": 9, "events_max": 9"#,
                "events_max means nothing without windows that overlap or a reference of last_event: remove it",
            ),
            (
                r#""kind": "count", "slice_events": 0"#,
                "slice_events = 0 is out of range: give 1 to 2^28 events",
            ),
            (
                r#""kind": "count", "period_us": 9, "window_us": 3"#,
                "window_us means nothing without a reference of last_event: remove it",
            ),
            (
                r#""kind": "count", "period_us": 9, "reference": "last_event", "window_us": 0"#,
                "window_us = 0 is out of range: give 1 to 2^30 µs",
            ),
            (
                r#""kind": "mcts", "period_us": 9, "windows_us": [0]"#,
                "windows_us = 0 is out of range: give 1 to 2^30 µs each",
            ),
            (
                r#""kind": "slice_countmask", "period_us": 9, "percentile": 101"#,
                "percentile = 101 is out of range: give 0 to 100",
            ),
            (
                r#""kind": "voxel_grid", "period_us": 9, "bins": 0"#,
                "bins = 0 is no voxel grid: give at least 1, and 2^32 elements at most",
            ),
            (
                r#""kind": "time_surface", "period_us": 9, "tau_us": 0"#,
                "tau_us = 0 is not a decay: give 1 to 33554432 µs",
            ),
            (
                r#""kind": "count", "period_us": 9, "bins": 3"#,
                "bins means nothing to a count view: remove it",
            ),
            (
                r#""kind": "voxel_grid", "period_us": 9, "tau_us": 3"#,
                "tau_us means nothing to a voxel_grid view: remove it",
            ),
            (
                r#""kind": "voxel_grid", "period_us": 9, "dtype": "u8""#,
                "a voxel_grid view has no elements of type u8: give one of f32",
            ),
            (
                r#""kind": "count", "period_us": 9, "dtype": "f16""#,
                "a count view has no elements of type f16: give one of u8 u16 f32",
            ),
        ] {
            let json = format!(r#"{{"name": "v", {settings}}}"#);
            assert_eq!(view(&json).unwrap_err().to_string(), text, "{json}");
        }
        for json in [
            r#"{"kind": "count", "period_us": 9}"#,
            r#"{"name": "v", "kind": "counts", "period_us": 9}"#,
            r#"{"name": "v", "kind": "count", "period_us": 9, "perod": 1}"#,
            r#"{"name": "v", "kind": "count", "period_us": -9}"#,
        ] {
            assert!(spec(json).is_err(), "{json}");
        }
    }

    #[test]
    fn settings_survive_writing_and_reading() {
        let spec = ViewSpec {
            tau_us: Some(5),
            dtype: Some(Dtype::F16),
            ..ViewSpec::new("s", Kind::TimeSurface, 100)
        };
        let json = serde_json::to_string(&spec).unwrap();
        assert_eq!(json, r#"{"name":"s","kind":"time_surface","period_us":100,"dtype":"f16","tau_us":5}"#);
        assert_eq!(serde_json::from_str::<ViewSpec>(&json).unwrap(), spec);
    }

    /// Lends what it is told to, and remembers how often.
    struct Lender {
        lines: Vec<Line>,
        from: usize,
        len: Option<usize>,
        ends: usize,
    }

    impl Canvas for Lender {
        fn begin(&mut self, _: Window) {}

        fn memory(&mut self) -> Option<&mut [u8]> {
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut self.lines);
            self.len.map(|len| &mut bytes[self.from..self.from + len])
        }

        fn end(&mut self, _: Closed) {
            self.ends += 1;
        }
    }

    #[test]
    fn a_window_without_memory_is_left_out_and_bad_memory_is_an_error() {
        let len_bytes = 2 * GEOMETRY.pixels() * 4;
        let event = [Event::new(50, 1, 1, Polarity::On)];
        let bad = |found| Err(PushError::Memory { expected: len_bytes, found });
        for (from, len, expected) in [
            (0, None, Ok(())),
            (0, Some(len_bytes), Ok(())),
            (1, Some(len_bytes), bad(len_bytes)),
            (0, Some(len_bytes - 4), bad(len_bytes - 4)),
        ] {
            let mut view = view(r#"{"name": "v", "kind": "time_surface", "period_us": 100}"#).unwrap();
            let mut lender = Lender { lines: vec![Line::zeroed(); 8], from, len, ends: 0 };
            assert_eq!(view.push(span(GEOMETRY, &event), &mut lender), expected);
            // The next window has memory, and the surface knows of the event all the same.
            (lender.from, lender.len) = (0, Some(len_bytes));
            view.advance(100 + Slicer::SLACK_US, &mut lender).unwrap();
            view.finish(150, &mut lender).unwrap();
            let surface: &[f32] = bytemuck::cast_slice(&lender.memory().unwrap()[..len_bytes]);
            assert!(surface[GEOMETRY.index(1, 1)] > 0.9);
            assert!(lender.ends > 1);
        }
    }

    #[test]
    fn refuses_another_sensor() {
        let mut view = view(r#"{"name": "v", "kind": "count", "period_us": 100}"#).unwrap();
        let found = Geometry::new(3, 5);
        let span = Span { t_first: 0, t_last: 0, geometry: found, events: &[] };
        let wrong = PushError::Geometry(WrongGeometry { expected: GEOMETRY, found });
        let mut canvas = Offline::new(view.len_bytes(), |_, _: &[u8]| {});
        assert_eq!(view.push(span, &mut canvas), Err(wrong));
    }
}
