//! A scene as the bytes of a camera: EVT3, a packet at a time, for ever.

use super::scene::{PERIOD_STEP_US, Scene};
use crate::wire::evt3::Encoder;
use crate::{Encode, Geometry, Span};
use alloc::vec;
use alloc::vec::Vec;

/// What a camera sent in one packet's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CameraPacket {
    /// Bytes written; any cut between two words is possible, as on a USB endpoint.
    pub bytes: usize,
    /// Stream time in µs at which the packet is complete, from the start of the camera: when it is due.
    pub t_end_us: u64,
    /// False when the buffer was too small: the same packet goes on in the next call.
    pub complete: bool,
}

/// A synthetic camera: one loop of EVT3 bytes, replayed with its time moved on.
///
/// It starts at time 0, and its time goes on over the loops.
///
/// ```
/// use lobula_core::{Decode, Event, Geometry, Sink};
/// use lobula_core::simulation::{Camera, Scene, SceneSpec};
/// use lobula_core::wire::evt3::Decoder;
///
/// let spec = SceneSpec { geometry: Geometry::new(64, 48), rate_evs: 1_000_000, ..SceneSpec::default() };
/// let mut camera = Camera::new(&Scene::try_new(&spec)?);
/// let mut bytes = [0; 65536];
/// let packet = camera.next_packet(&mut bytes);
/// assert_eq!(packet.t_end_us, 1000);
///
/// let mut decoder = Decoder::new(camera.geometry());
/// let mut events = [Event::default(); 4096];
/// let mut sink = Sink::new(&mut events);
/// decoder.decode(&bytes[..packet.bytes], &mut sink);
/// assert!(!sink.is_empty() && decoder.now() < 1000);
/// # Ok::<(), lobula_core::simulation::SpecError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Camera {
    geometry: Geometry,
    /// The words of one loop, little-endian.
    words: Vec<[u8; 2]>,
    /// Where the loop's time is told, in order.
    lows: Vec<Low>,
    /// The loop's TIME_HIGH words, which alone differ from loop to loop.
    highs: Vec<High>,
    period_us: u64,
    packet_us: u64,
    /// The next word.
    place: usize,
    loops: u64,
    t_end_us: u64,
}

/// A TIME_LOW word: which, and what time is from there on.
#[derive(Clone, Copy, Debug)]
struct Low {
    word: usize,
    t: u64,
}

/// A TIME_HIGH word: which, and its value in the first loop.
#[derive(Clone, Copy, Debug)]
struct High {
    word: usize,
    value: u64,
}

/// The type of an EVT3 word is its upper four bits; its payload the lower twelve.
const TIME_LOW: u16 = 0x6;
const TIME_HIGH: u16 = 0x8;
const PAYLOAD: u16 = 0xfff;

/// One step of TIME_HIGH.
const HIGH_US: u64 = PERIOD_STEP_US as u64;

impl Camera {
    /// Time of a packet unless told otherwise.
    pub const PACKET_US: u32 = 1000;

    /// The camera that looks at `scene`, in packets of [`PACKET_US`](Self::PACKET_US).
    pub fn new(scene: &Scene) -> Self {
        let words = encode(scene);
        let (mut lows, mut highs, mut high) = (Vec::new(), Vec::new(), 0);
        for (word, bytes) in words.iter().enumerate() {
            let bits = u16::from_le_bytes(*bytes);
            let payload = u64::from(bits & PAYLOAD);
            match bits >> 12 {
                TIME_LOW => lows.push(Low { word, t: high * HIGH_US + payload }),
                TIME_HIGH => {
                    high = payload;
                    highs.push(High { word, value: high });
                }
                _ => {}
            }
        }
        Self {
            geometry: scene.geometry(),
            words,
            lows,
            highs,
            period_us: scene.period_us(),
            packet_us: Self::PACKET_US as u64,
            place: 0,
            loops: 0,
            t_end_us: 0,
        }
    }

    /// The same camera in packets of `us`, at least 1.
    pub fn with_packet_us(self, us: u32) -> Self {
        Self { packet_us: us.max(1) as u64, ..self }
    }

    /// The sensor's size.
    pub const fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// Bytes of one loop.
    pub const fn loop_bytes(&self) -> usize {
        2 * self.words.len()
    }

    /// Writes the bytes of the next stretch of stream time to `out`, of any length from 2 bytes on.
    ///
    /// It costs a copy: 12 µs for the 90 kB of 1 ms at 30 Mev/s, 0.3 ns a word (Xeon with AVX-512, 2 shared cores).
    pub fn next_packet(&mut self, out: &mut [u8]) -> CameraPacket {
        let t_end_us = self.t_end_us + self.packet_us;
        let (slots, _) = out.as_chunks_mut::<2>();
        let mut written = 0;
        loop {
            let end = self.place_of(t_end_us);
            let spare = slots.get_mut(written..).unwrap_or_default();
            let len = (end - self.place).min(spare.len());
            self.copy(spare.get_mut(..len).unwrap_or_default());
            written += len;
            if self.place < end {
                return CameraPacket { bytes: 2 * written, t_end_us, complete: false };
            }
            if self.place < self.words.len() || self.words.is_empty() {
                self.t_end_us = t_end_us;
                return CameraPacket { bytes: 2 * written, t_end_us, complete: true };
            }
            self.place = 0;
            self.loops += 1;
        }
    }

    /// The first word of this loop, from the next one on, that tells a time of `t_end` or later.
    fn place_of(&self, t_end: u64) -> usize {
        let t_end = t_end.saturating_sub(self.loops * self.period_us);
        let low = self.lows.partition_point(|low| low.t < t_end);
        self.lows.get(low).map_or(self.words.len(), |low| low.word).max(self.place)
    }

    /// Writes the next words, as many as there are slots.
    fn copy(&mut self, slots: &mut [[u8; 2]]) {
        let start = self.place;
        let words = self.words.get(start..).unwrap_or_default();
        for (slot, word) in slots.iter_mut().zip(words) {
            *slot = *word;
        }
        let first = self.highs.partition_point(|high| high.word < start);
        for high in self.highs.get(first..).unwrap_or_default() {
            let Some(slot) = slots.get_mut(high.word - start) else { break };
            let value = (self.loops * self.period_us / HIGH_US + high.value) as u16 & PAYLOAD;
            *slot = (TIME_HIGH << 12 | value).to_le_bytes();
        }
        self.place += slots.len();
    }
}

/// The loop as EVT3 words; since it starts with a new encoder it tells time and row from its first word on.
fn encode(scene: &Scene) -> Vec<[u8; 2]> {
    let mut encoder = Encoder::new();
    let mut bytes = vec![0; 1 << 16];
    let mut words = Vec::new();
    let mut put = |bytes: &[u8]| {
        words.extend_from_slice(bytes.as_chunks().0);
    };
    let mut events = scene.events();
    while !events.is_empty() {
        let span = Span { t_first: 0, t_last: scene.period_us(), geometry: scene.geometry(), events };
        let done = encoder.encode(span, &mut bytes);
        put(bytes.get(..done.bytes).unwrap_or_default());
        if done.refused.is_some() || (done.events == 0 && done.bytes == 0) {
            break; // cannot be: a scene is sorted, on the sensor and below 2^24 µs
        }
        events = events.get(done.events..).unwrap_or_default();
    }
    loop {
        match encoder.finish(&mut bytes) {
            0 => return words,
            n => put(bytes.get(..n).unwrap_or_default()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::SceneSpec;
    use crate::wire::evt3::Decoder;
    use crate::{Decode, Event, Sink};

    fn scene() -> Scene {
        let spec = SceneSpec { geometry: Geometry::new(96, 64), rate_evs: 1_000_000, ..SceneSpec::default() };
        Scene::try_new(&spec).unwrap()
    }

    /// Full times and events of the first `us` of stream time, given to the decoder in pieces of at most `piece`.
    fn decoded(mut camera: Camera, us: u64, piece: usize) -> Vec<(u64, Event)> {
        let mut decoder = Decoder::new(camera.geometry());
        let (mut out, mut memory) = (Vec::new(), vec![Event::default(); 1 << 15]);
        let mut bytes = vec![0; piece];
        loop {
            let packet = camera.next_packet(&mut bytes);
            let mut sink = Sink::new(&mut memory);
            assert_eq!(decoder.decode(&bytes[..packet.bytes], &mut sink), packet.bytes);
            let block = sink.block(camera.geometry());
            let span = block.span();
            for event in span.events {
                let t = span.time(*event);
                assert!(
                    packet.t_end_us.saturating_sub(camera.packet_us) <= t && t < packet.t_end_us,
                    "{event:?}"
                );
                out.push((t, *event));
            }
            if packet.complete && packet.t_end_us >= us {
                assert_eq!(decoder.counters().faults.total(), 0);
                return out;
            }
        }
    }

    /// Beyond 2^24 µs, where TIME_HIGH wraps.
    #[test]
    fn the_loop_goes_on_for_ever_in_time() {
        let scene = scene();
        let period = scene.period_us();
        let loops = (1 << 24) / period + 2;
        let events = decoded(Camera::new(&scene), loops * period, 1 << 16);
        let mut wanted = (0..=loops).flat_map(|turn| {
            scene.events().iter().map(move |e| {
                let t = turn * period + e.t() as u64;
                (t, Event::new(t as u32, e.x(), e.y(), e.polarity()))
            })
        });
        assert!(events.iter().all(|event| wanted.next() == Some(*event)));
        assert!(events.last().is_some_and(|(t, _)| *t > (1 << 24) + period));
    }

    #[test]
    fn packets_and_buffers_of_any_size_give_the_same_events() {
        let scene = scene();
        let us = 2 * scene.period_us();
        let whole = decoded(Camera::new(&scene), us, 1 << 16);
        for (packet_us, piece) in [(1000, 2), (1000, 7), (128, 64), (3_333, 1 << 16)] {
            let mut events = decoded(Camera::new(&scene).with_packet_us(packet_us), us, piece);
            events.truncate(whole.len());
            assert_eq!(events, whole[..events.len()], "{packet_us} us, {piece} bytes");
        }
    }

    #[test]
    fn rows_travel_as_vectors() {
        let camera = Camera::new(&scene());
        let vectors =
            camera.words.iter().filter(|word| matches!(u16::from_le_bytes(**word) >> 12, 0x4 | 0x5)).count();
        assert!(vectors > camera.words.len() / 50, "{vectors} of {}", camera.words.len());
    }
}
