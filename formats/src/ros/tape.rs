//! Bytes of a bag in order: those of the file, or of a chunk inside it, unpacked if it is packed.
//!
//! What is stored plainly is read in pieces that stay in the nearest caches; a packed chunk, or one with a checksum, is
//! held whole, since only at its end is it known to be right.

use super::log;
use super::packing::{Packed, Packing, Unpacked};
use crate::input::Input;
use crate::{Error, ErrorKind};
use lobula_core::{Counters, Fault};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Bytes read from the file at once.
const READ_BYTES: usize = 64 << 10;

/// Most memory that is kept from chunk to chunk.
const KEPT_BYTES: usize = 4 << 20;

/// A place in a file, from which to read on.
#[derive(Debug)]
pub(crate) struct Tape {
    input: Arc<Input>,
    /// Largest packed chunk once unpacked.
    chunk_bytes_max: usize,
    /// Where the file's own bytes end, by what the file says.
    end: u64,
    /// Where another goes on, outside of chunks, in a file that is read in pieces; else beyond everything.
    stop: u64,
    /// Whether chunks are passed over.
    skims: bool,
    /// Offset in the file of the first byte in `unread`.
    at: u64,
    /// Empty until the first read, so that a checkpoint is small.
    buffer: Vec<u8>,
    /// The part of `buffer` that is not taken yet.
    unread: Range<usize>,
    chunk: Option<Chunk>,
    /// Bytes of a chunk that is held; the memory is kept from chunk to chunk.
    unpacked: Vec<u8>,
}

/// A chunk that is being read.
#[derive(Clone, Debug)]
struct Chunk {
    /// What it is in the file.
    packed: Packed,
    /// Bytes of it once unpacked.
    bytes: u64,
    /// Whether it is held whole in memory; else it is read as it comes.
    held: bool,
    /// Bytes taken of it, where it is held; else the place in the file tells.
    taken: u64,
    /// Whether its bytes are in memory: not so after a fork.
    ready: bool,
}

impl Tape {
    /// The bytes of `range`.
    pub fn new(input: Arc<Input>, range: Range<u64>, chunk_bytes_max: usize) -> Self {
        Self {
            input,
            chunk_bytes_max,
            end: range.end,
            stop: u64::MAX,
            skims: false,
            at: range.start,
            buffer: Vec::new(),
            unread: 0..0,
            chunk: None,
            unpacked: Vec::new(),
        }
    }

    /// Another at the same place, without buffers.
    pub fn fork(&self) -> Self {
        let chunk = self.chunk.clone().map(|chunk| Chunk { ready: !chunk.held, ..chunk });
        Self { chunk, ..self.over(self.at..self.stop) }
    }

    /// Another outside of chunks that goes from `range.start` on and stops at `range.end`.
    pub fn over(&self, range: Range<u64>) -> Self {
        let whole = range.start..self.end;
        Self { stop: range.end, ..Self::new(self.input.clone(), whole, self.chunk_bytes_max) }
    }

    /// Another that passes over chunks, for the places between them.
    pub fn skim(&self) -> Self {
        Self { skims: true, ..self.fork() }
    }

    /// Offset in the file outside of chunks, and where its own bytes end.
    pub fn outside(&self) -> Option<Range<u64>> {
        self.chunk.is_none().then_some(self.at..self.end)
    }

    /// Whether another goes on after `bytes` more.
    pub fn stops_after(&self, bytes: u64) -> bool {
        self.chunk.is_none() && self.at.saturating_add(bytes) >= self.stop
    }

    pub fn input(&self) -> &Arc<Input> {
        &self.input
    }

    pub fn path(&self) -> &Path {
        self.input.path()
    }

    /// Whether the bytes are those of a chunk.
    pub fn in_chunk(&self) -> bool {
        self.chunk.is_some()
    }

    /// Bytes until the end of the chunk, or of the file, as the file says: there may be fewer.
    pub fn left(&self) -> u64 {
        match &self.chunk {
            Some(chunk) if chunk.held => chunk.bytes - chunk.taken,
            Some(chunk) => chunk.packed.range.end.saturating_sub(self.at),
            None => self.end.saturating_sub(self.at),
        }
    }

    /// Those of them that are there.
    pub fn available(&self) -> u64 {
        match &self.chunk {
            Some(chunk) if chunk.held => self.left(),
            _ => self.left().min(self.input.len().saturating_sub(self.at)),
        }
    }

    /// Offset in the file; in a chunk that is held in proportion. It only grows.
    pub fn position(&self) -> u64 {
        match &self.chunk {
            Some(Chunk { packed, bytes, taken, held: true, .. }) => {
                let packed_bytes = u128::from(packed.range.end - packed.range.start);
                let done = packed_bytes * u128::from(*taken) / u128::from((*bytes).max(1));
                packed.range.start + done as u64
            }
            _ => self.at.min(self.input.len()),
        }
    }

    /// The next bytes: at least `min` of them, or all that are left where these are fewer.
    pub fn peek(&mut self, min: usize) -> Result<&[u8], Error> {
        if self.chunk.as_ref().is_some_and(|chunk| chunk.held) {
            return self.peek_unpacked();
        }
        let available = usize::try_from(self.available()).unwrap_or(usize::MAX);
        if self.unread.len() < min.min(available) {
            self.refill(min.max(READ_BYTES).min(available))?;
        }
        let len = self.unread.len().min(available);
        Ok(self.buffer.get(self.unread.start..self.unread.start + len).unwrap_or_default())
    }

    fn peek_unpacked(&mut self) -> Result<&[u8], Error> {
        if self.chunk.as_ref().is_some_and(|chunk| !chunk.ready) && !self.unpack()? {
            let what = "changed while it was read";
            let remedy = "let the other program finish, then open it again";
            return Err(Error::new(ErrorKind::Changed, self.path(), what, remedy).at(self.position()));
        }
        let Some(Chunk { bytes, taken, .. }) = self.chunk else { return Ok(&[]) };
        Ok(self.unpacked.get(taken as usize..bytes as usize).unwrap_or_default())
    }

    /// Reads until `want` bytes are in the buffer.
    fn refill(&mut self, want: usize) -> Result<(), Error> {
        let have = self.unread.len();
        self.buffer.copy_within(self.unread.clone(), 0);
        if self.buffer.len() < want {
            self.buffer.resize(want, 0);
        }
        let room = self.buffer.get_mut(have..want).unwrap_or_default();
        let len = self.input.read_at(self.at + have as u64, room)?;
        self.unread = 0..have + len;
        Ok(())
    }

    /// Passes over bytes; over no more than are left.
    pub fn take(&mut self, bytes: u64) {
        let bytes = bytes.min(self.left());
        if let Some(chunk) = self.chunk.as_mut().filter(|chunk| chunk.held) {
            chunk.taken += bytes;
            return;
        }
        self.at += bytes;
        match usize::try_from(bytes) {
            Ok(bytes) if bytes <= self.unread.len() => self.unread.start += bytes,
            _ => self.unread = 0..0,
        }
    }

    /// Goes on at an offset in the file, outside of chunks.
    pub fn jump(&mut self, offset: u64) {
        self.chunk = None;
        let ahead = offset.checked_sub(self.at).and_then(|ahead| usize::try_from(ahead).ok());
        match ahead {
            Some(ahead) if ahead <= self.unread.len() => self.unread.start += ahead,
            _ => self.unread = 0..0,
        }
        self.at = offset;
    }

    /// Goes into a chunk whose data begin at the next byte; `bytes` is its length once unpacked. False where it
    /// cannot be unpacked or is not what its checksum says: then the place is behind it. A chunk that the file's end
    /// cuts holds what is there.
    pub fn enter(
        &mut self,
        packing: Packing,
        packed_bytes: u64,
        bytes: u64,
        crc: Option<u32>,
    ) -> Result<bool, Error> {
        let range = self.at..self.at.saturating_add(packed_bytes);
        if self.skims {
            self.jump(range.end.min(self.input.len()));
            return Ok(true);
        }
        let packed = Packed { packing, range, crc };
        let fits = bytes <= self.chunk_bytes_max as u64;
        // Of one that is cut the checksum tells nothing.
        let is_checked = crc.is_some() && packed.range.end <= self.input.len();
        if packing == Packing::Plain && !(is_checked && fits) {
            let good = !is_checked || packed.has_crc(&self.input, bytes)?;
            self.chunk = Some(Chunk { packed, bytes, held: false, taken: 0, ready: true });
            if !good {
                self.leave();
            }
            return Ok(good);
        }
        if !fits {
            let what = format!("has a chunk of {bytes} bytes once unpacked, beyond {}", self.chunk_bytes_max);
            let remedy = "it is damaged there; if not, write it with smaller chunks";
            return Err(Error::new(ErrorKind::TooLarge, self.path(), what, remedy).at(self.at));
        }
        self.chunk = Some(Chunk { packed, bytes, held: true, taken: 0, ready: false });
        let good = self.unpack()?;
        if !good {
            self.leave();
        }
        Ok(good)
    }

    /// Unpacks the chunk; whether it is good.
    fn unpack(&mut self) -> Result<bool, Error> {
        let Some(chunk) = &mut self.chunk else { return Ok(false) };
        let known = match chunk.packed.unpack(&self.input, chunk.bytes as usize, &mut self.unpacked)? {
            Unpacked::Whole => true,
            Unpacked::Cut(bytes) => {
                chunk.bytes = bytes as u64;
                true
            }
            Unpacked::Damaged => false,
        };
        chunk.ready = known;
        Ok(known && chunk.taken <= chunk.bytes)
    }

    /// Goes behind the chunk.
    pub fn leave(&mut self) {
        if self.unpacked.len() > KEPT_BYTES {
            self.unpacked = Vec::new();
        }
        if let Some(chunk) = self.chunk.take() {
            self.jump(chunk.packed.range.end.min(self.input.len()));
        }
    }

    /// What comes makes no sense: counts it and goes behind its chunk, or to the next of these chunks of the file,
    /// or to the end.
    pub fn pass_damage(&mut self, chunks: &[u64], counters: &mut Counters) {
        if self.in_chunk() {
            let cut = self.available() < self.left();
            let fault = if cut { Fault::CutShort } else { Fault::Damaged };
            log::fault(counters, fault, self.available());
            self.leave();
            return;
        }
        let (at, end) = (self.at, self.at.saturating_add(self.available()));
        let next =
            chunks.get(chunks.partition_point(|chunk| *chunk <= at)).copied().filter(|next| *next < end);
        let fault = if next.is_some() { Fault::Damaged } else { Fault::CutShort };
        log::fault(counters, fault, next.unwrap_or(end).saturating_sub(at));
        self.jump(next.unwrap_or(self.end.max(at)));
    }
}
