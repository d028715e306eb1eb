//! Bytes that stand packed (gzip, deflate, zstd) in a file, read by their unpacked offset in bounded memory.
//!
//! Reading on is cheap; going back unpacks from the start again.

use crate::byte_cursor::Bytes;
use crate::input::Input;
use crate::output::Output;
use crate::{Compression, Error, ErrorKind};
use std::fmt;
use std::io::{BufReader, Read, Write};
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// How bytes are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    /// One or more gzip members.
    Gzip,
    /// A bare deflate stream, as in zip files.
    Deflate,
    /// One or more zstd frames.
    Zstd,
}

impl Packing {
    /// The packing of a file, by its first bytes.
    pub fn of(head: &[u8]) -> Option<Self> {
        match head {
            [0x1F, 0x8B, 8, ..] => Some(Self::Gzip),
            [0x28, 0xB5, 0x2F, 0xFD, ..] => Some(Self::Zstd),
            _ => None,
        }
    }
}

/// Packed bytes read at once.
const READ_BYTES: usize = 32 << 10;
/// Largest window of zstd, as a power of 2: 32 MiB, above what any level but the `--ultra` ones uses.
const ZSTD_WINDOW_LOG_MAX: u32 = 25;

/// Begins to unpack; `None` where not even that works.
fn unpacker(packing: Packing, packed: impl Read + Send + 'static) -> Option<Box<dyn Read + Send>> {
    let packed = BufReader::with_capacity(READ_BYTES, packed);
    Some(match packing {
        Packing::Gzip => Box::new(flate2::bufread::MultiGzDecoder::new(packed)),
        Packing::Deflate => Box::new(flate2::bufread::DeflateDecoder::new(packed)),
        Packing::Zstd => {
            let mut decoder = zstd::stream::read::Decoder::with_buffer(packed).ok()?;
            decoder.window_log_max(ZSTD_WINDOW_LOG_MAX).ok()?;
            Box::new(decoder)
        }
    })
}

/// What the first bytes of a file unpack to, at most `bytes_max` of it.
pub(crate) fn unpack_head(packing: Packing, head: &[u8], bytes_max: usize) -> Vec<u8> {
    let mut unpacked = Vec::new();
    if let Some(unpacker) = unpacker(packing, std::io::Cursor::new(head.to_vec())) {
        // The head is cut: what came before the error is what there is.
        let _ = unpacker.take(bytes_max as u64).read_to_end(&mut unpacked);
    }
    unpacked
}

/// Where a cursor reads its bytes.
#[derive(Debug)]
pub(crate) enum Source {
    /// In the file as they are.
    Plain(Arc<Input>),
    /// In the file, packed.
    Packed(Unpack),
}

impl Bytes for Source {
    fn path(&self) -> &Path {
        match self {
            Self::Plain(input) => input.path(),
            Self::Packed(unpack) => unpack.input.path(),
        }
    }

    fn read_at(&mut self, offset: u64, buffer: &mut [u8]) -> Result<usize, Error> {
        match self {
            Self::Plain(input) => input.read_at(offset, buffer),
            Self::Packed(unpack) => unpack.read_at(offset, buffer),
        }
    }

    fn fork(&self) -> Self {
        match self {
            Self::Plain(input) => Self::Plain(input.clone()),
            Self::Packed(unpack) => Self::Packed(unpack.fork()),
        }
    }

    fn packed_position(&self) -> Option<u64> {
        match self {
            Self::Plain(_) => None,
            Self::Packed(unpack) => Some(unpack.packed_next.load(Ordering::Relaxed)),
        }
    }
}

/// Unpacks a part of a file.
pub(crate) struct Unpack {
    input: Arc<Input>,
    packing: Packing,
    /// Offsets in the file of the packed bytes.
    range: Range<u64>,
    /// None before the first read. Behind a lock only since a cursor is shared; nobody ever waits for it.
    unpacker: Option<Mutex<Box<dyn Read + Send>>>,
    /// Unpacked offset of the unpacker.
    at: u64,
    /// Offset in the file of the next packed byte to read.
    packed_next: Arc<AtomicU64>,
    /// An error that came after good bytes: told at the next read.
    failed: Option<Error>,
}

impl fmt::Debug for Unpack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Unpack").field("packing", &self.packing).field("at", &self.at).finish_non_exhaustive()
    }
}

impl Unpack {
    /// Over the packed bytes of `range`.
    pub fn new(input: Arc<Input>, packing: Packing, range: Range<u64>) -> Self {
        let packed_next = Arc::new(AtomicU64::new(range.start));
        Self { input, packing, range, unpacker: None, at: 0, packed_next, failed: None }
    }

    fn fork(&self) -> Self {
        Self::new(self.input.clone(), self.packing, self.range.clone())
    }

    fn read_at(&mut self, offset: u64, buffer: &mut [u8]) -> Result<usize, Error> {
        if self.unpacker.is_none() || offset < self.at {
            self.restart()?;
        }
        let mut skipped = [0; 4096];
        while self.at < offset {
            let want = usize::try_from(offset - self.at).unwrap_or(usize::MAX).min(skipped.len());
            if self.read(&mut skipped[..want])? == 0 {
                return Ok(0);
            }
        }
        let mut len = 0;
        while len < buffer.len() {
            let read = self.read(&mut buffer[len..]);
            match read {
                Ok(0) => break,
                Ok(read) => len += read,
                Err(error) if len > 0 => {
                    self.failed = Some(error);
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        Ok(len)
    }

    fn restart(&mut self) -> Result<(), Error> {
        let Range { start, end } = self.range;
        self.packed_next.store(start, Ordering::Relaxed);
        (self.at, self.failed) = (0, None);
        let packed = Packed { input: self.input.clone(), next: self.packed_next.clone(), end };
        let unpacker = unpacker(self.packing, packed).ok_or_else(|| self.damaged("it cannot be begun"))?;
        self.unpacker = Some(Mutex::new(unpacker));
        Ok(())
    }

    /// What comes next; 0 bytes at the end.
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Error> {
        if let Some(failed) = self.failed.take() {
            return Err(failed);
        }
        let Some(unpacker) = &mut self.unpacker else { return Ok(0) };
        match unpacker.get_mut().unwrap_or_else(PoisonError::into_inner).read(buffer) {
            Ok(read) => {
                self.at += read as u64;
                Ok(read)
            }
            Err(source) => Err(self.failed(source)),
        }
    }

    fn failed(&self, source: std::io::Error) -> Error {
        if source.kind() == std::io::ErrorKind::UnexpectedEof {
            return self.damaged("it ends too early");
        }
        match source.downcast::<Error>() {
            Ok(error) => error,
            Err(source) => self.damaged(&source.to_string()),
        }
    }

    fn damaged(&self, why: &str) -> Error {
        let what = format!("holds {:?} data that cannot be unpacked ({why}),", self.packing);
        Error::new(ErrorKind::Malformed, self.input.path(), what, "copy it again from where it was recorded")
            .at(self.packed_next.load(Ordering::Relaxed))
    }
}

/// Packed bytes of a file as a stream.
struct Packed {
    input: Arc<Input>,
    next: Arc<AtomicU64>,
    end: u64,
}

impl Read for Packed {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let next = self.next.load(Ordering::Relaxed);
        let left = usize::try_from(self.end.saturating_sub(next)).unwrap_or(usize::MAX);
        let want = left.min(buffer.len());
        let read = self.input.read_at(next, &mut buffer[..want]).map_err(std::io::Error::other)?;
        self.next.store(next + read as u64, Ordering::Relaxed);
        Ok(read)
    }
}

/// Packs what is written.
pub(crate) enum Pack {
    /// Not at all.
    Plain,
    /// As one gzip member.
    Gzip(flate2::write::GzEncoder<Vec<u8>>),
    /// As one zstd frame.
    Zstd(zstd::stream::write::Encoder<'static, Vec<u8>>),
}

impl fmt::Debug for Pack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Plain => "Plain",
            Self::Gzip(_) => "Gzip",
            Self::Zstd(_) => "Zstd",
        })
    }
}

impl Pack {
    /// What packs like this; `None` where we do not.
    pub fn of(compression: Compression) -> Option<Self> {
        let zstd = |level| zstd::stream::write::Encoder::new(Vec::new(), level).ok().map(Self::Zstd);
        match compression {
            Compression::None => Some(Self::Plain),
            Compression::Gzip => {
                let level = flate2::Compression::default();
                Some(Self::Gzip(flate2::write::GzEncoder::new(Vec::new(), level)))
            }
            Compression::Zstd => zstd(3),
            Compression::ZstdHigh => zstd(12),
            _ => None,
        }
    }

    /// Packs bytes and writes what is ready.
    pub fn write(&mut self, bytes: &[u8], output: &mut Output) -> Result<(), Error> {
        // Into memory: it does not fail.
        let packed = match self {
            Self::Plain => return output.write(bytes),
            Self::Gzip(encoder) => encoder.write_all(bytes).map(|()| encoder.get_mut()),
            Self::Zstd(encoder) => encoder.write_all(bytes).map(|()| encoder.get_mut()),
        };
        let packed = packed.map_err(|source| Error::io(output.path(), "packing it", source))?;
        output.write(packed)?;
        packed.clear();
        Ok(())
    }

    /// Writes what is held back.
    pub fn finish(self, output: &mut Output) -> Result<(), Error> {
        let packed = match self {
            Self::Plain => return Ok(()),
            Self::Gzip(encoder) => encoder.finish(),
            Self::Zstd(encoder) => encoder.finish(),
        };
        let packed = packed.map_err(|source| Error::io(output.path(), "packing it", source))?;
        output.write(&packed)
    }
}
