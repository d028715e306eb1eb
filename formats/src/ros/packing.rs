//! How chunks are packed, and how they are unpacked in bounded memory whatever they claim.

use crate::Error;
use crate::input::Input;
use std::io::{self, Read, Write};
use std::ops::Range;
use std::sync::Arc;

/// Memory a packed chunk gets before any of it is unpacked.
const FIRST_BYTES: usize = 1 << 20;
/// Bytes read from the file at once.
const READ_BYTES: usize = 32 << 10;
/// Largest window of Zstandard, as a power of 2: that of our largest chunks.
const ZSTD_WINDOW_LOG_MAX: u32 = 25;
/// How hard Zstandard packs: its own default.
const ZSTD_LEVEL: i32 = 3;

/// How a chunk is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    Plain,
    Bz2,
    Lz4,
    Zstd,
}

impl Packing {
    /// That of this name in a bag; an empty name is none, as MCAP has it.
    pub fn from_name(name: &[u8]) -> Option<Self> {
        match name {
            b"" | b"none" => Some(Self::Plain),
            b"bz2" => Some(Self::Bz2),
            b"lz4" => Some(Self::Lz4),
            b"zstd" => Some(Self::Zstd),
            _ => None,
        }
    }

    /// Its name in a bag.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "none",
            Self::Bz2 => "bz2",
            Self::Lz4 => "lz4",
            Self::Zstd => "zstd",
        }
    }

    /// Packs a chunk.
    pub fn pack(self, bytes: &[u8]) -> io::Result<Vec<u8>> {
        match self {
            Self::Plain => Ok(bytes.to_vec()),
            Self::Bz2 => {
                let mut packer = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::default());
                packer.write_all(bytes)?;
                packer.finish()
            }
            Self::Lz4 => {
                // Of a file that is cut, whole blocks can be read: small ones, then.
                let block = lz4_flex::frame::BlockSize::Max64KB;
                let info = lz4_flex::frame::FrameInfo::new().content_checksum(true).block_size(block);
                let mut packer = lz4_flex::frame::FrameEncoder::with_frame_info(info, Vec::new());
                packer.write_all(bytes)?;
                packer.finish().map_err(io::Error::from)
            }
            Self::Zstd => zstd::stream::encode_all(bytes, ZSTD_LEVEL),
        }
    }
}

/// A chunk as it is in the file.
#[derive(Clone, Debug)]
pub(crate) struct Packed {
    pub packing: Packing,
    /// Offsets of its data; the end may lie behind the end of a file that was cut.
    pub range: Range<u64>,
    /// CRC-32 of what it holds, where the file tells it.
    pub crc: Option<u32>,
}

/// What came of unpacking.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unpacked {
    Whole,
    /// The file ends inside it: these many bytes are good as far as can be known.
    Cut(usize),
    /// It breaks its format, or holds something else than it says.
    Damaged,
}

impl Packed {
    /// Unpacks `bytes` bytes to the front of `out`, which grows only as they come.
    pub fn unpack(&self, input: &Arc<Input>, bytes: usize, out: &mut Vec<u8>) -> Result<Unpacked, Error> {
        let mut packed = PackedBytes { input, range: self.range.clone(), failed: None };
        let source = io::BufReader::with_capacity(READ_BYTES, &mut packed);
        let (len, ended) = match self.packing {
            Packing::Plain => read_all(source, bytes, out),
            Packing::Bz2 => read_all(bzip2::bufread::BzDecoder::new(source), bytes, out),
            Packing::Lz4 => read_all(lz4_flex::frame::FrameDecoder::new(source), bytes, out),
            Packing::Zstd => match zstd::stream::read::Decoder::with_buffer(source) {
                Ok(mut decoder) => match decoder.window_log_max(ZSTD_WINDOW_LOG_MAX) {
                    Ok(()) => read_all(decoder, bytes, out),
                    Err(_) => (0, false),
                },
                Err(_) => (0, false),
            },
        };
        if let Some(failed) = packed.failed {
            return Err(failed);
        }
        if len < bytes || !ended {
            let cut = self.range.end > input.len();
            return Ok(if cut { Unpacked::Cut(len) } else { Unpacked::Damaged });
        }
        let good = self.crc.is_none_or(|crc| crc32fast::hash(out.get(..len).unwrap_or_default()) == crc);
        Ok(if good { Unpacked::Whole } else { Unpacked::Damaged })
    }
}

impl Packed {
    /// Whether a plain chunk of `bytes` bytes is what its checksum says, read in pieces: for one too long to be held.
    pub fn has_crc(&self, input: &Input, bytes: u64) -> Result<bool, Error> {
        let (mut at, mut crc) = (self.range.start, crc32fast::Hasher::new());
        let mut piece = vec![0; READ_BYTES];
        while at < self.range.end {
            let left = usize::try_from(self.range.end - at).unwrap_or(usize::MAX);
            let len = input.read_at(at, piece.get_mut(..left.min(READ_BYTES)).unwrap_or_default())?;
            crc.update(piece.get(..len).unwrap_or_default());
            at += len as u64;
        }
        let good = self.crc.is_none_or(|told| told == crc.finalize());
        Ok(good && bytes == self.range.end - self.range.start)
    }
}

/// Fills the first `bytes` of `out`; how many there were before the end or an error, and whether the end is good: only
/// there are checksums compared.
fn read_all(mut source: impl Read, bytes: usize, out: &mut Vec<u8>) -> (usize, bool) {
    let mut len = 0;
    while len < bytes {
        if out.len() == len {
            let more = out.len().max(FIRST_BYTES).min(bytes - len);
            out.reserve_exact(more);
            out.resize(len + more, 0);
        }
        let end = out.len().min(bytes);
        match source.read(out.get_mut(len..end).unwrap_or_default()) {
            Ok(0) | Err(_) => return (len, false),
            Ok(read) => len += read,
        }
    }
    (len, matches!(source.read(&mut [0]), Ok(0)))
}

/// The bytes of a chunk in the file.
struct PackedBytes<'a> {
    input: &'a Input,
    range: Range<u64>,
    /// Why the file could not be read, which is not the fault of the bytes in it.
    failed: Option<Error>,
}

impl Read for PackedBytes<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = usize::try_from(self.range.end - self.range.start).unwrap_or(usize::MAX);
        let want = left.min(buffer.len());
        let len = self.input.read_at(self.range.start, buffer.get_mut(..want).unwrap_or_default());
        let len = len.map_err(|error| {
            self.failed = Some(error);
            io::Error::other("see `failed`")
        })?;
        self.range.start += len as u64;
        Ok(len)
    }
}
