//! Filters that chunks went through when they were written, undone here: one file each.
//!
//! Numbers: <https://github.com/HDFGroup/hdf5_plugins/blob/master/docs/RegisteredFilterPlugins.md>

mod blosc;
mod blosclz;
mod deflate;
mod ecf;
mod fletcher32;
mod lz4;
mod lzf;
mod pack;
mod shuffle;
mod zstd;

pub(super) use pack::{Codec, Pack};

/// A filter with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Filter {
    Deflate,
    /// Of elements of this many bytes.
    Shuffle(usize),
    Fletcher32,
    Lzf,
    Blosc,
    Lz4,
    Zstd,
    /// Prophesee's codec of events.
    Ecf,
}

/// Filters by number that are refused by name.
const REFUSED: &[(u16, &str)] = &[
    (4, "szip"),
    (5, "n-bit"),
    (6, "scale-offset"),
    (307, "bzip2"),
    (32008, "bitshuffle"),
    (32013, "ZFP"),
    (32019, "JPEG"),
    (32023, "SZ"),
    (32026, "Blosc2"),
];

impl Filter {
    /// The filter of this number, or the name of one that is not undone here.
    pub fn new(number: u16, values: &[u32]) -> Result<Self, String> {
        Ok(match number {
            1 => Self::Deflate,
            2 => Self::Shuffle(values.first().map_or(1, |bytes| *bytes as usize)),
            3 => Self::Fletcher32,
            32000 => Self::Lzf,
            // The seventh is the compressor, and its second is Snappy.
            32001 if values.get(6) == Some(&3) => return Err("Blosc with Snappy".to_owned()),
            32001 => Self::Blosc,
            32004 => Self::Lz4,
            32015 => Self::Zstd,
            0x8ECF => Self::Ecf,
            _ => {
                let known = REFUSED.iter().find(|(refused, _)| *refused == number);
                return Err(known.map_or(format!("the filter {number}"), |(_, name)| (*name).to_owned()));
            }
        })
    }
}

/// What filters keep between chunks, so that nothing is allocated for each.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// What a filter takes, at its start.
    input: Vec<u8>,
    /// What it gives, where another takes it.
    output: Vec<u8>,
    inflate: deflate::Inflate,
    zstd: zstd::Zstd,
    block: Vec<u8>,
}

/// Bytes that a filter may add to a chunk: checksums.
const ADDED_BYTES_MAX: usize = 64;

impl Scratch {
    /// Memory for a chunk as it is stored, in so many bytes.
    pub fn stored(&mut self, bytes: usize) -> &mut [u8] {
        room(&mut self.input, bytes)
    }

    /// Undoes the filters of a chunk, which is [`stored`](Self::stored) in so many bytes, but those of `mask`, of
    /// which one at least is left, and puts it at the start of `chunk`, in `len` bytes. `None` where the bytes
    /// contradict their format.
    pub fn undo(
        &mut self,
        filters: &[Filter],
        mask: u32,
        stored: usize,
        chunk: &mut Vec<u8>,
        len: usize,
    ) -> Option<()> {
        let used = |(i, filter): (usize, &Filter)| (mask >> i.min(31) & 1 == 0).then_some(*filter);
        let mut used = filters.iter().enumerate().rev().filter_map(used).peekable();
        let mut bytes = stored;
        while let Some(filter) = used.next() {
            let is_last = used.peek().is_none();
            bytes = self.one(filter, bytes, is_last.then_some(&mut *chunk), len + ADDED_BYTES_MAX)?;
            std::mem::swap(&mut self.input, &mut self.output);
        }
        (bytes >= len).then_some(())
    }

    /// Undoes one filter, from the first bytes of `input` to `chunk` or else `output`; to how many bytes, `max` at
    /// most.
    fn one(
        &mut self,
        filter: Filter,
        bytes: usize,
        chunk: Option<&mut Vec<u8>>,
        max: usize,
    ) -> Option<usize> {
        let Self { input, output, inflate, zstd, block } = self;
        let (input, output) = (input.get(..bytes)?, chunk.unwrap_or(output));
        match filter {
            Filter::Deflate => inflate.undo(input, output, max),
            Filter::Shuffle(element) => shuffle::undo(input, output, element),
            Filter::Fletcher32 => fletcher32::undo(input, output),
            Filter::Lzf => lzf::undo(input, output, max),
            Filter::Blosc => blosc::undo(input, output, max, block, inflate, zstd),
            Filter::Lz4 => lz4::undo(input, output, max),
            Filter::Zstd => zstd.undo(input, output, max),
            Filter::Ecf => ecf::undo(input, output, max),
        }
    }
}

/// So many bytes at the start of memory that is never made shorter: to fill it with zeroes for every chunk would cost
/// as much as some filters do.
pub(super) fn room(memory: &mut Vec<u8>, bytes: usize) -> &mut [u8] {
    if memory.len() < bytes {
        memory.resize(bytes, 0);
    }
    let (room, _) = memory.split_at_mut(bytes);
    room
}
