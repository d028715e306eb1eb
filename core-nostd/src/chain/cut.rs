//! Where a view cuts its stream: on a grid of time, every so many events, or into windows that overlap.

use alloc::boxed::Box;

use crate::{CountSlicer, Event, Piece, Slicer, Slide, SlidingSlicer, Span, Stride};

/// A view's way of cutting.
#[derive(Debug)]
pub(super) enum Cut {
    Time(Slicer),
    Events(CountSlicer),
    Sliding(SlidingSlicer<Box<[Stride]>, Box<[Event]>>),
}

/// What comes of cutting.
pub(super) enum Part<'a, 'b> {
    Piece(Piece<'a>),
    Slide(&'a Slide<'b>),
}

impl Cut {
    /// The span is of the view's sensor.
    pub(super) fn push(&mut self, span: Span<'_>, mut each: impl FnMut(Part<'_, '_>)) {
        match self {
            Self::Time(slicer) => slicer.push(span, |piece| each(Part::Piece(piece))),
            Self::Events(slicer) => slicer.push(span, |piece| each(Part::Piece(piece))),
            // Only another sensor is refused.
            Self::Sliding(slicer) => slicer.push(span, |slide| each(Part::Slide(slide))).unwrap_or_default(),
        }
    }

    pub(super) fn advance(&mut self, now: u64, mut each: impl FnMut(Part<'_, '_>)) {
        match self {
            Self::Time(slicer) => slicer.advance(now, |piece| each(Part::Piece(piece))),
            Self::Events(_) => {}
            Self::Sliding(slicer) => slicer.advance(now, |slide| each(Part::Slide(slide))),
        }
    }

    pub(super) fn finish(&mut self, now: u64, mut each: impl FnMut(Part<'_, '_>)) {
        match self {
            Self::Time(slicer) => slicer.finish(now, |piece| each(Part::Piece(piece))),
            Self::Events(slicer) => slicer.finish(|piece| each(Part::Piece(piece))),
            Self::Sliding(slicer) => slicer.finish(now, |slide| each(Part::Slide(slide))),
        }
    }

    pub(super) fn late(&self) -> u64 {
        match self {
            Self::Time(slicer) => slicer.late(),
            Self::Events(_) => 0,
            Self::Sliding(slicer) => slicer.late(),
        }
    }

    pub(super) fn skipped(&self) -> u64 {
        match self {
            Self::Time(slicer) => slicer.skipped(),
            Self::Events(_) => 0,
            Self::Sliding(slicer) => slicer.skipped(),
        }
    }

    pub(super) fn overflowed(&self) -> u64 {
        match self {
            Self::Time(_) | Self::Events(_) => 0,
            Self::Sliding(slicer) => slicer.overflowed(),
        }
    }
}
