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
    /// What a filter takes.
    pub input: Vec<u8>,
    /// What it gives.
    output: Vec<u8>,
    inflate: deflate::Inflate,
    zstd: zstd::Zstd,
    block: Vec<u8>,
}

/// Bytes that a filter may add to a chunk: checksums.
const ADDED_BYTES_MAX: usize = 64;

impl Scratch {
    /// Undoes the filters of a chunk, which is in `input`, but those of `mask`, and puts it in `chunk`, which is of its
    /// length. `None` where the bytes contradict their format.
    pub fn undo(&mut self, filters: &[Filter], mask: u32, chunk: &mut Vec<u8>, len: usize) -> Option<()> {
        let used = |(i, filter): (usize, &Filter)| (mask >> i.min(31) & 1 == 0).then_some(*filter);
        let used = filters.iter().enumerate().rev().filter_map(used);
        for filter in used {
            self.one(filter, len + ADDED_BYTES_MAX)?;
            std::mem::swap(&mut self.input, &mut self.output);
        }
        std::mem::swap(&mut self.input, chunk);
        (chunk.len() >= len).then_some(())
    }

    /// Undoes one filter: from `input` to `output`, of `max` bytes at most, whose content before does not matter: to
    /// fill it with zeroes first would cost as much as some filters do.
    fn one(&mut self, filter: Filter, max: usize) -> Option<()> {
        let Self { input, output, inflate, zstd, block } = self;
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
