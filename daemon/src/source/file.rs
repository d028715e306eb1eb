//! A recording as a camera: its bytes as they came, at its own pace, or as fast as the clients take them.
//!
//! The pace needs to know where stream time stands, so a decoder runs ahead of the bytes by one small piece. It costs
//! a few ns an event and is left out where nothing is paced.

use super::{PACKET_US, Restart, Source, SourceError, TRANSFER_BYTES_MIN, Transfer};
use lobula_core::wire::{AnyDecoder, Encoding};
use lobula_core::{Decode, Event, Geometry, Sink};
use lobula_formats::{OpenOptions, Payload};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Settings of a recording to play.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileSpec {
    /// The recording; one that holds a camera's bytes (Prophesee RAW).
    pub path: PathBuf,
    /// How much faster than it was recorded; default 1.
    #[serde(default = "one")]
    pub speed: f64,
    /// Whether to start over at its end, for ever; default no.
    #[serde(default, rename = "loop")]
    pub looped: bool,
    /// Whether nothing may be lost: it waits for its clients and goes as fast as the slowest of them. Default no.
    #[serde(default)]
    pub lossless: bool,
    /// Columns and rows of the sensor, where the recording does not tell.
    #[serde(default)]
    pub sensor_size: Option<[u16; 2]>,
}

fn one() -> f64 {
    1.0
}

impl FileSpec {
    /// The recording at `path`, once, at its own pace.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), speed: 1.0, looped: false, lossless: false, sensor_size: None }
    }

    fn check(&self) -> Result<(), SourceError> {
        let refuse = |why: &str| Err(SourceError::Settings(format!("{}: {why}", self.path.display())));
        if !(self.speed.is_finite() && (0.001..=1000.0).contains(&self.speed)) {
            return refuse("speed is out of range: give 0.001 to 1000");
        }
        if self.lossless && self.looped {
            return refuse("a lossless replay must end: remove loop or lossless");
        }
        if self.lossless && self.speed != 1.0 {
            return refuse("a lossless replay goes as fast as its clients: remove speed or lossless");
        }
        Ok(())
    }
}

/// A recording being played.
pub(super) struct File {
    spec: FileSpec,
    payload: Payload,
    encoding: Encoding,
    geometry: Geometry,
    /// `None` where nothing is paced.
    pacer: Option<Pacer>,
    /// The next packet starts the recording over.
    restart: Option<Restart>,
}

impl File {
    pub(super) fn open(spec: &FileSpec) -> Result<Self, SourceError> {
        spec.check()?;
        let mut options = OpenOptions::default();
        options.sensor_size = spec.sensor_size.map(|[width, height]| Geometry::new(width, height));
        let recording = lobula_formats::open_with(&spec.path, &options).map_err(SourceError::Recording)?;
        let geometry = recording.sensor_size().map_err(SourceError::Recording)?;
        let payload = recording.payload().ok_or_else(|| {
            let path = spec.path.display();
            SourceError::Settings(format!("{path}: holds no camera's bytes to play: give a RAW recording"))
        })?;
        let encoding = payload.encoding();
        let pacer = (!spec.lossless).then(|| Pacer::new(encoding, geometry, spec.speed));
        Ok(Self { spec: spec.clone(), payload, encoding, geometry, pacer, restart: None })
    }

    /// At the end of the recording: starts over, or tells that nothing follows.
    fn at_end(&mut self, bytes: usize, due_ns: Option<u64>) -> Transfer {
        let restart = self.restart.take();
        let transfer = Transfer { bytes, due_ns, restart, end: bytes == 0 };
        match &mut self.pacer {
            Some(pacer) if self.spec.looped && pacer.t_first.is_some() => {
                self.payload.rewind();
                self.restart = Some(pacer.start_over());
                Transfer { end: false, ..transfer }
            }
            _ => transfer,
        }
    }
}

impl Source for File {
    fn encoding(&self) -> Encoding {
        self.encoding
    }

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn describe(&self) -> String {
        let how = if self.spec.lossless {
            "lossless".into()
        } else {
            format!("at {} times its pace", self.spec.speed)
        };
        format!("{} {how}", self.spec.path.display())
    }

    fn read(&mut self, out: &mut [u8]) -> Result<Transfer, SourceError> {
        debug_assert!(out.len() >= TRANSFER_BYTES_MIN);
        let Some(pacer) = &mut self.pacer else {
            let bytes = self.payload.read(out).map_err(SourceError::Recording)?;
            return Ok(Transfer { bytes, end: bytes == 0, ..Transfer::default() });
        };
        let packet = pacer.packet(&mut self.payload, out).map_err(SourceError::Recording)?;
        if packet.at_end {
            return Ok(self.at_end(packet.bytes, Some(packet.due_ns)));
        }
        let restart = self.restart.take();
        Ok(Transfer { bytes: packet.bytes, due_ns: Some(packet.due_ns), restart, end: false })
    }
}

/// Bytes of one stretch of stream time.
struct Packet {
    bytes: usize,
    due_ns: u64,
    at_end: bool,
}

/// Finds where the bytes of each [`PACKET_US`] of stream time end.
struct Pacer {
    decoder: AnyDecoder,
    scratch: Box<[Event]>,
    speed: f64,
    /// Bytes read and not given yet: `buffer[given..read]`.
    buffer: Box<[u8]>,
    given: usize,
    read: usize,
    /// Bytes from `given` on that the decoder has seen.
    seen: usize,
    /// First time of the recording, once known, and the last so far.
    t_first: Option<u64>,
    t_last: u64,
    /// Stream time, on a grid of [`PACKET_US`], at which the open packet ends.
    t_end: u64,
    /// Stream time before this turn of the recording.
    elapsed_us: u64,
    turns_shift_us: u64,
}

impl Pacer {
    /// Bytes looked at in one go: few enough that a packet ends where its time does, to some 30 events.
    const PIECE_BYTES: usize = 64;
    const BUFFER_BYTES: usize = 1 << 16;

    fn new(encoding: Encoding, geometry: Geometry, speed: f64) -> Self {
        Self {
            decoder: AnyDecoder::new(encoding, geometry),
            scratch: vec![Event::default(); 1024].into(),
            speed,
            buffer: vec![0; Self::BUFFER_BYTES].into(),
            given: 0,
            read: 0,
            seen: 0,
            t_first: None,
            t_last: 0,
            t_end: 0,
            elapsed_us: 0,
            turns_shift_us: 0,
        }
    }

    /// Copies the bytes of the next stretch of stream time to `out`; no more than fit.
    fn packet(&mut self, payload: &mut Payload, out: &mut [u8]) -> Result<Packet, lobula_formats::Error> {
        let mut bytes = 0;
        loop {
            if self.seen == 0 && !self.look_ahead(payload)? {
                return Ok(Packet { bytes, due_ns: self.due_ns(self.t_last + 1), at_end: true });
            }
            let room = out.get_mut(bytes..).unwrap_or_default();
            if bytes > 0 && (self.t_last >= self.t_end || self.seen > room.len()) {
                let due_ns = self.due_ns(self.t_end.min(self.t_last + 1));
                self.t_end = self.t_end.max(self.t_last - self.t_last % PACKET_US + PACKET_US);
                return Ok(Packet { bytes, due_ns, at_end: false });
            }
            self.t_end = self.t_end.max(self.t_last - self.t_last % PACKET_US + PACKET_US);
            let piece = self.buffer.get(self.given..self.given + self.seen).unwrap_or_default();
            for (to, from) in room.iter_mut().zip(piece) {
                *to = *from;
            }
            bytes += self.seen;
            self.given += self.seen;
            self.seen = 0;
        }
    }

    /// Decodes the next piece, for its time. False at the end of the recording.
    fn look_ahead(&mut self, payload: &mut Payload) -> Result<bool, lobula_formats::Error> {
        if self.given == self.read {
            self.given = 0;
            self.read = payload.read(&mut self.buffer)?;
        }
        self.seen = (self.read - self.given).min(Self::PIECE_BYTES);
        let mut piece = self.buffer.get(self.given..self.given + self.seen).unwrap_or_default();
        while !piece.is_empty() {
            let mut sink = Sink::new(&mut self.scratch);
            let taken = self.decoder.decode(piece, &mut sink);
            if self.t_first.is_none() && !sink.is_empty() {
                self.t_first = Some(sink.t_first());
            }
            piece = piece.get(taken..).unwrap_or_default();
        }
        self.t_last = self.t_last.max(self.decoder.now());
        Ok(self.seen > 0)
    }

    /// When stream time `t` of this turn is due.
    fn due_ns(&self, t: u64) -> u64 {
        let us = self.elapsed_us + t.saturating_sub(self.t_first.unwrap_or(t));
        (us as f64 * 1000.0 / self.speed) as u64
    }

    /// The recording starts over; its stream time goes on a packet's time after its end.
    fn start_over(&mut self) -> Restart {
        let near_us = self.t_first.unwrap_or_default();
        let turn_us = self.t_last.saturating_sub(near_us) + PACKET_US;
        self.elapsed_us += turn_us;
        self.turns_shift_us += turn_us;
        self.decoder.gap(Some(near_us));
        self.t_last = near_us;
        self.t_end = 0;
        Restart { near_us, shift_us: self.turns_shift_us }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lobula_core::{Polarity, Span};
    use lobula_formats::{WriteOptions, Writer};

    const GEOMETRY: Geometry = Geometry::new(64, 48);

    /// A recording from 5 s on with an event every 100 µs, but for 20 ms of silence after the first 50.
    fn recording(folder: &tempfile::TempDir, encoding: Encoding) -> (PathBuf, Vec<Event>) {
        let time = |i: u32| 5_000_000 + i * 100 + if i < 50 { 0 } else { 20_000 };
        let events: Vec<_> = (0..100).map(|i| Event::new(time(i), i as u16 % 64, 7, Polarity::On)).collect();
        let path = folder.path().join("recording.raw");
        let mut options = WriteOptions::default();
        options.encoding = Some(encoding);
        let mut writer = Writer::create(&path, Some(GEOMETRY), &options).unwrap();
        let t_last = time(99).into();
        writer.write(Span { t_first: 5_000_000, t_last, geometry: GEOMETRY, events: &events }).unwrap();
        writer.finish().unwrap();
        (path, events)
    }

    #[test]
    fn packets_are_due_when_their_time_has_passed_and_lose_nothing() {
        for encoding in [Encoding::Evt2, Encoding::Evt3] {
            let folder = tempfile::tempdir().unwrap();
            let (path, events) = recording(&folder, encoding);
            let mut source = File::open(&FileSpec { speed: 2.0, ..FileSpec::new(&path) }).unwrap();
            let mut decoder = AnyDecoder::new(encoding, GEOMETRY);
            let (mut out, mut memory, mut found) = ([0; 4096], [Event::default(); 256], Vec::new());
            let mut due_last = 0;
            loop {
                let transfer = source.read(&mut out).unwrap();
                if transfer.end {
                    break;
                }
                let due = transfer.due_ns.unwrap();
                assert!(due >= due_last);
                due_last = due;
                let mut sink = Sink::new(&mut memory);
                assert_eq!(decoder.decode(&out[..transfer.bytes], &mut sink), transfer.bytes);
                for event in sink.block(GEOMETRY).span().events {
                    let after_start_ns = u64::from(event.t() - 5_000_000) * 500;
                    assert!(after_start_ns <= due, "{event:?} is not over at {due}");
                    found.push(*event);
                }
            }
            assert_eq!(found, events);
            assert!((14_000_000..=15_500_000).contains(&due_last), "30 ms at twice the pace: {due_last}");
        }
    }

    #[test]
    fn a_loop_goes_on_in_time() {
        let folder = tempfile::tempdir().unwrap();
        let (path, _) = recording(&folder, Encoding::Evt3);
        let mut source = File::open(&FileSpec { looped: true, ..FileSpec::new(&path) }).unwrap();
        let mut out = [0; 4096];
        let mut restarts = Vec::new();
        let mut due_last = 0;
        while restarts.len() < 3 {
            let transfer = source.read(&mut out).unwrap();
            assert!(!transfer.end && transfer.due_ns.unwrap() >= due_last);
            due_last = transfer.due_ns.unwrap();
            restarts.extend(transfer.restart);
        }
        let turn_us = 20_000 + 9_900 + PACKET_US;
        let expected: Vec<_> =
            (1..=3).map(|turn| Restart { near_us: 5_000_000, shift_us: turn * turn_us }).collect();
        assert_eq!(restarts, expected);
    }

    #[test]
    fn impossible_settings_are_refused_with_what_to_do() {
        let spec = FileSpec::new("/nowhere.raw");
        let error = |spec: FileSpec| File::open(&spec).err().unwrap().to_string();
        assert!(error(FileSpec { speed: 0.0, ..spec.clone() }).contains("give 0.001 to 1000"));
        assert!(error(FileSpec { looped: true, lossless: true, ..spec.clone() }).contains("must end"));
        assert!(error(spec).contains("/nowhere.raw"));
    }
}
