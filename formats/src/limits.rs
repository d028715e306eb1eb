//! Bounds on every size that comes from a file.

/// The largest sizes a reader accepts from a file and the most memory it takes; beyond them it refuses, with
/// [`ErrorKind::TooLarge`](crate::ErrorKind::TooLarge), or makes do with less.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Limits {
    /// Longest header, in bytes. Default: 65536.
    pub header_bytes_max: usize,
    /// Widest and tallest sensor, in pixels. Default: 8192, at which a map of one u32 per pixel takes 256 MiB.
    pub sensor_side_px_max: u16,
    /// Most memory of a recording's index, in bytes: a longer recording gets a coarser index. Default: 4 MiB.
    pub index_bytes_max: usize,
    /// Largest packed chunk once unpacked, and largest message of frames, in bytes. Default: 32 MiB.
    pub chunk_bytes_max: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            header_bytes_max: 64 << 10,
            sensor_side_px_max: 8192,
            index_bytes_max: 4 << 20,
            chunk_bytes_max: 32 << 20,
        }
    }
}
