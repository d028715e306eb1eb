//! What a format owes: everything else (blocks, index, slices, summary) is made from it, once for all formats.

use crate::index::Seek;
use crate::{Error, Frame, ImuSample, Payload, Stream, StreamKind};
use lobula_core::wire::Encoding;
use lobula_core::{Counters, Geometry, Sink};
use std::ops::Range;

/// A file that was opened and whose header was read.
pub(crate) trait Container: Send + Sync + std::fmt::Debug {
    /// The sensor's size, if known.
    fn geometry(&self) -> Option<Geometry>;

    /// Size that blocks carry: the sensor's, else the largest that the format can tell.
    fn geometry_of_blocks(&self) -> Geometry;

    /// How events are encoded, where that is a camera's format.
    fn encoding(&self) -> Option<Encoding> {
        None
    }

    /// Lines of the header.
    fn fields(&self) -> Vec<(&str, &str)> {
        Vec::new()
    }

    /// The camera's bytes, where the file holds them as they came.
    fn payload(&self) -> Option<Payload> {
        None
    }

    /// Every stream of the file, also those we do not read.
    fn streams(&self) -> Vec<Stream> {
        vec![Stream::new(StreamKind::Events, "")]
    }

    /// Sentences about what is odd in the file and was not an error: shown as warnings.
    fn warnings(&self) -> Vec<String> {
        Vec::new()
    }

    /// A cursor at the first event.
    fn start(&self) -> Box<dyn Cursor>;

    /// About `n` pieces that together are the whole, to be decoded at the same time. One where that cannot be.
    fn pieces(&self, n: usize) -> Result<Vec<Piece>, Error> {
        let _ = n;
        Ok(vec![Piece { cursor: self.start(), wrap_us: 0 }])
    }

    /// From where to where to decode for everything of these times, where the format can tell without a pass over all
    /// of its events; `Ok(None)` where nothing is of them. `None`: it cannot, the index is to be used.
    fn seek_time(&self, t: &Range<u64>) -> Option<Result<Option<Seek>, Error>> {
        let _ = t;
        None
    }

    /// Samples of the inertial sensor, in file order.
    fn imu(&self) -> Items<ImuSample> {
        Box::new(std::iter::empty())
    }

    /// Frames, in file order.
    fn frames(&self) -> Items<Frame> {
        Box::new(std::iter::empty())
    }
}

/// A stretch of a recording that can be decoded without what comes before.
#[derive(Debug)]
pub(crate) struct Piece {
    /// It ends where the next piece starts.
    pub cursor: Box<dyn Cursor>,
    /// Where it cannot know how often time wrapped before it: after how many µs time wraps. Else 0.
    pub wrap_us: u64,
}

/// Side items of a recording, read as they are asked for. After an error there is no more.
pub(crate) type Items<T> = Box<dyn Iterator<Item = Result<T, Error>> + Send>;

/// Why a cursor stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stop {
    /// The sink takes no more.
    Full,
    /// There is no more.
    End,
}

/// A place in a recording, from which to decode on. It never fails on bad events: they are counted and skipped.
pub(crate) trait Cursor: Send + Sync + std::fmt::Debug {
    /// Decodes into `sink`, which is empty and holds at least [`Sink::LEN_MIN`] events, until it is full or all is
    /// done. What is in the sink at an error is good.
    fn fill(&mut self, sink: &mut Sink<'_>) -> Result<Stop, Error>;

    /// Offset up to which all is decoded, in the file or in what is packed in it; where a file is not read in order,
    /// another measure that only grows, and is the same wherever decoding began.
    fn position(&self) -> u64;

    /// The same for people: bytes of the file that are done, at most its length.
    fn progress(&self) -> u64 {
        self.position()
    }

    /// Stream time in µs, in formats whose [pieces](Container::pieces) need it to find each other.
    fn now(&self) -> u64 {
        0
    }

    /// Whether it met, in a [piece](Piece), what only a cursor from the start can tell: all that it gave is in doubt.
    fn in_the_dark(&self) -> bool {
        false
    }

    /// What was done from the start of the recording.
    fn counters(&self) -> Counters;

    /// Another cursor at the same place, without buffers, to keep in an index.
    fn fork(&self) -> Box<dyn Cursor>;
}
