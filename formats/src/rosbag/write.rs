//! Writes ROS 1 bags: events as `dvs_msgs/EventArray`, samples as `sensor_msgs/Imu`, frames as `sensor_msgs/Image`.

use super::{MAGIC, OP_BAG, OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION, OP_INDEX, OP_MESSAGE};
use crate::output::Output;
use crate::ros::definition::{Definition, ros1};
use crate::ros::serial::{self, stamp};
use crate::ros::{self, Packing, Wire, packing_of};
use crate::write::{Encoder, Kept, WriteOptions, required};
use crate::{Error, Frame, ImuSample};
use lobula_core::{Geometry, Span};
use std::path::Path;

/// Bytes of the bag's header with the space after it.
const HEADER_BYTES: usize = 4096;
/// Bytes of a chunk before it is packed: as rosbag's own.
const CHUNK_BYTES: usize = 768 << 10;
/// Most events of a message, and most µs from its first to its last.
const MESSAGE_EVENTS: u32 = 8192;
const MESSAGE_US: u64 = 10_000;
/// Bits of seconds in a stamp.
const S_BITS: u32 = 32;

/// What is sent under which name; the place is the connection's number.
const TOPICS: [(&str, Definition); 3] =
    [("/dvs/events", ros1::EVENT_ARRAY), ("/dvs/imu", ros1::IMU_SAMPLE), ("/dvs/image_raw", ros1::FRAME)];
const EVENTS: usize = 0;
const IMU: usize = 1;
const FRAMES: usize = 2;

/// Starts a bag; of the compressions it has none, bz2 and lz4.
pub(crate) fn create(
    path: &Path,
    geometry: Option<Geometry>,
    options: &WriteOptions,
) -> Result<Box<dyn Encoder>, Error> {
    let geometry = required(geometry, path)?;
    let packing = packing_of(options, &[Packing::Plain, Packing::Bz2, Packing::Lz4], path)?;
    let mut output = Output::create(path, options.overwrite)?;
    output.write(MAGIC)?;
    output.write(&header(0, 0, 0))?;
    Ok(Box::new(BagEncoder {
        output,
        geometry,
        packing,
        events: Vec::new(),
        events_len: 0,
        t_first: 0,
        t_last: 0,
        written: 0,
        messages: [0; TOPICS.len()],
        chunk: Chunk::default(),
        infos: Vec::new(),
        infos_len: 0,
    }))
}

#[derive(Debug)]
struct BagEncoder {
    output: Output,
    geometry: Geometry,
    packing: Packing,
    /// Events of the message that is being gathered, serialised.
    events: Vec<u8>,
    events_len: u32,
    t_first: u64,
    t_last: u64,
    /// Events taken.
    written: u64,
    /// Messages of each topic.
    messages: [u32; TOPICS.len()],
    chunk: Chunk,
    /// Records of what the chunks hold, and how many: about 60 bytes for each 768 KiB.
    infos: Vec<u8>,
    infos_len: u32,
}

/// A chunk that is being gathered.
#[derive(Debug, Default)]
struct Chunk {
    records: Vec<u8>,
    /// For each connection time and offset of its messages.
    index: [Vec<([u8; 8], u32)>; TOPICS.len()],
    /// Seconds and nanoseconds of the first and last message.
    times: Option<[(u32, u32); 2]>,
}

impl BagEncoder {
    /// Adds a message recorded at this time.
    fn message(&mut self, topic: usize, t_us: u64, data: &[u8]) -> Result<(), Error> {
        // rosbag holds a time of 0 for none.
        let time = stamp(t_us).max((0, 1));
        if self.messages[topic] == 0 {
            connection(&mut self.chunk.records, topic);
        }
        self.messages[topic] += 1;
        let offset = self.chunk.records.len() as u32;
        let op = [OP_MESSAGE];
        let fields: [(&str, &[u8]); 3] =
            [("op", &op), ("conn", &(topic as u32).to_le_bytes()), ("time", &time_bytes(time))];
        record(&mut self.chunk.records, &fields, data);
        self.chunk.index[topic].push((time_bytes(time), offset));
        let [low, high] = self.chunk.times.unwrap_or([time; 2]);
        self.chunk.times = Some([low.min(time), high.max(time)]);
        if self.chunk.records.len() >= CHUNK_BYTES { self.flush_chunk() } else { Ok(()) }
    }

    /// Sends the events gathered so far as a message.
    fn flush_events(&mut self) -> Result<(), Error> {
        if self.events_len == 0 {
            return Ok(());
        }
        let events = std::mem::take(&mut self.events);
        let seq = self.messages[EVENTS];
        let data = serial::event_array(&events, self.events_len, self.geometry, seq, self.t_last);
        self.message(EVENTS, self.t_last, &data)?;
        self.events = events;
        self.events.clear();
        self.events_len = 0;
        Ok(())
    }

    fn flush_chunk(&mut self) -> Result<(), Error> {
        let Chunk { records, index, times } = std::mem::take(&mut self.chunk);
        let Some([start, end]) = times else { return Ok(()) };
        let position = self.output.len();
        let packed = self
            .packing
            .pack(&records)
            .map_err(|source| Error::io(self.output.path(), "packing it", source))?;
        let mut bytes = Vec::with_capacity(packed.len() + 4096);
        let size = (records.len() as u32).to_le_bytes();
        let compression = self.packing.name().as_bytes();
        record(&mut bytes, &[("op", &[OP_CHUNK]), ("compression", compression), ("size", &size)], &packed);
        let mut counts = Vec::new();
        let mut used = 0u32;
        for (connection, index) in (0u32..).zip(&index).filter(|(_, index)| !index.is_empty()) {
            let entries: Vec<u8> = index
                .iter()
                .flat_map(|(time, offset)| time.iter().copied().chain(offset.to_le_bytes()))
                .collect();
            let (connection, count) = (connection.to_le_bytes(), (index.len() as u32).to_le_bytes());
            let fields: [(&str, &[u8]); 4] =
                [("op", &[OP_INDEX]), ("ver", &VERSION), ("conn", &connection), ("count", &count)];
            record(&mut bytes, &fields, &entries);
            counts.extend(connection.into_iter().chain(count));
            used += 1;
        }
        let fields: [(&str, &[u8]); 6] = [
            ("op", &[OP_CHUNK_INFO]),
            ("ver", &VERSION),
            ("chunk_pos", &position.to_le_bytes()),
            ("start_time", &time_bytes(start)),
            ("end_time", &time_bytes(end)),
            ("count", &used.to_le_bytes()),
        ];
        record(&mut self.infos, &fields, &counts);
        self.infos_len += 1;
        self.output.write(&bytes)
    }

    /// Refuses a time that 32 bits of seconds do not tell.
    fn check_time(&self, t_us: u64) -> Result<(), Error> {
        ros::check_time(t_us, S_BITS, self.written, self.output.path())
    }
}

impl Encoder for BagEncoder {
    fn events(&mut self, span: Span<'_>) -> Result<(), Error> {
        for event in span.events {
            let t = span.time(*event);
            self.check_time(t)?;
            let full = self.events_len == MESSAGE_EVENTS || t.abs_diff(self.t_first) > MESSAGE_US;
            if self.events_len > 0 && full {
                self.flush_events()?;
            }
            if self.events_len == 0 {
                self.t_first = t;
            }
            let (s, ns) = stamp(t);
            let mut bytes = [0; 13];
            bytes[..2].copy_from_slice(&event.x().to_le_bytes());
            bytes[2..4].copy_from_slice(&event.y().to_le_bytes());
            bytes[4..8].copy_from_slice(&s.to_le_bytes());
            bytes[8..12].copy_from_slice(&ns.to_le_bytes());
            bytes[12] = event.is_on().into();
            self.events.extend(bytes);
            self.events_len += 1;
            self.t_last = t;
            self.written += 1;
        }
        Ok(())
    }

    fn imu(&mut self, sample: &ImuSample) -> Result<Kept, Error> {
        self.check_time(sample.t)?;
        let data = serial::imu(sample, self.messages[IMU], Wire::Ros1);
        self.message(IMU, sample.t, &data)?;
        Ok(Kept::Without(serial::parts_of_imu(sample)))
    }

    fn frame(&mut self, frame: &Frame) -> Result<Kept, Error> {
        self.check_time(frame.t)?;
        let data = serial::image(frame, self.messages[FRAMES], Wire::Ros1);
        self.message(FRAMES, frame.t, &data)?;
        Ok(Kept::Without(serial::parts_of_image(frame)))
    }

    fn finish(mut self: Box<Self>) -> Result<u64, Error> {
        self.flush_events()?;
        self.flush_chunk()?;
        let index_pos = self.output.len();
        let mut index = Vec::new();
        let used: Vec<_> = (0..TOPICS.len()).filter(|topic| self.messages[*topic] > 0).collect();
        used.iter().for_each(|topic| connection(&mut index, *topic));
        index.append(&mut self.infos);
        self.output.write(&index)?;
        self.output.write_at(MAGIC.len() as u64, &header(index_pos, used.len() as u32, self.infos_len))?;
        self.output.finish()
    }
}

/// Version of the records of the index.
const VERSION: [u8; 4] = 1u32.to_le_bytes();

fn time_bytes((s, ns): (u32, u32)) -> [u8; 8] {
    (u64::from(ns) << 32 | u64::from(s)).to_le_bytes()
}

/// Named fields, one after the other.
fn fields_bytes(fields: &[(&str, &[u8])]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (name, value) in fields {
        bytes.extend(((name.len() + 1 + value.len()) as u32).to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.push(b'=');
        bytes.extend(*value);
    }
    bytes
}

fn record(out: &mut Vec<u8>, fields: &[(&str, &[u8])], data: &[u8]) {
    let fields = fields_bytes(fields);
    out.extend((fields.len() as u32).to_le_bytes());
    out.extend(fields);
    out.extend((data.len() as u32).to_le_bytes());
    out.extend(data);
}

fn connection(out: &mut Vec<u8>, topic: usize) {
    let (name, definition) = TOPICS[topic];
    let data = fields_bytes(&[
        ("topic", name.as_bytes()),
        ("type", definition.name.as_bytes()),
        ("md5sum", definition.md5.as_bytes()),
        ("message_definition", definition.text().as_bytes()),
    ]);
    let number = (topic as u32).to_le_bytes();
    record(out, &[("op", &[OP_CONNECTION]), ("conn", &number), ("topic", name.as_bytes())], &data);
}

/// The bag's header, always as long.
fn header(index_pos: u64, connections: u32, chunks: u32) -> Vec<u8> {
    let (index_pos, connections, chunks) =
        (index_pos.to_le_bytes(), connections.to_le_bytes(), chunks.to_le_bytes());
    let fields: [(&str, &[u8]); 4] = [
        ("op", &[OP_BAG]),
        ("index_pos", &index_pos),
        ("conn_count", &connections),
        ("chunk_count", &chunks),
    ];
    let space = HEADER_BYTES - 8 - fields_bytes(&fields).len();
    let mut bytes = Vec::new();
    record(&mut bytes, &fields, &vec![b' '; space]);
    bytes
}
