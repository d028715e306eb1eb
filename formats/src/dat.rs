//! Prophesee DAT: a text header, two bytes, then events of eight bytes.
//!
//! Spec: <https://docs.prophesee.ai/stable/data/file_formats/dat.html>; version 1 by Prophesee's `load_atis_data.m`
//!
//! ```text
//! % Data file containing CD events.      lines of `% key value`; of them we read Version, Width and Height
//! % Version 2
//! u8 type: 0 or 12 (CD)   u8 size: 8     without any header: neither
//! u32 t in µs, wraps     u32:  version 1  y: bits 9..16   x: bits 0..8    p: bit 17
//!                              version 2  y: bits 14..27  x: bits 0..13   p: bit 28
//! ```

use crate::byte_cursor::{Bad, ByteCursor, ByteDecoder, Step};
use crate::container::{Container, Cursor, Piece};
use crate::input::Input;
use crate::intake::{Intake, Plain, Taken};
use crate::open::Probe;
use crate::raw::header::Header;
use crate::wrap::Wrap32;
use crate::{Error, ErrorKind, Format, OpenOptions};
use lobula_core::{Counters, Geometry, Sink};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

mod write;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format =
    Format { name: "Prophesee DAT", extensions: &["dat"], create: Some(write::create), probe, open };

/// Largest sensor that fourteen bits of x and y can tell.
const GEOMETRY_MAX: Geometry = Geometry::new(1 << 14, 1 << 14);
/// Bytes of an event.
const EVENT_BYTES: usize = 8;
/// Type of the events that are brightness changes ("contrast detection"), and the one that older files give them.
const CD: u8 = 12;
const CD_OLD: u8 = 0;
/// Type of edges on trigger inputs, which are in files of their own.
const TRIGGER: u8 = 14;
/// Events looked at to tell the version, where the header does not.
const SAMPLE: usize = 4096;

fn probe(Probe { head, .. }: &Probe<'_>) -> bool {
    head.starts_with(b"% Data file")
        || head.starts_with(b"% ") && {
            let has = |key: &[u8]| head.split(|byte| *byte == b'\n').any(|line| line.starts_with(key));
            has(b"% Version ") && !has(b"% evt ") && !has(b"% format ")
        }
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let (limits, path) = (&options.limits, input.path());
    let mut head = vec![0; limits.header_bytes_max.min(usize::try_from(input.len()).unwrap_or(usize::MAX))];
    let len = input.read_at(0, &mut head)?;
    head.truncate(len);
    let header = Header::parse(&head, input.len(), path, limits)?;
    check_type(&input, header.bytes())?;
    let start = header.bytes() + 2;
    let mut sample = vec![0; SAMPLE * EVENT_BYTES];
    let len = input.read_at(start, &mut sample)?;
    let (layout, guessed) = match layout(&header, path)? {
        Some(layout) => (layout, false),
        None => (layout_of(&sample[..len]), true),
    };
    let geometry = match (options.sensor_size, header.get("Width"), header.get("Height")) {
        (Some(size), ..) => Some(size),
        (None, Some(width), Some(height)) => {
            Some(header.size_of(&format!("{width}x{height}"), "Height", path, limits)?)
        }
        _ => None,
    };
    let intake = Intake::new(geometry.unwrap_or(GEOMETRY_MAX), options);
    let decoder = Decoder { layout, intake, wrap: Wrap32::default(), in_piece: false, in_the_dark: false };
    Ok(Box::new(DatRecording { input, header, geometry, start, decoder, guessed }))
}

/// The two bytes after the header must say what we read.
fn check_type(input: &Input, offset: u64) -> Result<(), Error> {
    let mut bytes = [0; 2];
    let cut = input.read_at(offset, &mut bytes)? < bytes.len();
    let [kind, size] = bytes;
    let refuse = |error, what: String, remedy| Err(Error::new(error, input.path(), what, remedy).at(offset));
    match kind {
        _ if cut => {
            let what = "ends inside its header".to_owned();
            refuse(ErrorKind::Malformed, what, "copy it again from where it was recorded")
        }
        CD | CD_OLD if usize::from(size) == EVENT_BYTES => Ok(()),
        CD | CD_OLD => {
            let what = format!("says that its events have {size} bytes, not {EVENT_BYTES},");
            refuse(ErrorKind::Malformed, what, "copy it again from where it was recorded")
        }
        TRIGGER => {
            let what = "holds edges of trigger inputs (type 14) and no events,".to_owned();
            refuse(ErrorKind::Unsupported, what, "open the file of events that was recorded beside it")
        }
        _ => {
            let what = format!("holds records of type {kind}, and events are of type {CD} or {CD_OLD},");
            refuse(ErrorKind::Unsupported, what, "open a file of events")
        }
    }
}

/// The layout by the header's version, if it tells one.
fn layout(header: &Header, path: &Path) -> Result<Option<Layout>, Error> {
    match header.get("Version") {
        None => Ok(None),
        Some("0" | "1") => Ok(Some(V1)),
        Some("2") => Ok(Some(V2)),
        Some(other) => {
            let what = format!("is of version {other}, and versions 1 and 2 are read");
            Err(Error::new(ErrorKind::Unsupported, path, what, "convert it to version 2"))
        }
    }
}

/// The layout by the events: what has bits beyond those of version 1 is version 2.
fn layout_of(sample: &[u8]) -> Layout {
    let beyond = |event: &[u8; EVENT_BYTES]| u64::from_le_bytes(*event) >> 50 != 0;
    if sample.as_chunks().0.iter().any(beyond) { V2 } else { V1 }
}

/// Where x, y and p are in an event, read as one little-endian word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    x_mask: u64,
    /// How far y is below its place in an [`Event`](lobula_core::Event).
    y_shift: u32,
    y_mask: u64,
    p_bit: u32,
}

const V1: Layout = Layout { x_mask: 0x1FF << 32, y_shift: 7, y_mask: 0xFF << 48, p_bit: 49 };
const V2: Layout = Layout { x_mask: 0x3FFF << 32, y_shift: 2, y_mask: 0x3FFF << 48, p_bit: 60 };

impl Layout {
    #[inline(always)]
    const fn pixel(self, word: u64) -> u64 {
        word & self.x_mask | word << self.y_shift & self.y_mask | word >> self.p_bit & 1
    }
}

#[derive(Debug)]
struct DatRecording {
    input: Arc<Input>,
    header: Header,
    geometry: Option<Geometry>,
    /// Offset of the first event.
    start: u64,
    /// At the first event.
    decoder: Decoder,
    /// Whether the version is known by the events alone.
    guessed: bool,
}

impl Container for DatRecording {
    fn geometry(&self) -> Option<Geometry> {
        self.geometry
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.decoder.intake.geometry()
    }

    fn fields(&self) -> Vec<(&str, &str)> {
        self.header.fields().collect()
    }

    fn warnings(&self) -> Vec<String> {
        let version = if self.decoder.layout == V1 { 1 } else { 2 };
        let warning = || format!("the header does not tell the version; by its events it is {version}");
        self.guessed.then(warning).into_iter().collect()
    }

    fn start(&self) -> Box<dyn Cursor> {
        let range = self.start..self.input.len();
        Box::new(ByteCursor::new(self.input.clone(), range, self.decoder.clone()))
    }

    /// As many events each. With times that are shifted in one: which of them are before 0 is known only from the start.
    fn pieces(&self, n: usize) -> Result<Vec<Piece>, Error> {
        let range = self.start..self.input.len();
        let events = range.end.saturating_sub(range.start) / EVENT_BYTES as u64;
        let n = if self.decoder.intake.shift_us() == 0 { n.max(1) as u64 } else { 1 };
        let each = events.div_ceil(n).max(1);
        let later = (1..n).map(|i| i * each).take_while(|event| *event < events);
        let starts: Vec<_> =
            [0].into_iter().chain(later).map(|event| range.start + event * EVENT_BYTES as u64).collect();
        let ends = starts.iter().copied().skip(1).chain([range.end]);
        starts.iter().zip(ends).map(|(start, end)| self.piece(*start..end)).collect()
    }
}

impl DatRecording {
    fn piece(&self, range: Range<u64>) -> Result<Piece, Error> {
        let (mut decoder, mut wrap_us) = (self.decoder.clone(), 0);
        if range.start > self.start {
            let mut before = [0; 4];
            self.input.read_at(range.start - EVENT_BYTES as u64, &mut before)?;
            (decoder.wrap, decoder.in_piece) = (Wrap32::after(u32::from_le_bytes(before)), true);
            wrap_us = Wrap32::RANGE;
        }
        Ok(Piece { cursor: Box::new(ByteCursor::new(self.input.clone(), range, decoder)), wrap_us })
    }
}

#[derive(Clone, Debug)]
struct Decoder {
    layout: Layout,
    intake: Intake,
    wrap: Wrap32,
    /// Whether it began [after](Wrap32::after) other events.
    in_piece: bool,
    in_the_dark: bool,
}

/// Events decoded at once where all are alike.
const BATCH: usize = 512;
/// Bits of an event that tell its time.
const TIME: u64 = u32::MAX as u64;

impl Decoder {
    /// Whether a time is below all that this piece can tell.
    fn is_dark(&self, t_us: u64) -> bool {
        self.in_piece && t_us < Wrap32::RANGE
    }

    /// Takes all of the events, where they are near each other in time and on the sensor; else none of them.
    fn take_alike(&mut self, events: &[[u8; EVENT_BYTES]], sink: &mut Sink<'_>) -> bool {
        let (Some(first), Some(last)) = (events.first(), events.last()) else { return false };
        let word = |event: &[u8; EVENT_BYTES]| u64::from_le_bytes(*event);
        // None that is near the first in the same round of the 32 bits is in another.
        let round = { self.wrap }.push(word(first) as u32) & !TIME;
        if self.is_dark(round) {
            return false;
        }
        let t_us = move |word: u64| round | word & TIME;
        let ends = [first, last].map(|event| t_us(word(event)) as i64);
        let (ends, events, bytes) = ((ends[0], ends[1]), events.iter(), EVENT_BYTES as u64);
        let plain = move |layout: Layout, word| Plain { t_us: t_us(word), pixel: layout.pixel(word) };
        // Not by the layout at hand: one that is known when this is compiled costs a third less.
        let taken = match self.layout {
            V1 => self.intake.push_alike(sink, bytes, ends, events, move |event| plain(V1, word(event))),
            _ => self.intake.push_alike(sink, bytes, ends, events, move |event| plain(V2, word(event))),
        };
        if taken {
            self.wrap.set(t_us(word(last)));
        }
        taken
    }

    /// Takes events one by one; how many before the sink was full.
    fn take_each(&mut self, events: &[[u8; EVENT_BYTES]], sink: &mut Sink<'_>) -> Result<usize, Bad> {
        for (i, event) in events.iter().enumerate() {
            let word = u64::from_le_bytes(*event);
            let pixel = self.layout.pixel(word);
            let xy = ((pixel >> 32 & 0xFFFF) as i64, (pixel >> 48) as i64);
            let mut wrap = self.wrap;
            let t = wrap.push(word as u32);
            let taken = self.intake.push(sink, t as i64, xy, pixel & 1 != 0, EVENT_BYTES as u64);
            if taken.map_err(|bad| Bad { offset: i * EVENT_BYTES, ..bad })? == Taken::Full {
                return Ok(i);
            }
            self.wrap = wrap;
            self.in_the_dark |= self.is_dark(t);
        }
        Ok(events.len())
    }
}

impl ByteDecoder for Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        let (events, _) = bytes.as_chunks::<EVENT_BYTES>();
        let mut done = 0;
        while done < events.len() {
            let batch = &events[done..events.len().min(done + BATCH)];
            let taken = if self.take_alike(batch, sink) {
                batch.len()
            } else {
                let at = |bad: Bad| Bad { offset: done * EVENT_BYTES + bad.offset, ..bad };
                self.take_each(batch, sink).map_err(at)?
            };
            done += taken;
            if taken < batch.len() {
                return Ok(Step { taken: done * EVENT_BYTES, full: true });
            }
        }
        Ok(Step { taken: done * EVENT_BYTES, full: false })
    }

    fn finish(&mut self, unread: &[u8]) {
        self.intake.cut_short(unread);
    }

    fn counters(&self) -> Counters {
        self.intake.counters
    }

    fn now(&self) -> u64 {
        self.wrap.last()
    }

    fn in_the_dark(&self) -> bool {
        self.in_the_dark
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Recording, open_with};
    use lobula_core::full_time;

    /// A file of these bytes, opened.
    fn file(
        header: &str,
        kind: [u8; 2],
        words: &[[u32; 2]],
        options: &OpenOptions,
    ) -> Result<Recording, Error> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dat");
        let words = words.as_flattened().iter().flat_map(|word| word.to_le_bytes());
        let bytes: Vec<u8> = header.bytes().chain(kind).chain(words).collect();
        std::fs::write(&path, bytes).unwrap();
        open_with(&path, options)
    }

    /// Every event as `t x y p`.
    fn said(recording: &Recording) -> Vec<String> {
        let (mut blocks, mut said) = (recording.blocks(), Vec::new());
        while let Some(chunk) = blocks.next_block().unwrap() {
            let span = chunk.span();
            said.extend(span.events.iter().map(|event| {
                let t = full_time(span.t_first, event.t());
                format!("{t} {} {} {}", event.x(), event.y(), u8::from(event.is_on()))
            }));
        }
        said
    }

    #[track_caller]
    fn check(header: &str, words: &[[u32; 2]], size: Option<Geometry>, expected: &[&str]) {
        let recording = file(header, [12, 8], words, &OpenOptions::default()).unwrap();
        assert_eq!(recording.geometry(), size);
        assert_eq!(said(&recording), expected, "{header:?}");
    }

    const HEAD: &str = "% Data file containing CD events.\n";

    #[test]
    fn both_versions() {
        let v1 = (1 << 17) | (239 << 9) | 303;
        let v2 = (1 << 28) | (719 << 14) | 1279;
        check(&format!("{HEAD}% Version 1\n"), &[[5, v1], [6, 3]], None, &["5 303 239 1", "6 3 0 0"]);
        let sized = format!("{HEAD}% Version 2\n% Date 2026-01-02 3:4:5\n% Height 720\n% Width 1280\n");
        check(&sized, &[[5, v2], [6, 3]], Some(Geometry::new(1280, 720)), &["5 1279 719 1", "6 3 0 0"]);
        let ended = "% Height 720\n% Version 2\n% Width 1280\n% end\n";
        check(ended, &[[5, v2]], Some(Geometry::new(1280, 720)), &["5 1279 719 1"]);
    }

    #[test]
    fn without_a_version_the_events_tell() {
        let (v1, v2) = ((1 << 17) | (239 << 9) | 303, (1 << 28) | (719 << 14) | 1279);
        for (word, expected, version) in [(v1, "5 303 239 1", "is 1"), (v2, "5 1279 719 1", "is 2")] {
            let recording = file(HEAD, [0, 8], &[[5, word]], &OpenOptions::default()).unwrap();
            assert_eq!(said(&recording), [expected]);
            assert!(recording.warnings()[0].ends_with(version), "{:?}", recording.warnings());
        }
    }

    #[test]
    fn time_wraps_with_late_events_around_the_seam() {
        let header = format!("{HEAD}% Version 2\n");
        let seam = 1u64 << 32;
        let times: Vec<u64> = (0..2_000u64)
            .map(|i| seam - 70_000 + i * 71 - i * 7919 % 3_000)
            .chain([seam + (1 << 31), 2 * seam - 5, 2 * seam + 6, 2 * seam - 4, 2 * seam + 7])
            .collect();
        let words: Vec<_> = times.iter().map(|t| [*t as u32, 1 << 14]).collect();
        let recording = file(&header, [12, 8], &words, &OpenOptions::default()).unwrap();
        let expected: Vec<_> = times.iter().map(|t| format!("{t} 0 1 0")).collect();
        assert!(said(&recording) == expected, "{:?}", &said(&recording)[1990..]);
    }

    #[test]
    fn shifted_times_and_those_before_zero() {
        let header = format!("{HEAD}% Version 2\n");
        let options = OpenOptions { time_shift_us: -7, ..OpenOptions::default() };
        let recording = file(&header, [12, 8], &[[9, 0], [8, 0], [7, 0]], &options).unwrap();
        assert_eq!(said(&recording), ["2 0 0 0", "1 0 0 0", "0 0 0 0"]);
        let recording = file(&header, [12, 8], &[[9, 0], [6, 0]], &options).unwrap();
        let mut blocks = recording.blocks();
        assert_eq!(blocks.next_block().unwrap().unwrap().block.len(), 1);
        let error = blocks.next_block().unwrap_err();
        assert_eq!(error.offset(), Some(header.len() as u64 + 2 + 8));
        assert!(error.remedy().contains("--time-shift"), "{error}");
    }

    #[test]
    fn events_off_the_sensor_are_counted() {
        let header = format!("{HEAD}% Version 2\n% Height 4\n% Width 4\n");
        let words = [[1, 3 | 3 << 14], [2, 4], [3, 4 << 14], [4, 0]];
        let recording = file(&header, [12, 8], &words, &OpenOptions::default()).unwrap();
        assert_eq!(said(&recording), ["1 3 3 0", "4 0 0 0"]);
        let mut blocks = recording.blocks();
        while blocks.next_block().unwrap().is_some() {}
        let counters = blocks.counters();
        assert_eq!((counters.events, counters.off_sensor, counters.bytes_decoded), (4, 2, 32));
    }

    #[test]
    fn what_is_no_file_of_events_says_so() {
        let header = format!("{HEAD}% Version 2\n");
        let error = |header: &str, kind| file(header, kind, &[], &OpenOptions::default()).unwrap_err();
        assert!(error(&header, [14, 8]).what().contains("trigger inputs (type 14)"));
        assert!(error(&header, [12, 16]).what().contains("16 bytes, not 8"));
        assert!(error(&header, [37, 8]).what().contains("type 37"));
        assert!(error(&format!("{HEAD}% Version 3\n"), [12, 8]).what().contains("version 3"));
        let large = format!("{HEAD}% Version 2\n% Height 70000\n% Width 1280\n");
        assert_eq!(error(&large, [12, 8]).kind(), ErrorKind::TooLarge);
    }
}
