//! Where a view cuts its stream: on a grid of time, or every so many events.

use crate::{CountSlicer, Piece, Slicer, Span};

/// A view's way of cutting.
#[derive(Clone, Debug)]
pub(super) enum Cut {
    Time(Slicer),
    Events(CountSlicer),
}

impl Cut {
    pub(super) fn push(&mut self, span: Span<'_>, each: impl FnMut(Piece<'_>)) {
        match self {
            Self::Time(slicer) => slicer.push(span, each),
            Self::Events(slicer) => slicer.push(span, each),
        }
    }

    pub(super) fn advance(&mut self, now: u64, each: impl FnMut(Piece<'_>)) {
        match self {
            Self::Time(slicer) => slicer.advance(now, each),
            Self::Events(_) => {}
        }
    }

    pub(super) fn finish(&mut self, now: u64, each: impl FnMut(Piece<'_>)) {
        match self {
            Self::Time(slicer) => slicer.finish(now, each),
            Self::Events(slicer) => slicer.finish(each),
        }
    }

    pub(super) fn late(&self) -> u64 {
        match self {
            Self::Time(slicer) => slicer.late(),
            Self::Events(_) => 0,
        }
    }

    pub(super) fn skipped(&self) -> u64 {
        match self {
            Self::Time(slicer) => slicer.skipped(),
            Self::Events(_) => 0,
        }
    }
}
