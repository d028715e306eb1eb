//! Compression of packets: each is one LZ4 or ZSTD frame, or plain.
//!
//! Spec: <https://github.com/lz4/lz4/blob/dev/doc/lz4_Frame_format.md>
//!
//! LZ4 frames are taken apart here, so that blocks go straight to their place in the packet, and so that a frame that
//! is cut gives its whole blocks.

use crate::Compression;
use crate::packets::Unpacking;
use lz4_flex::block;
use zstd::zstd_safe::{self, CCtx, CParameter, DCtx, InBuffer, OutBuffer};

const LZ4_MAGIC: [u8; 4] = [0x04, 0x22, 0x4D, 0x18];
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xB5, 0x2F, 0xFD];
/// Flags and block size of the LZ4 frames that we write (blocks of 64 KiB, each on its own), and their check byte.
const LZ4_DESCRIPTOR: [u8; 3] = [0x60, 0x40, 0x82];
const LZ4_BLOCK_BYTES: usize = 64 << 10;
/// How far back a block of a linked frame refers.
const LZ4_WINDOW_BYTES: usize = 64 << 10;
/// Bit of a block's size that says that it is not compressed.
const LZ4_PLAIN: u32 = 1 << 31;
/// Least memory that a frame of unknown size is given at first.
const UNKNOWN_BYTES: usize = 256 << 10;

/// The values of the header, in order.
pub(super) const ALL: [Compression; 5] =
    [Compression::None, Compression::Lz4, Compression::Lz4High, Compression::Zstd, Compression::ZstdHigh];

/// Name in the header's tree.
pub(super) const fn name(compression: Compression) -> &'static str {
    match compression {
        Compression::Lz4 => "LZ4",
        Compression::Lz4High => "LZ4_HIGH",
        Compression::Zstd => "ZSTD",
        Compression::ZstdHigh => "ZSTD_HIGH",
        _ => "NONE",
    }
}

/// Whether bytes begin a compressed frame.
pub(super) fn is_compressed(bytes: &[u8]) -> bool {
    bytes.starts_with(&LZ4_MAGIC) || bytes.starts_with(&ZSTD_MAGIC)
}

/// Memory to unpack into, used again for every packet.
#[derive(Default)]
pub(super) struct Unpacker {
    bytes: Vec<u8>,
    zstd: Option<DCtx<'static>>,
}

impl std::fmt::Debug for Unpacker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Unpacker").field("bytes", &self.bytes.len()).finish_non_exhaustive()
    }
}

impl Unpacker {
    /// Unpacks a frame; of one that is `cut`, what is whole. Tells how long it is.
    pub fn unpack(&mut self, frame: &[u8], cut: bool, limit: usize) -> Result<usize, Unpacking> {
        match frame.first_chunk() {
            Some(&LZ4_MAGIC) => self.lz4(frame.get(LZ4_MAGIC.len()..).unwrap_or_default(), cut, limit),
            Some(&ZSTD_MAGIC) if cut => self.zstd_cut(frame, limit),
            Some(&ZSTD_MAGIC) => self.zstd(frame, limit),
            _ => Err(Unpacking::Damaged),
        }
    }

    /// The first bytes of what was unpacked.
    pub fn bytes(&self, len: usize) -> &[u8] {
        self.bytes.get(..len).unwrap_or_default()
    }

    fn reserve(&mut self, bytes: usize) {
        if self.bytes.len() < bytes {
            self.bytes.resize(bytes, 0);
        }
    }

    fn lz4(&mut self, frame: &[u8], cut: bool, limit: usize) -> Result<usize, Unpacking> {
        let mut frame = Lz4Frame::begin(frame).ok_or(Unpacking::Damaged)?;
        let mut len = 0;
        loop {
            let block = match frame.block() {
                Some(Some(block)) => block,
                Some(None) => return Ok(len),
                None if cut => return Ok(len),
                None => return Err(Unpacking::Damaged),
            };
            if len > limit {
                return Err(Unpacking::TooLarge);
            }
            self.reserve(len + frame.block_bytes);
            let (done, free) = self.bytes.split_at_mut(len);
            let free = free.get_mut(..frame.block_bytes).ok_or(Unpacking::Damaged)?;
            let window = match frame.linked {
                true => done.get(len.saturating_sub(LZ4_WINDOW_BYTES)..).unwrap_or_default(),
                false => &[],
            };
            len += match block {
                Block::Plain(bytes) => {
                    free.get_mut(..bytes.len()).ok_or(Unpacking::Damaged)?.copy_from_slice(bytes);
                    bytes.len()
                }
                Block::Packed(bytes) => {
                    block::decompress_into_with_dict(bytes, free, window).map_err(|_| Unpacking::Damaged)?
                }
            };
        }
    }

    fn zstd(&mut self, frame: &[u8], limit: usize) -> Result<usize, Unpacking> {
        let known = zstd_safe::get_frame_content_size(frame).map_err(|_| Unpacking::Damaged)?;
        let mut room = match known {
            Some(bytes) => usize::try_from(bytes).unwrap_or(usize::MAX),
            None => self.bytes.len().max(UNKNOWN_BYTES),
        };
        loop {
            if known.is_some() && room > limit {
                return Err(Unpacking::TooLarge);
            }
            room = room.min(limit);
            self.reserve(room);
            let context = self.zstd.get_or_insert_with(DCtx::create);
            let code = match context.decompress(&mut self.bytes[..], frame) {
                Ok(len) => return if len <= limit { Ok(len) } else { Err(Unpacking::TooLarge) },
                Err(code) => code,
            };
            if zstd_safe::get_error_name(code) != TOO_SMALL || known.is_some() {
                return Err(Unpacking::Damaged);
            }
            if room >= limit {
                return Err(Unpacking::TooLarge);
            }
            room = self.bytes.len().saturating_mul(2);
        }
    }

    fn zstd_cut(&mut self, frame: &[u8], limit: usize) -> Result<usize, Unpacking> {
        let mut context = DCtx::create();
        let mut input = InBuffer::around(frame);
        let mut len = 0;
        loop {
            self.reserve(len + UNKNOWN_BYTES);
            let mut output = OutBuffer::around_pos(&mut self.bytes[..], len);
            let before = (input.pos(), len);
            // At damage what came before it is kept, as at the end.
            let more = context.decompress_stream(&mut output, &mut input);
            len = output.pos();
            if more.is_err() || (input.pos(), len) == before || len >= limit {
                return Ok(len);
            }
        }
    }
}

/// What zstd says where it needs more room.
const TOO_SMALL: &str = "Destination buffer is too small";

/// An LZ4 frame from its first block on.
struct Lz4Frame<'a> {
    rest: &'a [u8],
    /// Blocks refer to those before them.
    linked: bool,
    /// Each block is followed by a checksum.
    checked: bool,
    /// The longest block, unpacked.
    block_bytes: usize,
}

enum Block<'a> {
    Plain(&'a [u8]),
    Packed(&'a [u8]),
}

impl<'a> Lz4Frame<'a> {
    /// After the magic number.
    fn begin(bytes: &'a [u8]) -> Option<Self> {
        let [flags, size, rest @ ..] = bytes else { return None };
        // Version 1, no dictionary that is elsewhere.
        if flags >> 6 != 1 || flags & 1 != 0 {
            return None;
        }
        let block_bytes = match size >> 4 & 7 {
            size @ 4..=7 => 1 << (8 + 2 * size),
            _ => return None,
        };
        let size_of_content = if flags & 8 != 0 { 8 } else { 0 };
        let rest = rest.get(size_of_content + 1..)?;
        Some(Self { rest, linked: flags & 0x20 == 0, checked: flags & 0x10 != 0, block_bytes })
    }

    /// The next block, or none at the mark of the end; `None` where the bytes end before.
    fn block(&mut self) -> Option<Option<Block<'a>>> {
        let (size, rest) = self.rest.split_first_chunk()?;
        let size = u32::from_le_bytes(*size);
        if size == 0 {
            return Some(None);
        }
        let (block, rest) = rest.split_at_checked(usize::try_from(size & !LZ4_PLAIN).ok()?)?;
        self.rest = rest.get(if self.checked { 4 } else { 0 }..)?;
        Some(Some(if size & LZ4_PLAIN != 0 { Block::Plain(block) } else { Block::Packed(block) }))
    }
}

/// Levels of ZSTD that are written: DV's default, and one at which it costs a tenth of the speed.
const ZSTD_LEVEL: i32 = 3;
const ZSTD_LEVEL_HIGH: i32 = 12;

/// Packs packets, in memory used again for every one.
pub(super) struct Packer {
    compression: Compression,
    bytes: Vec<u8>,
    zstd: Option<CCtx<'static>>,
}

impl std::fmt::Debug for Packer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Packer").field("compression", &self.compression).finish_non_exhaustive()
    }
}

impl Packer {
    pub fn new(compression: Compression) -> Self {
        Self { compression, bytes: Vec::new(), zstd: None }
    }

    /// The frame of these bytes, or they themselves where nothing is compressed. LZ4 has one strength here: a file
    /// that is to be highly compressed by it is an ordinary one that says so.
    pub fn pack<'a>(&'a mut self, plain: &'a [u8]) -> &'a [u8] {
        match self.compression {
            Compression::Lz4 | Compression::Lz4High => self.lz4(plain),
            Compression::Zstd => self.zstd(plain, ZSTD_LEVEL),
            Compression::ZstdHigh => self.zstd(plain, ZSTD_LEVEL_HIGH),
            _ => plain,
        }
    }

    fn lz4(&mut self, plain: &[u8]) -> &[u8] {
        self.bytes.clear();
        self.bytes.extend_from_slice(&LZ4_MAGIC);
        self.bytes.extend_from_slice(&LZ4_DESCRIPTOR);
        for block in plain.chunks(LZ4_BLOCK_BYTES) {
            let at = self.bytes.len();
            let room = block::get_maximum_output_size(block.len());
            self.bytes.resize(at + 4 + room, 0);
            let packed = block::compress_into(block, &mut self.bytes[at + 4..]).unwrap_or(usize::MAX);
            let size = if packed < block.len() {
                packed as u32
            } else {
                self.bytes[at + 4..at + 4 + block.len()].copy_from_slice(block);
                block.len() as u32 | LZ4_PLAIN
            };
            self.bytes[at..at + 4].copy_from_slice(&size.to_le_bytes());
            self.bytes.truncate(at + 4 + (size & !LZ4_PLAIN) as usize);
        }
        self.bytes.extend_from_slice(&[0; 4]);
        &self.bytes
    }

    /// Room for every packet is given, so that packing cannot fail; were it to, an empty packet would be read as
    /// damaged.
    fn zstd(&mut self, plain: &[u8], level: i32) -> &[u8] {
        self.bytes.resize(zstd_safe::compress_bound(plain.len()), 0);
        let context = self.zstd.get_or_insert_with(|| {
            let mut context = CCtx::create();
            let _ = context.set_parameter(CParameter::CompressionLevel(level));
            context
        });
        let len = context.compress2(&mut self.bytes[..], plain).unwrap_or_default();
        &self.bytes[..len]
    }
}
