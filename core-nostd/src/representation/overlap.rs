//! Windows that overlap: each drawn from the one before, where the definition allows it.

use crate::{Piece, Representation, Slide, WrongGeometry};

/// Numbers of events up to this are exact in every type of element that does not stop before: f32 is up to 2^24.
const EXACT: usize = 1 << 24;

/// How the tensor of a window is built where windows overlap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overlap {
    /// From all of its events: where in the window they lie tells what they are worth.
    Anew,
    /// From the tensor of the window before: an event adds the same wherever it lies, and is taken away when it leaves.
    Sum,
    /// The same, in memory of the representation's own; the tensor is not touched before the window's end.
    OwnSum,
    /// From the events that came since the window before: what it remembers of the others does not depend on windows.
    Memory,
}

/// Draws the windows of a [`SlidingSlicer`](crate::SlidingSlicer), each with as little work as its kind of tensor allows.
///
/// | kinds | drawn |
/// |---|---|
/// | `count`, `tile_count`, `polarity_histogram`, `event_frame` (the sum, f32), `binary` (from a count), and from counts of their own `slice_polarity_histogram`, `slice_countmask`, `slice_red_blue` | from the window before: what came is added, what left is taken away |
/// | `time_surface`, `mcts`, `event_image`, `tore`, `sits`, `tos` | from what came: they remember the rest, from before the window too |
/// | all others | anew, from the events that are kept |
///
/// An `event_frame` of u8 is drawn anew, since a sum that stops at what a byte holds depends on where the window begins: to
/// know which pixels stopped, counts of both polarities would have to be kept, and all of them looked at for every window.
/// That of f32 need not. Frames of the last event's sign are, since a sign does not tell how many events are left.
///
/// Sums whose elements hold no more (u8: 255 events) cannot tell what is left when an event leaves: such windows are drawn
/// anew, until every element can count again. So are those of over 2^24 events. The tensors have the same bits either way.
///
/// Counts (u8, 1280x720) of 33 ms, one each ms, of 10 Mev/s took 74 instructions an event; drawn anew 218 (Xeon, 2026-11).
///
/// ```
/// use lobula_core::representation::{Count, Sliding};
/// use lobula_core::{Event, Geometry, Grid, Polarity, Slide, SlidingSlicer, Span, Stride};
/// let geometry = Geometry::new(3, 1);
/// let events = [(10, 0), (25, 1), (38, 2)].map(|(t, x)| Event::new(t, x, 0, Polarity::On));
/// let span = Span { t_first: 10, t_last: 38, geometry, events: &events };
/// let grid = Grid::Time { period_us: 20, stride_us: 10 };
/// let mut slicer = SlidingSlicer::try_new(grid, geometry, [Stride::default(); 2], [Event::default(); 64])?;
/// let (mut count, mut sliding) = (Count::<u8>::new(geometry), Sliding::new());
/// let (mut sum, mut out, mut tensors) = ([0; 3], [0; 3], Vec::new());
/// let mut each = |slide: &Slide<'_>| {
///     sliding.draw(&mut count, slide, &mut sum, &mut out).unwrap();
///     tensors.push((slide.closed.window.t0, out));
/// };
/// slicer.push(span, &mut each)?;
/// slicer.finish(38, &mut each);
/// assert_eq!(tensors, [(10, [1, 1, 0]), (20, [0, 1, 1])]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Sliding {
    /// Whether the sum is that of the events that stay.
    sound: bool,
}

impl Sliding {
    /// Before the first window.
    pub const fn new() -> Self {
        Self { sound: false }
    }

    /// Elements of the sum that [`draw`](Self::draw) needs for a representation.
    pub fn sum_len<R: Representation>(stage: &R) -> usize {
        if stage.overlap() == Overlap::Sum { stage.shape().len() } else { 0 }
    }

    /// Draws a window into `out`. `sum` has [`sum_len`](Self::sum_len) elements, whatever they hold at first: always the
    /// same memory, to which nobody else writes. Always with the same representation, and with every window.
    pub fn draw<R: Representation>(
        &mut self,
        stage: &mut R,
        slide: &Slide<'_>,
        sum: &mut [R::Pixel],
        out: &mut [R::Pixel],
    ) -> Result<(), WrongGeometry> {
        let overlap = stage.overlap();
        if matches!(overlap, Overlap::Sum | Overlap::OwnSum) && slide.len() <= EXACT {
            return self.draw_sum(stage, slide, sum, out);
        }
        self.sound = false;
        let mut drawn = Ok(());
        slide.pieces(overlap, |piece| match piece {
            Piece::Begin(window) => stage.begin(window, out),
            Piece::Events(span) => drawn = drawn.and(stage.accumulate(span, out)),
            Piece::End(_) => stage.finish(out),
        });
        drawn
    }

    fn draw_sum<R: Representation>(
        &mut self,
        stage: &mut R,
        slide: &Slide<'_>,
        sum: &mut [R::Pixel],
        out: &mut [R::Pixel],
    ) -> Result<(), WrongGeometry> {
        let goes_on = core::mem::take(&mut self.sound) && !slide.is_first();
        if !goes_on {
            stage.begin(slide.closed.window, sum);
        }
        for span in if goes_on { slide.coming() } else { slide.events() } {
            stage.add(span, sum)?;
        }
        stage.show(sum, out);
        let mut sound = true;
        for span in slide.leaving() {
            sound &= stage.take_away(span, sum)?;
        }
        self.sound = sound;
        Ok(())
    }
}
