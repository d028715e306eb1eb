//! Where a view cuts its stream: on a grid of time or every so many events, one window after the other or overlapping.

use alloc::boxed::Box;

use crate::sliding_slicer::Strides;
use crate::{Event, Piece, Slide, SlidingSlicer, Span, Stride};

/// A view's way of cutting.
#[derive(Debug)]
pub(super) enum Cut {
    Apart(Strides),
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
            Self::Apart(strides) => strides.push(span, |piece| each(Part::Piece(piece))),
            // Only another sensor is refused.
            Self::Sliding(slicer) => slicer.push(span, |slide| each(Part::Slide(slide))).unwrap_or_default(),
        }
    }

    pub(super) fn advance(&mut self, now: u64, mut each: impl FnMut(Part<'_, '_>)) {
        match self {
            Self::Apart(strides) => strides.advance(now, |piece| each(Part::Piece(piece))),
            Self::Sliding(slicer) => slicer.advance(now, |slide| each(Part::Slide(slide))),
        }
    }

    pub(super) fn finish(&mut self, now: u64, mut each: impl FnMut(Part<'_, '_>)) {
        match self {
            Self::Apart(strides) => strides.finish(now, |piece| each(Part::Piece(piece))),
            Self::Sliding(slicer) => slicer.finish(now, |slide| each(Part::Slide(slide))),
        }
    }

    pub(super) fn late(&self) -> u64 {
        match self {
            Self::Apart(strides) => strides.late(),
            Self::Sliding(slicer) => slicer.late(),
        }
    }

    pub(super) fn skipped(&self) -> u64 {
        match self {
            Self::Apart(strides) => strides.skipped(),
            Self::Sliding(slicer) => slicer.skipped(),
        }
    }

    pub(super) fn overflowed(&self) -> u64 {
        match self {
            Self::Apart(_) => 0,
            Self::Sliding(slicer) => slicer.overflowed(),
        }
    }
}
