//! Prophesee RAW: a text header, then the camera's bytes as they came (EVT2, EVT2.1, EVT3 or EVT4).
//!
//! Spec: <https://docs.prophesee.ai/stable/data/file_formats/raw.html>
//!
//! ```text
//! % evt 3.0
//! % format EVT3;height=720;width=1280      also endianness=legacy|little for EVT21
//! % geometry 1280x720
//! % system_ID 49                           older files tell no size but by this and plugin_name
//! % end                                    older files have none
//! events until the end of the file
//! ```

mod camera;
pub(crate) mod header;
mod write;

use crate::byte_cursor::{Bad, ByteCursor, ByteDecoder, Step};
use crate::container::{Container, Cursor, Piece};
use crate::input::Input;
use crate::open::Probe;
use crate::{Error, Format, OpenOptions};
use lobula_core::wire::{AnyDecoder, Encoding};
use lobula_core::{Counters, Decode, Event, Geometry, Sink, Trigger};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

use header::Header;
#[cfg(feature = "ros")]
pub(crate) use write::refused;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format =
    Format { name: "Prophesee RAW", extensions: &["raw"], create: Some(write::create), probe, open };

/// Largest sensor that eleven bits of x and y can tell.
pub(crate) const GEOMETRY_MAX: Geometry = Geometry::new(2048, 2048);

/// Bytes looked at to find where a decoder can start: so many at first, and at most.
const SETTLE_BYTES: [usize; 2] = [16 << 10, 1 << 20];

fn probe(Probe { head, .. }: &Probe<'_>) -> bool {
    // Prophesee DAT, whose header looks alike, is asked before.
    head.starts_with(b"% ")
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let limits = &options.limits;
    let mut head = vec![0; limits.header_bytes_max.min(usize::try_from(input.len()).unwrap_or(usize::MAX))];
    let len = input.read_at(0, &mut head)?;
    head.truncate(len);
    let header = Header::parse(&head, input.len(), input.path(), limits)?;
    let encoding = options.encoding.map_or_else(|| header.encoding(input.path()), Ok)?;
    let geometry = match options.sensor_size {
        Some(size) => Some(size),
        None => header.geometry(input.path(), limits)?,
    };
    let file = Arc::new(RawFile { input, header, encoding, geometry });
    Ok(Box::new(RawRecording(file)))
}

/// An open file.
#[derive(Debug)]
struct RawFile {
    input: Arc<Input>,
    header: Header,
    encoding: Encoding,
    geometry: Option<Geometry>,
}

impl RawFile {
    /// The events' bytes.
    fn payload(&self) -> Range<u64> {
        self.header.bytes()..self.input.len()
    }
}

#[derive(Debug)]
struct RawRecording(Arc<RawFile>);

impl Container for RawRecording {
    fn geometry(&self) -> Option<Geometry> {
        self.0.geometry
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.0.geometry.unwrap_or(GEOMETRY_MAX)
    }

    fn encoding(&self) -> Option<Encoding> {
        Some(self.0.encoding)
    }

    fn fields(&self) -> Vec<(&str, &str)> {
        self.0.header.fields().collect()
    }

    fn payload(&self) -> Option<Payload> {
        Some(Payload { offset: self.0.payload().start, file: self.0.clone() })
    }

    fn start(&self) -> Box<dyn Cursor> {
        let decoder = AnyDecoder::new(self.0.encoding, self.geometry_of_blocks());
        Box::new(ByteCursor::new(self.0.input.clone(), self.0.payload(), decoder))
    }

    fn pieces(&self, n: usize) -> Result<Vec<Piece>, Error> {
        let payload = self.0.payload();
        let words = (payload.end - payload.start) / self.0.encoding.word_bytes() as u64;
        let places = (1..n as u64).into_par_iter().map(|i| self.settle(words / n as u64 * i));
        let mut starts = vec![(payload.start, AnyDecoder::new(self.0.encoding, self.geometry_of_blocks()))];
        for (at, decoder) in places.collect::<Result<Vec<_>, _>>()?.into_iter().flatten() {
            let is_after = starts.last().is_some_and(|(start, _)| at > *start);
            starts.extend(is_after.then_some((at, decoder)));
        }
        let ends: Vec<_> = starts.iter().skip(1).map(|(start, _)| *start).chain([payload.end]).collect();
        let pieces = starts.into_iter().zip(ends).enumerate().map(|(i, ((start, decoder), end))| Piece {
            cursor: Box::new(ByteCursor::new(self.0.input.clone(), start..end, decoder)),
            wrap_us: if i == 0 { 0 } else { self.0.encoding.wrap_us() },
        });
        Ok(pieces.collect())
    }
}

impl RawRecording {
    /// Where a decoder can start at or after the `word`-th word of the payload, and that decoder; `None` where the bytes
    /// after it do not tell.
    fn settle(&self, word: u64) -> Result<Option<(u64, AnyDecoder)>, Error> {
        let RawFile { input, encoding, .. } = &*self.0;
        let start = self.0.payload().start + word * encoding.word_bytes() as u64;
        let [mut look, most] = SETTLE_BYTES;
        let mut bytes = Vec::new();
        let settled = loop {
            bytes.resize(look, 0);
            let len = input.read_at(start, &mut bytes)?;
            match encoding.settled(&bytes[..len]) {
                Some(settled) => break settled,
                None if look >= most || len < look => return Ok(None),
                None => look *= 4,
            }
        };
        let mut decoder = AnyDecoder::new(*encoding, self.geometry_of_blocks());
        let mut rest = &bytes[..settled];
        // What these bytes hold belongs to the piece before.
        let (mut events, mut triggers) = (vec![Event::default(); 1024], [Trigger::default(); 16]);
        while !rest.is_empty() {
            let mut sink = Sink::with_triggers(&mut events, &mut triggers);
            rest = &rest[Decode::decode(&mut decoder, rest, &mut sink)..];
        }
        Ok(Some((start + settled as u64, decoder)))
    }
}

impl ByteDecoder for AnyDecoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut Sink<'_>) -> Result<Step, Bad> {
        let taken = Decode::decode(self, bytes, sink);
        Ok(Step { taken, full: taken < bytes.len() })
    }

    fn finish(&mut self, _unread: &[u8]) {
        Decode::finish(self);
    }

    fn counters(&self) -> Counters {
        *Decode::counters(self)
    }

    fn now(&self) -> u64 {
        Decode::now(self)
    }
}

/// A camera's bytes as they came, read in pieces: what a live source sends.
///
/// ```no_run
/// let recording = lobula_formats::open("driving.raw")?;
/// let mut payload = recording.payload().expect("RAW files hold the camera's bytes");
/// let mut transfer = vec![0; 16384];
/// loop {
///     let len = payload.read(&mut transfer)?;
///     if len == 0 {
///         break;
///     }
///     // decode &transfer[..len]
/// }
/// # Ok::<(), lobula_formats::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Payload {
    file: Arc<RawFile>,
    offset: u64,
}

impl Payload {
    /// How events are encoded.
    pub fn encoding(&self) -> Encoding {
        self.file.encoding
    }

    /// The sensor's size, if known.
    pub fn geometry(&self) -> Option<Geometry> {
        self.file.geometry
    }

    /// Offsets in the file of the camera's bytes.
    pub fn range(&self) -> Range<u64> {
        self.file.payload()
    }

    /// Offset in the file of the next byte.
    pub fn position(&self) -> u64 {
        self.offset
    }

    /// Fills `buffer` with the next bytes; fewer only at the end, 0 after it.
    ///
    /// # Errors
    /// Where the file cannot be read, or became shorter meanwhile.
    pub fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Error> {
        let len = self.file.input.read_at(self.offset, buffer)?;
        self.offset += len as u64;
        Ok(len)
    }

    /// Goes back to the first byte.
    pub fn rewind(&mut self) {
        self.offset = self.range().start;
    }
}
