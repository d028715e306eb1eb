//! What is measured on: a real EVT3 recording repeated in time, at word level, or the synthetic scene.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};

use lobula_core::simulation::{self, Camera, SceneSpec};
use lobula_core::wire::Encoding;
use lobula_core::{Block, Event, Geometry, Span, Window};

use crate::wire::{Wire, decode};

/// Events the decoder and filters are measured on.
pub const EVENTS: usize = 20_000_000;
/// Events a tensor is measured on, if nothing else is asked.
pub const TENSOR_EVENTS: usize = 1_220_000;
/// Events of a packet in the `stream` protocol.
pub const PACKET_EVENTS: usize = 4096;
/// Rate of the synthetic scene, that of the recording.
const SYNTHETIC_RATE_EVS: u32 = 25_000_000;
/// The recording, in `data/` of the shared folder.
pub const RECORDING: &str = "evt3_gen41_1280x720.raw";

/// An EVT3 stream in memory, and what it holds.
pub struct Scene {
    /// Words of the stream, little-endian, without a file's header.
    pub bytes: Vec<u8>,
    /// The sensor's size.
    pub geometry: Geometry,
    /// Every event of it, in stream order.
    pub events: Vec<Event>,
    /// Full time of the first event, in µs.
    pub t_first: u64,
    /// How many events, from the first, a tensor is measured on.
    pub tensor_events: usize,
    /// The window of the tensors: from their first event to their newest, as peers count ages from the newest event.
    pub tensor_window: Window,
    /// Where it comes from, in words for the report.
    pub source: String,
    /// The streams of the other formats, made when first asked for.
    wires: [OnceCell<Wire>; Encoding::ALL.len()],
}

impl Scene {
    /// The recording repeated to at least `events` events, else the synthetic scene of as many.
    ///
    /// # Errors
    /// A sentence, where the recording is there and cannot be used, or the repetition does not add up.
    pub fn load(events: usize) -> Result<Self, String> {
        match recording() {
            Some(path) => Self::repeated(&path, events),
            None => Self::synthetic(events),
        }
    }

    /// The same with tensors of the first `events` events.
    pub fn with_tensor_events(mut self, events: usize) -> Self {
        let times = self.events.iter().take(events).map(|e| lobula_core::full_time(self.t_first, e.t()));
        self.tensor_window = Window { t0: self.t_first, t1: times.max().unwrap_or(self.t_first) };
        self.tensor_events = events.min(self.events.len());
        self
    }

    fn repeated(path: &Path, events: usize) -> Result<Self, String> {
        let file = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
        let words = words_after_header(&file);
        let geometry = Geometry::new(1280, 720);
        let once = decode(Encoding::Evt3, geometry, &to_bytes(&words))?;
        let copies = events.div_ceil(once.len().max(1)).max(1);
        let repetition = Repetition::of(&words).ok_or("the recording tells no time")?;
        let bytes = to_bytes(&repetition.repeat(&words, copies));
        let all = decode(Encoding::Evt3, geometry, &bytes)?;
        repetition.check(&once, &all, copies)?;
        let t_first = repetition.t_first
            + u64::from(once.first().map_or(0, |e| e.t()).wrapping_sub(repetition.t_first as u32));
        let source = format!("{} repeated {copies} times in time, {} events", path.display(), all.len());
        Ok(Self::new(bytes, geometry, all, t_first, source))
    }

    fn new(bytes: Vec<u8>, geometry: Geometry, events: Vec<Event>, t_first: u64, source: String) -> Self {
        let (tensor_window, wires) = (Window { t0: t_first, t1: t_first }, Default::default());
        Self { bytes, geometry, events, t_first, tensor_events: 0, tensor_window, source, wires }
            .with_tensor_events(TENSOR_EVENTS)
    }

    fn synthetic(events: usize) -> Result<Self, String> {
        let spec = SceneSpec { rate_evs: SYNTHETIC_RATE_EVS, ..SceneSpec::default() };
        let scene = simulation::Scene::try_new(&spec).map_err(|e| e.to_string())?;
        let mut camera = Camera::new(&scene);
        let mut bytes = Vec::new();
        let mut packet = vec![0; 1 << 20];
        for _ in 0..events.div_ceil(SYNTHETIC_RATE_EVS as usize / 1000) {
            let sent = camera.next_packet(&mut packet).bytes;
            bytes.extend_from_slice(&packet[..sent]);
        }
        let all = decode(Encoding::Evt3, spec.geometry, &bytes)?;
        let t_first = all.first().map_or(0, |event| u64::from(event.t()));
        let source = format!("synthetic scene, since {RECORDING} is absent, {} events", all.len());
        Ok(Self::new(bytes, spec.geometry, all, t_first, source))
    }

    /// The stream of another format, of as many events.
    ///
    /// # Errors
    /// A sentence, where its recording is there and cannot be used.
    pub fn wire(&self, encoding: Encoding) -> Result<&Wire, String> {
        let at = Encoding::ALL.iter().position(|other| *other == encoding);
        let cell = at.and_then(|at| self.wires.get(at)).ok_or("a format without a name")?;
        match cell.get() {
            Some(wire) => Ok(wire),
            None => {
                let wire = Wire::load(encoding, self, self.events.len())?;
                Ok(cell.get_or_init(|| wire))
            }
        }
    }

    /// The first `events` events as one block's worth.
    pub fn span(&self, events: usize) -> Span<'_> {
        let events = &self.events[..events.min(self.events.len())];
        let t_last = events.last().map_or(self.t_first, |e| lobula_core::full_time(self.t_first, e.t()));
        Span { t_first: self.t_first, t_last, geometry: self.geometry, events }
    }
}

/// `span` cut into packets of at most [`PACKET_EVENTS`], each with times of its own as a decoder would give them.
pub fn packets<'a>(span: Span<'a>) -> impl Iterator<Item = Span<'a>> {
    span.events.chunks(PACKET_EVENTS).map(move |events| {
        let time = |e: Option<&Event>| e.map_or(span.t_first, |e| span.time(*e));
        Span { t_first: time(events.first()), t_last: time(events.last()), events, ..span }
    })
}

/// Copies `packet` into `buffer`, as a block to filter in place.
pub fn block_of<'b>(packet: Span<'_>, buffer: &'b mut [Event]) -> Block<'b> {
    let events = &mut buffer[..packet.events.len()];
    events.copy_from_slice(packet.events);
    Block::new(packet.t_first, packet.t_last, packet.geometry, events)
}

/// Where the recording is: `$LOBULA_SHARED/data`, else `../shared/data` beside the repository.
pub fn recording() -> Option<PathBuf> {
    file_of(RECORDING)
}

/// Where the recording of this name is, if it is there.
pub fn file_of(name: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let path = std::env::var_os("LOBULA_SHARED").map_or_else(beside, PathBuf::from).join("data").join(name);
    path.exists().then_some(path)
}

/// What follows a RAW file's header.
pub fn body(file: &[u8]) -> &[u8] {
    let mut body = file;
    while body.first() == Some(&b'%') {
        let end = body.iter().position(|b| *b == b'\n').map_or(body.len(), |i| i + 1);
        body = &body[end..];
    }
    body
}

fn words_after_header(file: &[u8]) -> Vec<u16> {
    body(file).as_chunks::<2>().0.iter().map(|word| u16::from_le_bytes(*word)).collect()
}

fn to_bytes(words: &[u16]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Word types of EVT3 that tell the time; of either, 12 bits of it.
const TIME_LOW: u16 = 0x6;
const TIME_HIGH: u16 = 0x8;

const fn kind(word: u16) -> u16 {
    word >> 12
}

const fn payload(word: u16) -> u64 {
    (word & 0x0fff) as u64
}

const fn time_word(kind: u16, bits: u64) -> u16 {
    (kind << 12) | (bits & 0x0fff) as u16
}

/// How a recording is put end to end with itself: the next copy starts at the time its last word tells.
///
/// Only words that tell the time are rewritten; where a copy's shift carries a time over a multiple of 4096 µs the
/// recording has no TIME_HIGH there, and one is put in.
struct Repetition {
    /// Time that the first words tell, in µs.
    t_first: u64,
    /// Distance of two copies in µs.
    period: u64,
}

impl Repetition {
    fn of(words: &[u16]) -> Option<Self> {
        let times = times(words);
        let (first, last) = (times.first()?.1, times.last()?.1);
        Some(Self { t_first: first, period: last - first })
    }

    fn repeat(&self, words: &[u16], copies: usize) -> Vec<u16> {
        let times = times(words);
        let mut out = Vec::with_capacity((words.len() + 4) * copies);
        let mut high = None;
        for shift in (0..copies as u64).map(|copy| copy * self.period) {
            let mut from = 0;
            for (at, time) in &times {
                out.extend_from_slice(&words[from..*at]);
                from = at + 1;
                let time = time + shift;
                let is_high = kind(words[*at]) == TIME_HIGH;
                if is_high || high != Some(time >> 12) {
                    out.push(time_word(TIME_HIGH, time >> 12));
                    high = Some(time >> 12);
                }
                if !is_high {
                    out.push(time_word(TIME_LOW, time));
                }
            }
            out.extend_from_slice(&words[from..]);
        }
        out
    }

    /// Whether the copies are the recording's events, each later by the period: nothing lost, nothing made up.
    fn check(&self, once: &[Event], all: &[Event], copies: usize) -> Result<(), String> {
        if all.len() != once.len() * copies {
            return Err(format!("{copies} copies of {} events gave {}", once.len(), all.len()));
        }
        for (copy, events) in all.chunks(once.len()).enumerate() {
            let shift = (copy as u64 * self.period) as u32;
            let same = |(a, b): (&Event, &Event)| {
                *b == Event::new(a.t().wrapping_add(shift), a.x(), a.y(), a.polarity())
            };
            if !once.iter().zip(events).all(same) {
                return Err(format!("copy {copy} is not the recording {shift} µs later"));
            }
        }
        Ok(())
    }
}

/// Position and full time of every word that tells the time. A TIME_HIGH counts with the TIME_LOW that follows it.
fn times(words: &[u16]) -> Vec<(usize, u64)> {
    let mut high = lobula_core::Unwrap::<12>::default();
    let mut low = 0;
    let mut times = Vec::new();
    for (at, word) in words.iter().enumerate() {
        match kind(*word) {
            TIME_HIGH => {
                high.push(payload(*word));
                low = words
                    .get(at + 1)
                    .filter(|next| kind(**next) == TIME_LOW)
                    .map_or(low, |next| payload(*next));
            }
            TIME_LOW => low = payload(*word),
            _ => continue,
        }
        times.push((at, (high.value() << 12) | low));
    }
    times
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_shifts_times_and_leaves_the_rest() {
        // 4095 µs, an event, 4096 µs, an event, then 4096 + 3 µs.
        let words = [0x8000, 0x6fff, 0x0001, 0x2002, 0x8001, 0x6000, 0x2003, 0x6003];
        let repetition = Repetition::of(&words).unwrap();
        assert_eq!((repetition.t_first, repetition.period), (4095, 4));
        let twice = repetition.repeat(&words, 2);
        assert_eq!(twice[..8], words);
        // The second copy starts at 4099 µs.
        assert_eq!(twice[8..], [0x8001, 0x6003, 0x0001, 0x2002, 0x8001, 0x6004, 0x2003, 0x6007]);
    }

    #[test]
    fn a_time_carried_over_4096_gets_its_high_word() {
        let words = [0x8000, 0x6ff0, 0x0001, 0x2002, 0x6ff8, 0x2003, 0x6fff];
        let twice = Repetition::of(&words).unwrap().repeat(&words, 2);
        assert_eq!(twice[7..], [0x8000, 0x6fff, 0x0001, 0x2002, 0x8001, 0x6007, 0x2003, 0x600e]);
    }
}
