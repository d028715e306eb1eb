//! Frames of the pixels' levels: each pixel is read after its reset and after its exposure, and the frame is the
//! difference.
//!
//! Nothing marks where a frame begins: it does where a pixel's reset is read again. A global shutter reads all resets
//! before the first signal, and exposure starts with the last of them; a rolling shutter reads both side by side, and
//! exposure starts with the first.

use super::{Read, Records, Word};
use crate::{Error, Frame, PixelFormat};
use lobula_core::Geometry;
use std::ops::RangeInclusive;

/// Largest sensor whose pixels an address can tell.
const GEOMETRY_MAX: Geometry = Geometry::new(1024, 512);
/// A level has 10 bits and is given as the upper ones of 16.
const LEVEL_SHIFT: u32 = 6;
/// No level yet.
const NONE: u16 = u16::MAX;

/// Frames in file order; pixels that were not read twice are 0.
#[derive(Debug)]
pub(super) struct Frames {
    records: Records,
    geometry: Geometry,
    frame: Pending,
}

impl Frames {
    pub fn new(records: Records, geometry: Geometry) -> Self {
        let width = geometry.width.min(GEOMETRY_MAX.width);
        let height = geometry.height.min(GEOMETRY_MAX.height);
        Self { records, geometry: Geometry::new(width, height), frame: Pending::default() }
    }

    /// Adds a pixel's level; the frame before it, where a new one begins.
    fn add(&mut self, (x, y): (i64, i64), read: Read, level: u16, t: u64) -> Option<Frame> {
        let on_sensor = |at: i64, side: u16| u16::try_from(at).ok().filter(|at| *at < side);
        let x = on_sensor(x, self.geometry.width)?;
        let y = on_sensor(y, self.geometry.height)?;
        let pixel = usize::from(y) * usize::from(self.geometry.width) + usize::from(x);
        let again = read == Read::Reset && self.frame.resets.get(pixel).is_some_and(|level| *level != NONE);
        let done = if again { self.take() } else { None };
        if self.frame.resets.is_empty() {
            let pixels = usize::from(self.geometry.width) * usize::from(self.geometry.height);
            (self.frame.resets, self.frame.signals) = (vec![NONE; pixels], vec![NONE; pixels]);
        }
        self.frame.add(pixel, (x, y), read, level, t);
        done
    }

    /// The frame so far, if a pixel of it was read twice, and a new one.
    fn take(&mut self) -> Option<Frame> {
        let Pending { resets, signals, columns, rows, exposure } = std::mem::take(&mut self.frame);
        let (columns, rows) = (columns?, rows?);
        let level = |at: usize| match (resets.get(at), signals.get(at)) {
            (Some(&reset), Some(&signal)) if reset != NONE && signal != NONE => {
                Some(reset.saturating_sub(signal))
            }
            _ => None,
        };
        let mut pixels = Vec::new();
        let mut read_twice = false;
        for y in rows.clone() {
            for x in columns.clone() {
                let level = level(usize::from(y) * usize::from(self.geometry.width) + usize::from(x));
                read_twice |= level.is_some();
                pixels.extend_from_slice(&(level.unwrap_or_default() << LEVEL_SHIFT).to_le_bytes());
            }
        }
        let (start, end) = exposure.ends();
        read_twice.then(|| Frame {
            t: start,
            exposure: (start <= end).then_some(start..end),
            x: *columns.start(),
            y: *rows.start(),
            width: columns.end() - columns.start() + 1,
            height: rows.end() - rows.start() + 1,
            format: PixelFormat::Gray16,
            pixels,
        })
    }
}

impl Iterator for Frames {
    type Item = Result<Frame, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.records.next() {
                Some(Ok((Word::Pixel { x, y, read, level }, t))) => {
                    if let Some(frame) = self.add((x, y), read, level, t) {
                        return Some(Ok(frame));
                    }
                }
                Some(Ok(_)) => {}
                Some(Err(error)) => return Some(Err(error)),
                None => return self.take().map(Ok),
            }
        }
    }
}

/// A frame of which not all was read yet.
#[derive(Debug, Default)]
struct Pending {
    resets: Vec<u16>,
    signals: Vec<u16>,
    /// Of the pixels whose signal was read.
    columns: Option<RangeInclusive<u16>>,
    rows: Option<RangeInclusive<u16>>,
    exposure: Exposure,
}

impl Pending {
    fn add(&mut self, pixel: usize, (x, y): (u16, u16), read: Read, level: u16, t: u64) {
        let levels = match read {
            Read::Reset => &mut self.resets,
            Read::Signal => &mut self.signals,
        };
        if let Some(slot) = levels.get_mut(pixel) {
            *slot = level;
        }
        match read {
            Read::Reset => self.exposure.reset(t),
            Read::Signal => {
                self.exposure.signal(t);
                widen(&mut self.columns, x);
                widen(&mut self.rows, y);
            }
        }
    }
}

fn widen(range: &mut Option<RangeInclusive<u16>>, at: u16) {
    *range = Some(match range {
        Some(range) => at.min(*range.start())..=at.max(*range.end()),
        None => at..=at,
    });
}

/// Times of the reads.
#[derive(Debug, Default)]
struct Exposure {
    reset_first: Option<u64>,
    reset_last: Option<u64>,
    signal_first: Option<u64>,
    /// A reset came after a signal.
    rolling: bool,
}

impl Exposure {
    fn reset(&mut self, t: u64) {
        self.rolling |= self.signal_first.is_some();
        self.reset_first.get_or_insert(t);
        self.reset_last = Some(t);
    }

    fn signal(&mut self, t: u64) {
        self.signal_first.get_or_insert(t);
    }

    /// Start and end, of a frame with both kinds of reads.
    fn ends(&self) -> (u64, u64) {
        let start = if self.rolling { self.reset_first } else { self.reset_last };
        (start.unwrap_or_default(), self.signal_first.unwrap_or_default())
    }
}
