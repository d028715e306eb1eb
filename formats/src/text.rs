//! Text: an event a line, four numbers in it. Plain or packed by gzip or zstd.
//!
//! ```text
//! # lobula: time-unit=us columns=t,x,y,p sensor-size=346x260     ours: it settles everything
//! t,x,y,p                                                        a header settles the columns, `t_us` the unit too
//! 346 260                                                        E2VID: the sensor's size; t x y p follow, t in s
//! 1744227144.732712 219 244 0                                    a fraction settles that the first column is t, in s
//! ```
//!
//! Separated by a space, tab, comma or semicolon; p is 0 or 1, -1 or 1, false or true. Lines that begin with `#` or
//! `%` are comments. A line that is no event is counted as damaged and skipped. Numbers are read exactly, by
//! [`number`], never as floating point; a time between two µs becomes the nearest.

use crate::byte_cursor::{Bad, ByteCursor, ByteDecoder, Step};
use crate::container::{Container, Cursor, Piece};
use crate::input::Input;
use crate::intake::{Intake, Taken};
use crate::open::Probe;
use crate::packed::{Packing, Source, Unpack, unpack_head};
use crate::{Error, Format, OpenOptions};
use batch::Batch;
use layout::{Findings, Layout};
use line::Line;
use lobula_core::{Counters, Fault, Geometry, Sink};
use std::sync::Arc;

mod batch;
mod layout;
mod line;
mod number;
mod write;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format = Format {
    name: "text",
    extensions: &["txt", "csv", "txt.gz", "csv.gz", "txt.zst", "csv.zst"],
    create: Some(write::create),
    probe,
    open,
};

/// Largest sensor that an event can tell.
const GEOMETRY_MAX: Geometry = Geometry::new(u16::MAX, 0x7FFF);
/// Longest line that can be an event.
const LINE_BYTES_MAX: usize = 4096;
/// Text looked at to tell the layout.
const SAMPLE_BYTES: usize = 16 << 10;

/// Packed bytes that hold the first of it: a block of zstd is unpacked whole or not at all.
const PACKED_SAMPLE_BYTES: usize = 192 << 10;

fn probe(probe: &Probe<'_>) -> bool {
    match Packing::of(probe.head) {
        None => layout::is_table(probe.head, probe.head.len() as u64 == probe.bytes),
        // What cannot be read is no text; another format or the reading will tell.
        Some(packing) => sample(probe.input, Some(packing)).is_ok_and(|text| layout::is_table(&text, false)),
    }
}

/// The first of the text.
fn sample(input: &Input, packing: Option<Packing>) -> Result<Vec<u8>, Error> {
    let want = if packing.is_some() { PACKED_SAMPLE_BYTES } else { SAMPLE_BYTES };
    let mut head = vec![0; want.min(usize::try_from(input.len()).unwrap_or(usize::MAX))];
    let len = input.read_at(0, &mut head)?;
    head.truncate(len);
    Ok(packing.map_or_else(|| head.clone(), |packing| unpack_head(packing, &head, SAMPLE_BYTES)))
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let mut magic = [0; 4];
    input.read_at(0, &mut magic)?;
    let packing = Packing::of(&magic);
    let head = sample(&input, packing)?;
    let Findings { layout, size, start } = layout::find(&head, input.path(), options)?;
    let geometry = options.sensor_size.or(size);
    let intake = Intake::new(geometry.unwrap_or(GEOMETRY_MAX), options);
    let decoder = Decoder { intake, layout, skipping: false, each: 0 };
    Ok(Box::new(TextRecording { input, packing, geometry, start, decoder }))
}

#[derive(Debug)]
struct TextRecording {
    input: Arc<Input>,
    packing: Option<Packing>,
    geometry: Option<Geometry>,
    /// Offset of the first line that may be an event, unpacked.
    start: u64,
    /// At that line.
    decoder: Decoder,
}

impl Container for TextRecording {
    fn geometry(&self) -> Option<Geometry> {
        self.geometry
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.decoder.intake.geometry()
    }

    /// Whole lines, where the text is not packed.
    fn pieces(&self, n: usize) -> Result<Vec<Piece>, Error> {
        if self.packing.is_some() {
            return Ok(vec![Piece { cursor: self.start(), wrap_us: 0 }]);
        }
        let (input, len) = (&self.input, self.input.len());
        let stride = len.saturating_sub(self.start) / n.max(1) as u64;
        let mut starts = vec![self.start];
        for i in 1..n as u64 {
            let start = next_line(input, self.start + i * stride)?;
            if start < len && starts.last().is_some_and(|last| *last < start) {
                starts.push(start);
            }
        }
        let ends = starts.iter().copied().skip(1).chain([len]);
        let piece = |(start, end): (u64, u64)| {
            let source = Source::Plain(input.clone());
            Piece { cursor: Box::new(ByteCursor::new(source, start..end, self.decoder.clone())), wrap_us: 0 }
        };
        Ok(starts.iter().copied().zip(ends).map(piece).collect())
    }

    fn start(&self) -> Box<dyn Cursor> {
        let (input, len) = (self.input.clone(), self.input.len());
        let (source, end) = match self.packing {
            None => (Source::Plain(input), len),
            // How much it unpacks to is known at its end.
            Some(packing) => (Source::Packed(Unpack::new(input, packing, 0..len)), u64::MAX),
        };
        Box::new(ByteCursor::new(source, self.start..end, self.decoder.clone()))
    }
}

#[derive(Clone, Debug)]
struct Decoder {
    intake: Intake,
    layout: Layout,
    /// Inside a line that is too long.
    skipping: bool,
    /// So many lines are taken one by one, since those before them were not of the usual kind.
    each: usize,
}

impl Decoder {
    /// Takes a line of so many bytes; false where the sink is full.
    #[inline]
    fn take(&mut self, line: Line, bytes: usize, sink: &mut Sink<'_>) -> Result<bool, Bad> {
        let bytes = bytes as u64;
        match line {
            Line::Event { t_us, x, y, on } => {
                return Ok(self.intake.push(sink, t_us, (x, y), on, bytes)? == Taken::Yes);
            }
            Line::Nothing => self.intake.other(bytes),
            Line::Bad => self.intake.fault(Fault::Damaged, bytes),
        }
        Ok(true)
    }

    /// Takes many lines of the usual kind; how many bytes they were.
    fn take_alike(&mut self, text: &[u8], sink: &mut Sink<'_>) -> usize {
        if self.each > 0 {
            self.each -= 1;
            return 0;
        }
        if text.len() < TEXT_WORTH || sink.room() < LINES_WORTH {
            return 0;
        }
        let batch = Batch::read(text, &self.layout, sink.room());
        let events = batch.events.get(..batch.len).unwrap_or_default();
        let ends = events.first().zip(events.last());
        let alike = ends.is_some_and(|(first, last)| {
            let ends = (first.t_us as i64, last.t_us as i64);
            self.intake.push_alike(sink, 0, ends, events.iter(), |event| *event)
        });
        // Lines that are not alike are to be rare, or the looking would be for nothing.
        let worth = alike && batch.len >= LINES_WORTH;
        self.each = if worth { 0 } else { batch::LINES };
        if !alike {
            return 0;
        }
        self.intake.other(batch.bytes as u64);
        batch.bytes
    }

    /// Drops the bytes of a line that is too long, up to its end if that is among them.
    fn skip(&mut self, bytes: &[u8]) -> usize {
        let end = end_of_line(bytes);
        self.skipping = end.is_none();
        let taken = end.unwrap_or(bytes.len());
        self.intake.counters.bytes_faulty += taken as u64;
        taken
    }
}

/// Fewer lines at once are not worth it, nor is less text than they may take.
const LINES_WORTH: usize = 16;
const TEXT_WORTH: usize = 1024;

/// Offset of the first line that begins at `offset` or after it; the length of the text where none does.
fn next_line(input: &Input, offset: u64) -> Result<u64, Error> {
    let (mut at, mut buffer) = (offset.saturating_sub(1), [0; LINE_BYTES_MAX]);
    loop {
        let len = input.read_at(at, &mut buffer)?;
        match end_of_line(buffer.get(..len).unwrap_or_default()) {
            Some(end) => return Ok(at + end as u64),
            None if len == 0 => return Ok(input.len()),
            None => at += len as u64,
        }
    }
}

/// Where the next line begins.
fn end_of_line(bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|byte| *byte == b'\n').map(|end| end + 1)
}

impl ByteDecoder for Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        let mut done = 0;
        loop {
            let rest = bytes.get(done..).unwrap_or_default();
            if self.skipping {
                if rest.is_empty() {
                    return Ok(Step { taken: done, full: false });
                }
                done += self.skip(rest);
                continue;
            }
            match self.take_alike(rest, sink) {
                0 => {}
                taken => {
                    done += taken;
                    continue;
                }
            }
            if let Some((event, bytes)) = line::plain(rest, &self.layout) {
                if !self.take(event, bytes, sink).map_err(|bad| Bad { offset: done, ..bad })? {
                    return Ok(Step { taken: done, full: true });
                }
                done += bytes;
                continue;
            }
            let end = end_of_line(rest);
            if end.unwrap_or(rest.len()) > LINE_BYTES_MAX {
                self.intake.fault(Fault::Damaged, 0);
                self.skipping = true;
                continue;
            }
            let Some(line) = end.and_then(|end| rest.get(..end)) else {
                return Ok(Step { taken: done, full: false });
            };
            let bytes = line.len();
            let line = line::parse(line, &self.layout);
            if !self.take(line, bytes, sink).map_err(|bad| Bad { offset: done, ..bad })? {
                return Ok(Step { taken: done, full: true });
            }
            done += bytes;
        }
    }

    fn decode_last(&mut self, unread: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        // The last line may lack its end.
        let line = line::parse(unread, &self.layout);
        let taken = self.take(line, unread.len(), sink)?;
        Ok(Step { taken: if taken { unread.len() } else { 0 }, full: !taken })
    }

    fn finish(&mut self, unread: &[u8]) {
        self.intake.fault(Fault::CutShort, unread.len() as u64);
    }

    fn counters(&self) -> Counters {
        self.intake.counters
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{file, options, said};
    use crate::{ErrorKind, TimeUnit};
    use std::path::Path;

    /// Without options.
    #[track_caller]
    fn check(text: &str, expected: &str) {
        let recording = file(text.as_bytes(), &OpenOptions::default()).unwrap();
        assert_eq!(said(&recording), expected, "{text:?}");
    }

    /// With options.
    #[track_caller]
    fn check_with(unit: &str, columns: &str, text: &str, expected: &str) {
        let recording = file(text.as_bytes(), &options(unit, columns)).unwrap();
        assert_eq!(said(&recording), expected, "{text:?}");
    }

    #[track_caller]
    fn refused(text: &str, names: &[&str]) {
        let error = file(text.as_bytes(), &OpenOptions::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NeedsOption, "{error}");
        for option in ["--columns", "--time-unit"] {
            assert_eq!(error.remedy().contains(option), names.contains(&option), "{text:?}: {error}");
        }
    }

    #[test]
    fn what_settles_the_layout() {
        check("1.5 3 4 1\n2.000001 5 6 0\n", "?, 1500000 3 4 1, 2000001 5 6 0");
        check("346 260\n0.000001 3 4 1\n", "346x260, 1 3 4 1");
        check("x,y,p,t_us\n3,4,1,7\n", "?, 7 3 4 1");
        check("timestamp;x;y;polarity\n0.5;3;4;-1\n", "?, 500000 3 4 0");
        check("# t x y p\n0.5 3 4 1\n", "?, 500000 3 4 1");
        check("# lobula: time-unit=ms columns=p,t,x,y sensor-size=9x8\n1 2 3 4\n", "9x8, 2000 3 4 1");
        check("# lobula: time-unit=us columns=t,x,y,p\nt,x,y,p\n", "?");
        check("frame,\"t [ns]\",x,y,p\n9,7000,3,4,1\n", "?, 7 3 4 1");
    }

    #[test]
    fn what_does_not_settle_it_is_asked_for() {
        refused("t,x,y,p\n5,1,2,1\n", &["--time-unit"]);
        refused("346 260\n5 1 2 1\n", &["--time-unit"]);
        refused("1,2,1,5\n3,4,0,6\n", &["--columns", "--time-unit"]);
        refused("5 1 2 1\n", &["--columns", "--time-unit"]);
        // Whole numbers as some libraries print them; columns that may be in another order.
        refused("1234.0 1 2 1\n1236.0 3 4 0\n", &["--columns", "--time-unit"]);
        refused("1.0e+00 1.0e+00 2.0e+00 1.0e+00\n", &["--columns", "--time-unit"]);
        refused("1.5 1 2 9\n2.5 3 1 8\n", &["--columns"]);
        refused("1 2 1 0.5\n3 4 0 0.75\n", &["--columns"]);
        let error = file(b"1,2,1,5\n", &options("us", "")).unwrap_err();
        assert!(error.remedy().contains("--columns") && !error.remedy().contains("--time-unit"), "{error}");
    }

    #[test]
    fn options_say_it() {
        check_with("us", "x,y,p,t", "1,2,1,5\n", "?, 5 1 2 1");
        check_with("ns", "t,x,y,p", "1499 1 2 1\n1500 1 2 0\n", "?, 1 1 2 1, 2 1 2 0");
        check_with("s", "t,x,y,p", "3 1 2 1\n", "?, 3000000 1 2 1");
        // An option is believed where the content says otherwise.
        check_with("ms", "t,x,y,p", "1.5 1 2 1\n", "?, 1500 1 2 1");
        check_with("us", "", "t,x,y,p\n5,1,2,1\n", "?, 5 1 2 1");
    }

    /// Of eventcv 1.0.8: 300 ms read as 300 s, 80 minutes as 4.8 s, one event at 5 as 5 s.
    #[test]
    fn no_unit_is_guessed_by_the_span() {
        for times in [[0u64, 299_999], [0, 4_800_000_000], [5, 5]] {
            let text = times.map(|t| format!("{t} 1 2 1\n")).concat();
            let [a, b] = times;
            check_with("us", "t,x,y,p", &text, &format!("?, {a} 1 2 1, {b} 1 2 1"));
            refused(&format!("t x y p\n{text}"), &["--time-unit"]);
        }
    }

    #[test]
    fn separators_line_ends_and_numbers() {
        for separator in [" ", "\t", ",", ";", ", ", "  ", " ; "] {
            let text = format!("{0}.5|3|4|1\r\n\r\n1.25|5|6|+0\r\n1.5|7|8|True", 0).replace('|', separator);
            check(&text, "?, 500000 3 4 1, 1250000 5 6 0, 1500000 7 8 1");
        }
        check_with("s", "t,x,y,p", "1.5e-05 1.2e1 3.000 1.0e+00\n", "?, 15 12 3 1");
        check("  0.5 3 4 1  \n", "?, 500000 3 4 1");
        check(
            "1744227144.732712999 1 2 1\n1744227144.7327124 1 2 1\n",
            "?, 1744227144732713 1 2 1, 1744227144732712 1 2 1",
        );
        check("\u{FEFF}t,x,y,p\n0.5,1,2,1\n", "?, 500000 1 2 1");
        check("\u{FEFF}0.5 1 2 1\n", "?, 500000 1 2 1");
    }

    /// Of eventcv 1.0.8: one bad line loses the file.
    #[test]
    fn bad_lines_are_counted_and_the_rest_is_read() {
        let good = "0.5 3 4 1\n";
        for bad in [
            "0.5 3 4\n",
            "0.5 3 4 1 9\n",
            "x\n",
            "nan 3 4 1\n",
            "0.5 3.5 4 1\n",
            "0.5 3 4 2\n",
            "0.5 - 4 1\n",
            "1e99999 1 1 1\n",
            "99999999999999999999999999 1 1 1\n",
            "0.5 3 4 1 # no\n",
            "0..5 1 1 1\n",
        ] {
            let text = format!("{good}{bad}{good}");
            check(&text, "?, 500000 3 4 1, 500000 3 4 1, 1 faults");
        }
        let long = format!("{good}{}\n{good}", "7".repeat(200_000));
        check(&long, "?, 500000 3 4 1, 500000 3 4 1, 1 faults");
        let latin = [good.as_bytes(), b"# caf\xE9\n\xFF\xFE\n", good.as_bytes()].concat();
        let recording = file(&latin, &OpenOptions::default()).unwrap();
        assert_eq!(said(&recording), "?, 500000 3 4 1, 500000 3 4 1, 1 faults");
        let cut = format!("{good}0.5 3");
        check(&cut, "?, 500000 3 4 1, 1 faults");
    }

    #[test]
    fn pixels_beyond_any_sensor_are_counted_not_wrapped() {
        let recording =
            file(b"0.5 70000 1 1\n0.5 -1 1 1\n0.5 1 40000 1\n0.5 1 2 1\n", &OpenOptions::default()).unwrap();
        assert_eq!(said(&recording), "?, 500000 1 2 1");
        let mut blocks = recording.blocks();
        while blocks.next_block().unwrap().is_some() {}
        assert_eq!(blocks.counters().off_sensor, 3);
    }

    #[test]
    fn times_before_zero_are_refused_and_shifted() {
        let text = b"0.5 1 2 1\n-0.25 3 4 0\n";
        let recording = file(text, &OpenOptions::default()).unwrap();
        let mut blocks = recording.blocks();
        assert_eq!(blocks.next_block().unwrap().unwrap().block.len(), 1);
        let error = blocks.next_block().unwrap_err();
        assert_eq!(error.offset(), Some(10));
        assert!(error.remedy().contains("--time-shift"), "{error}");
        let options = OpenOptions { time_shift_us: 250_000, ..OpenOptions::default() };
        assert_eq!(said(&file(text, &options).unwrap()), "?, 750000 1 2 1, 0 3 4 0");
    }

    #[test]
    fn any_split_gives_the_same() {
        let text = format!("0.5 3 4 1\n# note\nbad\n{}\n1.5 5 6 0\n7 7 7 1\n", "9".repeat(5_000));
        let layout = layout::find(text.as_bytes(), Path::new("a"), &options("s", "t,x,y,p")).unwrap().layout;
        let decoder = Decoder {
            intake: Intake::new(GEOMETRY_MAX, &OpenOptions::default()),
            layout,
            skipping: false,
            each: 0,
        };
        let run = |pieces: &mut dyn Iterator<Item = &[u8]>| {
            let mut memory = [lobula_core::Event::default(); 64];
            let (mut sink, mut decoder) = (Sink::new(&mut memory), decoder.clone());
            let mut held = Vec::new();
            for piece in pieces {
                held.extend_from_slice(piece);
                let step = decoder.decode(&held, &mut sink).unwrap();
                held.drain(..step.taken);
            }
            (sink.block(GEOMETRY_MAX).span().events.to_vec(), decoder.counters())
        };
        let whole = run(&mut [text.as_bytes()].into_iter());
        assert_eq!((whole.0.len(), whole.1.faults.get(Fault::Damaged)), (3, 2));
        for size in [1, 2, 3, 7, 100, 4097] {
            assert_eq!(run(&mut text.as_bytes().chunks(size)), whole, "pieces of {size}");
        }
    }

    #[test]
    fn packed_text_is_read_by_content() {
        use std::io::Write;
        let text: String = (0..50_000)
            .map(|i| format!("{}.{:06} {} 4 1\n", i / 1000, i % 1000 * 1000 + 1, i % 300))
            .collect();
        let plain = said(&file(text.as_bytes(), &OpenOptions::default()).unwrap());
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        gzip.write_all(text.as_bytes()).unwrap();
        let gzip = gzip.finish().unwrap();
        let zstd = zstd::encode_all(text.as_bytes(), 1).unwrap();
        for packed in [gzip, zstd] {
            let recording = file(&packed, &OpenOptions::default()).unwrap();
            assert!(said(&recording) == plain);
            let mut slice = recording.slice_events(40_000..40_003).unwrap();
            let chunk = slice.next_block().unwrap().unwrap();
            let times: Vec<_> = chunk.span().events.iter().map(|event| chunk.span().time(*event)).collect();
            assert_eq!(times, [40_000_001, 40_001_001, 40_002_001]);
            // Cut: what comes before is read, then an error says so.
            let recording = file(&packed[..packed.len() / 2], &OpenOptions::default()).unwrap();
            let (mut blocks, mut events) = (recording.blocks(), 0);
            let error = loop {
                match blocks.next_block() {
                    Ok(chunk) => events += chunk.expect("an error, not an end").block.len(),
                    Err(error) => break error,
                }
            };
            assert!(events > 10_000 && error.what().contains("cannot be unpacked"), "{events} {error}");
        }
    }

    #[test]
    fn units_are_those_of_the_option() {
        assert_eq!(TimeUnit::ALL.map(number::exponent_of_us), [6, 3, 0, -3]);
    }
}
