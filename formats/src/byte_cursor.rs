//! The cursor of formats that are bytes in order: it reads, a decoder decodes. One for all of them.

use crate::container::{Cursor, Stop};
use crate::input::Input;
use crate::{Error, ErrorKind};
use lobula_core::{Counters, Sink};
use std::fmt::Debug;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Bytes of a file in, events out. Chunk invariant: any split of the bytes gives the same events and counts.
pub(crate) trait ByteDecoder: Clone + Debug + Send + Sync + 'static {
    /// Decodes what is whole. Bytes of a record that is cut are left untaken, and given again with more after them.
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad>;

    /// The file has ended after these untaken bytes: they become a fault.
    fn finish(&mut self, unread: &[u8]);

    /// Decodes what is left at the end of the file: by default as [`finish`](Self::finish) does.
    fn decode_last(&mut self, unread: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        let _ = sink;
        self.finish(unread);
        Ok(Step { taken: unread.len(), full: false })
    }

    /// What was done so far.
    fn counters(&self) -> Counters;

    /// Stream time in µs, where [pieces](crate::container::Piece) need it.
    fn now(&self) -> u64 {
        0
    }

    /// As [`Cursor::in_the_dark`].
    fn in_the_dark(&self) -> bool {
        false
    }
}

/// Bytes to decode, by their offset: of a file, or unpacked from one.
pub(crate) trait Bytes: Debug + Send + Sync + 'static {
    /// The file.
    fn path(&self) -> &Path;

    /// Fills `buffer` from `offset`, but for what lies beyond the end; returns how many bytes were read.
    fn read_at(&mut self, offset: u64, buffer: &mut [u8]) -> Result<usize, Error>;

    /// Another one over the same bytes, without buffers.
    fn fork(&self) -> Self;

    /// Offset in the file up to which packed bytes were read, where they are packed.
    fn packed_position(&self) -> Option<u64> {
        None
    }
}

impl Bytes for Arc<Input> {
    fn path(&self) -> &Path {
        Input::path(self)
    }

    fn read_at(&mut self, offset: u64, buffer: &mut [u8]) -> Result<usize, Error> {
        Input::read_at(self, offset, buffer)
    }

    fn fork(&self) -> Self {
        self.clone()
    }
}

/// What one call of a decoder did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Step {
    /// Bytes taken.
    pub taken: usize,
    /// The sink takes no more; else the bytes not taken are the start of a longer record.
    pub full: bool,
}

/// Why decoding cannot go on: for what no count and no skip can make good, such as a time that no event can hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Bad {
    /// Where, counted from the first byte of the call.
    pub offset: usize,
    pub kind: ErrorKind,
    pub what: String,
    pub remedy: String,
}

impl Bad {
    /// The error of a file, where the call began at `position`.
    pub fn error(self, path: &Path, position: u64) -> Error {
        Error::new(self.kind, path, self.what, self.remedy).at(position + self.offset as u64)
    }
}

/// Bytes read at once.
const READ_BYTES: usize = 64 << 10;
/// Longest record.
const RECORD_BYTES_MAX: usize = 16 << 20;

/// A decoder and the bytes it takes next.
#[derive(Debug)]
pub(crate) struct ByteCursor<D, B = Arc<Input>> {
    source: B,
    decoder: D,
    /// Offset in the source of the byte after those in `buffer`.
    next: u64,
    /// Offset at which the records end; beyond the source's where that is not known.
    end: u64,
    /// Empty until the first read, so that a checkpoint is small.
    buffer: Vec<u8>,
    /// The part of `buffer` that is not decoded yet.
    unread: Range<usize>,
}

impl<D: ByteDecoder, B: Bytes> ByteCursor<D, B> {
    /// A cursor over the bytes of `range`.
    pub fn new(source: B, range: Range<u64>, decoder: D) -> Self {
        Self { source, decoder, next: range.start, end: range.end, buffer: Vec::new(), unread: 0..0 }
    }

    /// Reads on, after what is not decoded yet; false at the end.
    fn refill(&mut self) -> Result<bool, Error> {
        let unread = self.unread.len();
        self.buffer.copy_within(self.unread.clone(), 0);
        self.unread = 0..unread;
        let left = usize::try_from(self.end.saturating_sub(self.next)).unwrap_or(usize::MAX);
        // A record longer than the buffer makes the buffer longer.
        let want = left.min(READ_BYTES.max(unread));
        if want > 0 && unread + want > RECORD_BYTES_MAX + READ_BYTES {
            return Err(self.endless());
        }
        self.buffer.resize(unread + want, 0);
        let len = self.source.read_at(self.next, &mut self.buffer[unread..])?;
        self.buffer.truncate(unread + len);
        self.next += len as u64;
        self.unread.end += len;
        Ok(len > 0)
    }

    fn endless(&self) -> Error {
        let what = format!("has a record of more than {RECORD_BYTES_MAX} bytes");
        Error::new(ErrorKind::TooLarge, self.source.path(), what, "it is damaged there: copy it again")
            .at(self.position())
    }
}

impl<D: ByteDecoder, B: Bytes> Cursor for ByteCursor<D, B> {
    fn fill(&mut self, sink: &mut Sink<'_>) -> Result<Stop, Error> {
        loop {
            let bytes = &self.buffer[self.unread.clone()];
            let step = self.decoder.decode(bytes, sink);
            let step = step.map_err(|bad| bad.error(self.source.path(), self.position()))?;
            self.unread.start += step.taken;
            if step.full {
                return Ok(Stop::Full);
            }
            if !self.refill()? {
                let step = self.decoder.decode_last(&self.buffer[self.unread.clone()], sink);
                let step = step.map_err(|bad| bad.error(self.source.path(), self.position()))?;
                self.unread.start += step.taken;
                return Ok(if step.full { Stop::Full } else { Stop::End });
            }
        }
    }

    fn position(&self) -> u64 {
        self.next - self.unread.len() as u64
    }

    fn progress(&self) -> u64 {
        self.source.packed_position().unwrap_or(self.position())
    }

    fn counters(&self) -> Counters {
        self.decoder.counters()
    }

    fn now(&self) -> u64 {
        self.decoder.now()
    }

    fn in_the_dark(&self) -> bool {
        self.decoder.in_the_dark()
    }

    fn fork(&self) -> Box<dyn Cursor> {
        let (source, decoder, next) = (self.source.fork(), self.decoder.clone(), self.position());
        Box::new(Self { source, decoder, next, end: self.end, buffer: Vec::new(), unread: 0..0 })
    }
}
