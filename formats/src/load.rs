//! A whole recording in memory, decoded on all cores.

use crate::container::{Piece, Stop};
use crate::{Error, LargeArray, Recording};
use lobula_core::{Counters, Event, Fault, Geometry, Sink, Span, Trigger};
use rayon::prelude::*;

/// Events that one allocation holds: 8 MiB.
const PART_EVENTS: usize = 1 << 20;
/// Triggers between two looks at them.
const TRIGGERS: usize = 1024;
/// Bytes of a file that are worth a piece of work.
const PIECE_BYTES: u64 = 1 << 20;
/// Pieces of work for each thread, so that one that takes long does not leave the others idle.
const PIECES_A_THREAD: usize = 4;

/// Every event and trigger of a recording, in file order.
///
/// ```no_run
/// let loaded = lobula_formats::open("driving.raw")?.load()?;
/// let on: usize = loaded.spans().map(|span| span.events.iter().filter(|event| event.is_on()).count()).sum();
/// println!("{on} of {} events are ON", loaded.len());
/// # Ok::<(), lobula_formats::Error>(())
/// ```
#[derive(Debug)]
pub struct Loaded {
    geometry: Geometry,
    parts: Vec<Part>,
    triggers: Vec<Trigger>,
    counters: Counters,
}

/// Some events in order, in memory of their own.
#[derive(Debug)]
struct Part {
    events: LargeArray<Event>,
    runs: Vec<Run>,
}

/// Events of a part that share an anchor of time.
#[derive(Clone, Copy, Debug)]
struct Run {
    len: usize,
    t_first: u64,
    t_last: u64,
}

impl Recording {
    /// Decodes all of it, on as many threads as rayon has: the same events in the same order as
    /// [`blocks`](Self::blocks) gives, whatever their number. Takes 8 bytes an event.
    ///
    /// # Errors
    /// Those of reading the file, and of the system where there is no room.
    pub fn load(&self) -> Result<Loaded, Error> {
        let worth = usize::try_from(self.bytes() / PIECE_BYTES).unwrap_or(usize::MAX);
        self.load_in(worth.clamp(1, PIECES_A_THREAD * rayon::current_num_threads()))
    }

    /// Loads in about so many pieces.
    fn load_in(&self, pieces: usize) -> Result<Loaded, Error> {
        let container = self.container();
        let pieces = container.pieces(pieces)?;
        let geometry = container.geometry_of_blocks();
        let path = self.path();
        let out_of_room = |source| Error::io(path, "taking memory for it", source);
        let decoded = pieces.into_par_iter().map(|piece| Decoded::of(piece, geometry, &out_of_room));
        let mut decoded = decoded.collect::<Result<Vec<_>, _>>()?;
        if !settle(&mut decoded) {
            // A piece began in the dark (a stream whose first vector comes late): in one piece, then.
            decoded =
                vec![Decoded::of(Piece { cursor: container.start(), wrap_us: 0 }, geometry, &out_of_room)?];
        }
        Ok(join(decoded, geometry))
    }
}

/// A piece, decoded.
struct Decoded {
    parts: Vec<Part>,
    triggers: Vec<Trigger>,
    counters: Counters,
    events: u64,
    /// What is to be a multiple of this may be missing from every time; 0: nothing is.
    wrap_us: u64,
    /// What the clock said at the start and at the end.
    now: [u64; 2],
    in_the_dark: bool,
}

impl Decoded {
    fn of(
        piece: Piece,
        geometry: Geometry,
        out_of_room: &impl Fn(std::io::Error) -> Error,
    ) -> Result<Self, Error> {
        let Piece { mut cursor, wrap_us } = piece;
        let (before, now) = (cursor.counters(), cursor.now());
        let mut parts = Vec::new();
        let (mut triggers, mut some) = (Vec::new(), vec![Trigger::default(); TRIGGERS]);
        let mut events = 0;
        let mut stop = Stop::Full;
        while stop == Stop::Full {
            let mut part =
                Part { events: LargeArray::zeroed(PART_EVENTS).map_err(out_of_room)?, runs: Vec::new() };
            let mut len = 0;
            while stop == Stop::Full && PART_EVENTS - len >= Sink::LEN_MIN {
                let mut sink = Sink::with_triggers(&mut part.events[len..], &mut some);
                stop = cursor.fill(&mut sink)?;
                triggers.extend_from_slice(sink.triggers());
                let block = sink.block(geometry);
                let run = Run { len: block.len(), t_first: block.t_first, t_last: block.t_last };
                len += run.len;
                part.runs.extend((run.len > 0).then_some(run));
            }
            part.events.truncate(len);
            events += len as u64;
            parts.push(part);
        }
        // The decoder has counted the events that it took to find its bearings.
        let before_piece = before.events - before.off_sensor;
        triggers.iter_mut().for_each(|trigger| trigger.ordinal -= before_piece);
        let counters = cursor.counters().since(&before);
        let (now, in_the_dark) = ([now, cursor.now()], cursor.in_the_dark());
        Ok(Self { parts, triggers, counters, events, wrap_us, now, in_the_dark })
    }

    /// Whether no word of it needed what an earlier piece was told.
    fn knew_all(&self) -> bool {
        let needed = [Fault::BeforeTime, Fault::BeforeRow, Fault::BeforeBase];
        needed.iter().all(|fault| self.counters.faults.get(*fault) == 0)
    }

    /// Adds to every time.
    fn shift(&mut self, by: u64) {
        for part in &mut self.parts {
            // An event holds the lower half of its time.
            let events = if by as u32 == 0 { &mut [] } else { &mut part.events[..] };
            for event in events {
                *event =
                    Event::new(event.t().wrapping_add(by as u32), event.x(), event.y(), event.polarity());
            }
            for run in &mut part.runs {
                run.t_first = run.t_first.wrapping_add(by);
                run.t_last = run.t_last.wrapping_add(by);
            }
        }
        self.triggers.iter_mut().for_each(|trigger| trigger.t = trigger.t.wrapping_add(by));
    }
}

/// Gives every piece the whole wraps of time that it could not know; false where they do not fit.
fn settle(decoded: &mut [Decoded]) -> bool {
    let mut ordinal = 0;
    let mut shifts = Vec::new();
    let mut end = 0u64;
    for piece in decoded.iter_mut() {
        let shift = if piece.wrap_us == 0 { 0 } else { end.wrapping_sub(piece.now[0]) };
        let fits = piece.wrap_us == 0 || shift.is_multiple_of(piece.wrap_us) && piece.knew_all();
        if piece.in_the_dark || !fits {
            return false;
        }
        piece.triggers.iter_mut().for_each(|trigger| trigger.ordinal += ordinal);
        ordinal += piece.events;
        end = piece.now[1].wrapping_add(shift);
        shifts.push(shift);
    }
    let moved = decoded.par_iter_mut().zip(shifts).filter(|(_, shift)| *shift != 0);
    moved.for_each(|(piece, shift)| piece.shift(shift));
    true
}

fn join(decoded: Vec<Decoded>, geometry: Geometry) -> Loaded {
    let mut loaded = Loaded { geometry, parts: Vec::new(), triggers: Vec::new(), counters: Counters::new() };
    for piece in decoded {
        loaded.parts.extend(piece.parts);
        loaded.triggers.extend(piece.triggers);
        loaded.counters.add(&piece.counters);
    }
    loaded
}

impl Loaded {
    /// Number of events.
    pub fn len(&self) -> usize {
        self.parts.iter().map(|part| part.events.len()).sum()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The events in file order, in as many pieces as their memory and their times need.
    pub fn spans(&self) -> impl Iterator<Item = Span<'_>> {
        let geometry = self.geometry;
        self.parts.iter().flat_map(move |part| {
            let mut rest = &part.events[..];
            part.runs.iter().map(move |run| {
                let (events, after) = rest.split_at(run.len);
                rest = after;
                Span { t_first: run.t_first, t_last: run.t_last, geometry, events }
            })
        })
    }

    /// The triggers in file order.
    pub fn triggers(&self) -> &[Trigger] {
        &self.triggers
    }

    /// What the decoder did.
    pub fn counters(&self) -> Counters {
        self.counters
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Digest, WriteOptions, Writer, open};
    use lobula_core::Polarity;
    use lobula_core::wire::Encoding;
    use lobula_tests::data;
    use std::path::Path;

    /// Events, triggers and counts as they come in order, and as they come from pieces.
    fn check(path: &Path) {
        let recording = open(path).unwrap();
        let (mut digest, mut triggers, mut blocks) = (Digest::default(), Vec::new(), recording.blocks());
        while let Some(chunk) = blocks.next_block().unwrap() {
            digest.update(chunk.span());
            triggers.extend_from_slice(chunk.triggers);
        }
        let expected = digest.finish();
        for pieces in [1, 2, 3, 16, 97] {
            let loaded = recording.load_in(pieces).unwrap();
            let mut digest = Digest::default();
            loaded.spans().for_each(|span| digest.update(span));
            assert_eq!(digest.finish(), expected, "{} in {pieces} pieces", path.display());
            assert_eq!(loaded.triggers(), triggers, "{} in {pieces} pieces", path.display());
            assert_eq!(loaded.counters(), blocks.counters(), "{} in {pieces} pieces", path.display());
        }
    }

    #[test]
    fn real_recordings_load_as_they_read() {
        let raw = ["evt2_gen3_640x480", "evt21_le_1280x720", "evt21_legacy_1280x720", "evt3_gen41_1280x720"];
        for file in raw.into_iter().chain(["evt3_trigger_1280x720"]) {
            let Some(path) = data(&format!("{file}.raw")) else { return };
            assert!(open(&path).unwrap().container().pieces(16).unwrap().len() > 8, "{file} is cut");
            check(&path);
        }
    }

    /// Whole, damaged in the middle of a packet, and cut.
    #[cfg(feature = "aedat4")]
    #[test]
    fn packets_load_as_they_read() {
        let folder = tempfile::tempdir().unwrap();
        for file in ["aedat4_davis346_none", "aedat4_davis346_lz4", "aedat4_davis346_zstd"] {
            let Some(path) = data(&format!("{file}.aedat4")) else { return };
            assert!(open(&path).unwrap().container().pieces(16).unwrap().len() > 8, "{file} is cut");
            check(&path);
            let mut bytes = std::fs::read(&path).unwrap();
            let middle = bytes.len() / 2;
            bytes[middle..middle + 60_000].fill(0x55);
            bytes.truncate(middle + 300_000);
            let path = folder.path().join(file);
            std::fs::write(&path, bytes).unwrap();
            check(&path);
        }
    }

    /// Bags, whole, and with a byte changed beside the start of a record of the file itself, where a piece may begin.
    #[cfg(feature = "ros")]
    #[test]
    fn bags_load_as_they_read() {
        let folder = tempfile::tempdir().unwrap();
        let geometry = Geometry::new(346, 260);
        let events: Vec<_> = (0..300_000u32)
            .map(|i| Event::new(i * 7, (i % 346) as u16, (i / 7 % 260) as u16, Polarity::from_bit(i as u16)))
            .collect();
        for compression in [crate::Compression::None, crate::Compression::Lz4] {
            let path = folder.path().join(format!("{}.bag", compression.name()));
            let options = WriteOptions { compression: Some(compression), ..WriteOptions::default() };
            let mut writer = Writer::create(&path, Some(geometry), &options).unwrap();
            writer.write(Span { t_first: 0, t_last: 7 * 299_999, geometry, events: &events }).unwrap();
            writer.finish().unwrap();
            assert!(open(&path).unwrap().container().pieces(16).unwrap().len() > 4);
            check(&path);
            let whole = std::fs::read(&path).unwrap();
            let starts =
                whole.windows(12).enumerate().filter(|(_, bytes)| bytes.starts_with(b"\x04\0\0\0op="));
            let starts: Vec<_> = starts.map(|(at, _)| at).collect();
            for i in 0..24 {
                let mut bytes = whole.clone();
                let at = (starts[i * 89 % starts.len()] + i * 11 % 90).saturating_sub(8).max(4200);
                bytes[at] ^= 1 << (i % 8);
                if i % 10 == 9 {
                    bytes.truncate(whole.len() * i / 30);
                }
                std::fs::write(&path, &bytes).unwrap();
                if open(&path).is_ok() {
                    check(&path);
                }
            }
        }
    }

    /// In whole chunks, whose lengths divide no piece.
    #[cfg(feature = "hdf5")]
    #[test]
    fn chunks_load_as_they_read() {
        for file in ["hdf5_gzip", "hdf5_dsec_blosc", "hdf5_e2vid_seconds", "hdf5_prophesee_compound_zstd"] {
            let Some(path) = data(&format!("{file}.h5")) else { return };
            assert!(open(&path).unwrap().container().pieces(16).unwrap().len() > 4, "{file} is cut");
            check(&path);
        }
    }

    /// Whole, and damaged in the middle, cut where the end is not needed.
    #[cfg(feature = "tables")]
    #[test]
    fn tables_load_as_they_read() {
        let folder = tempfile::tempdir().unwrap();
        let geometry = Geometry::new(1280, 720);
        for name in ["a.npy", "a.npz", "a.csv", "a.txt"] {
            let path = folder.path().join(name);
            let mut writer = Writer::create(&path, Some(geometry), &WriteOptions::default()).unwrap();
            for i in 0..30_000u64 {
                let t = 5_000_000_000 + i * i % 2_003 + i * 7;
                let polarity = Polarity::from_bit((i / 3) as u16);
                let events = [Event::new(t as u32, (i * 31 % 1280) as u16, (i * 7 % 720) as u16, polarity)];
                writer.write(Span { t_first: t, t_last: t, geometry, events: &events }).unwrap();
            }
            writer.finish().unwrap();
            assert!(open(&path).unwrap().container().pieces(16).unwrap().len() > 8, "{name} is cut");
            check(&path);
            let mut bytes = std::fs::read(&path).unwrap();
            let middle = bytes.len() / 2;
            bytes[middle..middle + 9_000].fill(b'#');
            if name != "a.npz" {
                bytes.truncate(bytes.len() - 1_007);
            }
            let path = folder.path().join(format!("damaged-{name}"));
            std::fs::write(&path, bytes).unwrap();
            check(&path);
        }
    }

    /// Steps back around every seam of the 32 bits, and what only the start tells: a step back below 0.
    #[test]
    fn wraps_of_dat_are_counted_across_pieces() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dat");
        let file = |times: &[u64]| {
            let mut bytes = b"% Data file containing CD events.\n% Version 2\n\x0C\x08".to_vec();
            bytes.extend(times.iter().flat_map(|t| [*t as u32, 0x1000_4003].map(u32::to_le_bytes)).flatten());
            bytes
        };
        let late = |i: u64| if i.is_multiple_of(3) { i * 7919 % 3_000_000 } else { 0 };
        let often: Vec<_> = (0..20_000u64).map(|i| (1 << 31) + i * 61_000_003 - late(i)).collect();
        let below: Vec<_> = (0..20_000u64).map(|i| i * 5 % 999 + i / 7_000 * ((1 << 32) - 700)).collect();
        for times in [often, below] {
            let bytes = file(&times);
            std::fs::write(&path, &bytes).unwrap();
            assert!(open(&path).unwrap().container().pieces(16).unwrap().len() == 16);
            check(&path);
            std::fs::write(&path, &bytes[..bytes.len() - 3]).unwrap();
            check(&path);
        }
        let options = crate::OpenOptions { time_shift_us: -7, ..Default::default() };
        let shifted = crate::open_with(&path, &options).unwrap();
        assert!(shifted.load_in(16).is_err(), "the first events are before 0, as blocks tell");
    }

    /// A log of packets that were not closed, in records of the file itself.
    #[cfg(feature = "ros")]
    fn packets_mcap(encoding: &str, packets: &[&[u8]], seq: impl Fn(u64) -> u64) -> Vec<u8> {
        let text = |text: &str| [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
        let record =
            |op: u8, content: &[u8]| [&[op][..], &(content.len() as u64).to_le_bytes(), content].concat();
        let mut file = b"\x89MCAP0\r\n".to_vec();
        let schema =
            [&[1, 0][..], &text("event_camera_msgs/EventPacket"), &text("ros1msg"), &text("")].concat();
        let channel = [&[1, 0, 1, 0][..], &text("/camera/events"), &text("ros1"), &text("")].concat();
        file.extend([record(1, &[0; 8]), record(3, &schema), record(4, &channel)].concat());
        for (i, packet) in packets.iter().enumerate() {
            let mut message = [&[1, 0][..], &[0; 4 + 8 + 8]].concat();
            message.extend([0, i as u32, 0, 0].map(u32::to_le_bytes).as_flattened());
            message.extend([720u32, 1280].map(u32::to_le_bytes).as_flattened());
            message.extend([seq(i as u64), i as u64 * 1_000_000].map(u64::to_le_bytes).as_flattened());
            message
                .extend([&text(encoding)[..], &[0], &(packet.len() as u32).to_le_bytes(), packet].concat());
            file.extend(record(5, &message));
        }
        file
    }

    /// Packets whose lengths are whole words or not, none of them missing or some.
    #[cfg(feature = "ros")]
    #[test]
    fn event_packets_load_as_they_read() {
        let folder = tempfile::tempdir().unwrap();
        let geometry = Geometry::new(1280, 720);
        for (name, encoding) in [("evt3", Encoding::Evt3), ("evt2", Encoding::Evt2)] {
            let raw = folder.path().join("a.raw");
            let overwrite = WriteOptions { overwrite: true, ..WriteOptions::default() };
            let options = WriteOptions { encoding: Some(encoding), ..overwrite };
            write_with_wraps(&raw, geometry, &options, 2);
            let mut payload = open(&raw).unwrap().payload().unwrap();
            let mut bytes = vec![0; (payload.range().end - payload.range().start) as usize];
            assert_eq!(payload.read(&mut bytes).unwrap(), bytes.len());
            for (packet_bytes, missing_from) in [(4096, 900), (4099, 900), (1003, 900), (4096, 30)] {
                let packets: Vec<_> = bytes.chunks(packet_bytes).collect();
                let path = folder.path().join("a.mcap");
                let seq = |i: u64| i + u64::from(i > missing_from) * 3;
                std::fs::write(&path, packets_mcap(name, &packets, seq)).unwrap();
                let pieces = open(&path).unwrap().container().pieces(16).unwrap().len();
                assert!(pieces > 8 || packet_bytes % 4 != 0, "{name} in packets of {packet_bytes}: {pieces}");
                check(&path);
            }
        }
    }

    /// Messages that are missing where pieces have none at all are counted as a pass over all of it counts them.
    #[cfg(feature = "ros")]
    #[test]
    fn gaps_between_pieces_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let packet: Vec<u8> =
            (0..200u16).flat_map(|i| [0x2000 | i, 0x3000 | i]).flat_map(u16::to_le_bytes).collect();
        let packets = [&packet[..]; 20];
        let file = |n: usize| packets_mcap("libcaer_cmp", &packets[..n], |i| i + u64::from(i >= 10) * 3);
        let (half, whole) = (file(10), file(20));
        // Anyone's own records, which are no messages.
        let filler = [&[0x80][..], &1000u64.to_le_bytes(), &[0; 1000]].concat().repeat(40);
        std::fs::write(&path, [&half, &filler, &whole[half.len()..]].concat()).unwrap();
        let recording = open(&path).unwrap();
        assert!(recording.container().pieces(16).unwrap().len() > 2);
        assert_eq!(recording.load_in(16).unwrap().len(), 20 * 200);
        assert_eq!(
            recording.warnings().last().unwrap(),
            "3 messages of events are missing by their sequence numbers"
        );
        check(&path);
    }

    /// As they are, and damaged beside the start of a chunk, where a piece may begin.
    #[cfg(feature = "ros")]
    #[test]
    fn logs_of_packets_load_as_they_read() {
        let folder = tempfile::tempdir().unwrap();
        let real = data("mcap_libcaer_cmp_davis346.mcap");
        let ours = [crate::Compression::None, crate::Compression::Zstd].map(|compression| {
            let path = folder.path().join(format!("{}.mcap", compression.name()));
            let options = WriteOptions { compression: Some(compression), ..WriteOptions::default() };
            write_with_wraps(&path, Geometry::new(1280, 720), &options, 40);
            path
        });
        for path in real.into_iter().chain(ours) {
            check(&path);
            let whole = std::fs::read(&path).unwrap();
            for i in 1..12 {
                let (at, mut bytes) = (whole.len() / 12 * i + i * 11, whole.clone());
                bytes[at] ^= 1 << (i % 8);
                if i % 5 == 4 {
                    bytes.truncate(whole.len() * i / 13);
                }
                let path = folder.path().join("damaged.mcap");
                std::fs::write(&path, &bytes).unwrap();
                if open(&path).is_ok() {
                    check(&path);
                }
            }
        }
    }

    /// Wraps, silence of more than one wrap, steps back, vectors, triggers; and single events, which tell no base.
    #[test]
    fn wraps_are_counted_across_pieces() {
        let folder = tempfile::tempdir().unwrap();
        for (i, encoding) in Encoding::ALL.iter().enumerate() {
            for step in [2, 40] {
                let path = folder.path().join(format!("{i}-{step}.raw"));
                let options = WriteOptions { encoding: Some(*encoding), ..WriteOptions::default() };
                write_with_wraps(&path, Geometry::new(1280, 720), &options, step);
                check(&path);
            }
        }
    }

    /// Events in threes, `step` columns apart, and a trigger now and then.
    fn write_with_wraps(path: &Path, geometry: Geometry, options: &WriteOptions, step: u64) {
        let mut writer = Writer::create(path, Some(geometry), options).unwrap();
        let mut t = 3_000_000_000u64;
        for i in 0..20_000u64 {
            t = match i % 4_000 {
                3_999 => t + 40_000_000,
                1_777 => t - 900,
                _ => t + i * i % 2_003,
            };
            let event = |k: u64| {
                let polarity = Polarity::from_bit((i / 3) as u16);
                Event::new(t as u32, ((i * 31 + k * step) % 1280) as u16, (i * 7 % 720) as u16, polarity)
            };
            let events = [event(0), event(1), event(2)];
            writer.write(Span { t_first: t, t_last: t, geometry, events: &events }).unwrap();
            if i % 97 == 5 {
                let edge = Polarity::from_bit(i as u16);
                writer.write_trigger(Trigger { t, ordinal: 0, channel: 1, edge }).unwrap();
            }
        }
        writer.finish().unwrap();
    }
}
