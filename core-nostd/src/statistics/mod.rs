//! What a stream is like, without its events: streaming over blocks, exact, in memory of the caller's.
//!
//! | statistic | tells | memory |
//! |---|---|---|
//! | [`EventRate`] | events by polarity in each bin of time, and with it rates and the balance of polarities | 16 bytes a bin |
//! | [`Intervals`] | how long pixels are silent between two events, as a histogram; each pixel's rate and mean interval | 24 bytes a pixel |
//! | [`PixelIntervals`] | the same with a histogram of each pixel | 24 bytes a pixel, and 4 a bin |
//!
//! The law of every stage holds: however the stream is cut into blocks, what comes out is the same.

mod event_rate;
mod intervals;
mod pixel_intervals;

pub use event_rate::{EventRate, Tally};
pub use intervals::{Intervals, PixelTimes};
pub use pixel_intervals::PixelIntervals;

/// Why there can be no statistic of this kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadStatistic {
    /// A bin of no length.
    BinUs,
    /// The state's memory has another length than the statistic needs.
    StateLen {
        /// Elements needed.
        expected: usize,
        /// Elements given.
        found: usize,
    },
}

impl core::fmt::Display for BadStatistic {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::BinUs => write!(f, "bin_us = 0 is no bin: give at least 1 µs"),
            Self::StateLen { expected, found } => {
                write!(f, "memory of {found} elements was given where {expected} are needed")
            }
        }
    }
}

impl core::error::Error for BadStatistic {}
