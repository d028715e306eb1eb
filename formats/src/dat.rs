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
use crate::container::{Container, Cursor};
use crate::input::Input;
use crate::intake::{Intake, Taken};
use crate::open::Probe;
use crate::raw::header::Header;
use crate::wrap::{LATE_US_MAX, Wrap32};
use crate::{Error, ErrorKind, Format, OpenOptions};
use lobula_core::vector::widest;
use lobula_core::{Counters, Event, Geometry, Sink};
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
    let decoder = Decoder { layout, guard: Guard::new(intake.geometry()), intake, wrap: Wrap32::default() };
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
    /// How far y and p are below their places in an [`Event`].
    y_shift: u32,
    y_mask: u64,
    p_shift: u32,
}

const V1: Layout = Layout { x_mask: 0x1FF << 32, y_shift: 7, y_mask: 0xFF << 48, p_shift: 14 };
const V2: Layout = Layout { x_mask: 0x3FFF << 32, y_shift: 2, y_mask: 0x3FFF << 48, p_shift: 3 };

impl Layout {
    /// x in bits 32..47, y in bits 48..62.
    #[inline(always)]
    fn place(self, word: u64) -> u64 {
        (word & self.x_mask) | ((word << self.y_shift) & self.y_mask)
    }

    #[inline(always)]
    fn is_on(self, word: u64) -> bool {
        self.on(word) != 0
    }

    /// 1 for ON in bit 63.
    #[inline(always)]
    fn on(self, word: u64) -> u64 {
        (word << self.p_shift) & (1 << 63)
    }
}

impl Layout {
    /// Copies events, adding `shift` to their times. Gives bits of how far they are from `origin`, and those of the guard
    /// that every place left.
    #[inline(always)]
    fn copy(
        self,
        from: &[[u8; EVENT_BYTES]],
        to: &mut [Event],
        shift: u32,
        origin: u32,
        guard: u64,
    ) -> (u32, u64) {
        let (mut far, mut near) = (0, Guard::BITS);
        for (event, slot) in from.iter().zip(to) {
            // Words of 64 bits throughout, so that the compiler takes several events at once.
            let word = u64::from_le_bytes(*event);
            let place = self.place(word);
            far |= word.wrapping_sub(origin.into());
            near &= guard.wrapping_sub(place);
            let t = word.wrapping_add(shift.into()) & u64::from(u32::MAX);
            *slot = Event::from_word(t | place | self.on(word));
        }
        (far as u32, near)
    }
}

/// The last pixel of the sensor in the places of [`Layout::place`], a bit set above each number: a place subtracted
/// clears one of them where it is off the sensor.
#[derive(Clone, Copy, Debug)]
struct Guard(u64);

impl Guard {
    const BITS: u64 = 0x8000_8000 << 32;

    /// `None` for a sensor without pixels.
    fn new(geometry: Geometry) -> Option<Self> {
        let last = |side: u16, max: u16| side.min(max).checked_sub(1).map(u64::from);
        let x = last(geometry.width, GEOMETRY_MAX.width)?;
        let y = last(geometry.height, GEOMETRY_MAX.height)?;
        Some(Self(Self::BITS | (x << 32) | (y << 48)))
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
}

#[derive(Clone, Debug)]
struct Decoder {
    layout: Layout,
    guard: Option<Guard>,
    intake: Intake,
    wrap: Wrap32,
}

/// Events decoded at once where all are alike.
const BATCH: usize = 512;
/// Farthest that the events of a batch are from its first, forward.
const BATCH_US_MAX: u64 = 1 << 30;

impl Decoder {
    /// Takes all of the events, where they are near each other in time and on the sensor; else none of them.
    fn take_alike(&mut self, events: &[[u8; EVENT_BYTES]], sink: &mut Sink<'_>) -> Result<bool, Bad> {
        let (Some(first), Some(Guard(guard))) = (events.first(), self.guard) else { return Ok(false) };
        let mut wrap = self.wrap;
        let first = u64::from_le_bytes(*first) as u32;
        let unshifted = wrap.push(first);
        let t_first = self.intake.time(unshifted as i64)?;
        let late = LATE_US_MAX.min(unshifted).min(t_first);
        if !(sink.admits(t_first - late) && sink.admits(t_first + BATCH_US_MAX)) {
            return Ok(false);
        }
        let shift = (t_first as u32).wrapping_sub(first);
        let origin = first.wrapping_sub(late as u32);
        let (layout, spare) = (self.layout, sink.spare());
        let (far, near) = widest(
            #[inline(always)]
            || layout.copy(events, spare, shift, origin, guard),
        );
        if u64::from(far) >= BATCH_US_MAX || near & Guard::BITS != Guard::BITS {
            return Ok(false);
        }
        let last = events.last().map_or(first, |last| u64::from_le_bytes(*last) as u32);
        let since = i64::from(last.wrapping_sub(first) as i32);
        sink.commit(events.len(), t_first, t_first.wrapping_add_signed(since));
        self.wrap.set(unshifted.wrapping_add_signed(since));
        self.intake.counters.events += events.len() as u64;
        self.intake.counters.bytes_decoded += (events.len() * EVENT_BYTES) as u64;
        Ok(true)
    }

    /// Takes events one by one; how many before the sink was full.
    fn take_each(&mut self, events: &[[u8; EVENT_BYTES]], sink: &mut Sink<'_>) -> Result<usize, Bad> {
        for (i, event) in events.iter().enumerate() {
            let word = u64::from_le_bytes(*event);
            let place = self.layout.place(word);
            let xy = ((place >> 32 & 0xFFFF) as i64, (place >> 48) as i64);
            let mut wrap = self.wrap;
            let t = wrap.push(word as u32);
            let taken = self.intake.push(sink, t as i64, xy, self.layout.is_on(word), EVENT_BYTES as u64);
            if taken.map_err(|bad| Bad { offset: i * EVENT_BYTES, ..bad })? == Taken::Full {
                return Ok(i);
            }
            self.wrap = wrap;
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
            let alike = batch.len() <= sink.room() && {
                let at = |bad| Bad { offset: done * EVENT_BYTES, ..bad };
                self.take_alike(batch, sink).map_err(at)?
            };
            let taken = if alike {
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
