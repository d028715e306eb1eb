//! Writes MCAP as rosbag2 does: events as `event_camera_msgs/EventPacket` of EVT3, samples as `sensor_msgs/Imu`, frames
//! as `sensor_msgs/Image`.

use super::{
    MAGIC, OP_CHANNEL, OP_CHUNK, OP_CHUNK_INDEX, OP_DATA_END, OP_FOOTER, OP_HEADER, OP_MESSAGE,
    OP_MESSAGE_INDEX, OP_SCHEMA, OP_STATISTICS,
};
use crate::output::Output;
use crate::raw::{self, GEOMETRY_MAX};
use crate::ros::definition::{Definition, ros2};
use crate::ros::{self, Packing, Wire, packing_of, serial};
use crate::write::{Encoder, Kept, WriteOptions, required};
use crate::{Error, ErrorKind, Frame, ImuSample};
use lobula_core::wire::{AnyEncoder, Encoding};
use lobula_core::{Encode, Geometry, Span, Trigger};
use std::path::Path;

/// Bytes of a chunk before it is packed.
const CHUNK_BYTES: usize = 768 << 10;
/// Most bytes of a message, and most µs from its first event to its last.
const MESSAGE_BYTES: usize = 64 << 10;
const MESSAGE_US: u64 = 10_000;
/// Bytes encoded at once.
const CODE_BYTES: usize = 32 << 10;
/// Bits of seconds in a stamp of ROS 2.
const S_BITS: u32 = 31;

/// What is sent under which name; channel and schema have the number of the place, from 1.
const TOPICS: [(&str, Definition); 3] = [
    ("/event_camera/events", ros2::EVENT_PACKET),
    ("/event_camera/imu", ros2::IMU_SAMPLE),
    ("/event_camera/image_raw", ros2::FRAME),
];
const EVENTS: usize = 0;
const IMU: usize = 1;
const FRAMES: usize = 2;

/// Starts a file; of the compressions it has none, lz4 and zstd.
pub(crate) fn create(
    path: &Path,
    geometry: Option<Geometry>,
    options: &WriteOptions,
) -> Result<Box<dyn Encoder>, Error> {
    let geometry = required(geometry, path)?;
    let refused = |what: String, remedy: &str| Err(Error::new(ErrorKind::Refused, path, what, remedy));
    if let Some(encoding) = options.encoding.filter(|encoding| *encoding != Encoding::Evt3) {
        let what = format!("cannot be written: readers of event packets know evt3, not {encoding}");
        return refused(what, "leave out --encoding");
    }
    if geometry.width > GEOMETRY_MAX.width || geometry.height > GEOMETRY_MAX.height {
        let what = format!("cannot be written: evt3 holds sensors up to {GEOMETRY_MAX}, not {geometry}");
        return refused(what, "crop the events or choose another format");
    }
    let packing = packing_of(options, &[Packing::Plain, Packing::Lz4, Packing::Zstd], path)?;
    let mut output = Output::create(path, options.overwrite)?;
    let mut head = MAGIC.to_vec();
    let library = format!("lobula {}", env!("CARGO_PKG_VERSION"));
    record(&mut head, OP_HEADER, &[string("ros2"), string(&library)].concat());
    output.write(&head)?;
    Ok(Box::new(McapEncoder {
        output,
        geometry,
        packing,
        encoder: AnyEncoder::new(Encoding::Evt3),
        code: vec![0; CODE_BYTES].into_boxed_slice(),
        payload: Vec::new(),
        t_first: None,
        t_last: 0,
        written: 0,
        messages: [0; TOPICS.len()],
        chunk: Chunk::default(),
        chunk_indexes: Vec::new(),
        chunks: 0,
        times: None,
    }))
}

#[derive(Debug)]
struct McapEncoder {
    output: Output,
    geometry: Geometry,
    packing: Packing,
    encoder: AnyEncoder,
    code: Box<[u8]>,
    /// EVT3 bytes of the message that is being gathered.
    payload: Vec<u8>,
    /// Time of the first event or trigger in it.
    t_first: Option<u64>,
    t_last: u64,
    /// Events taken.
    written: u64,
    /// Messages of each topic.
    messages: [u64; TOPICS.len()],
    chunk: Chunk,
    /// Records of where the chunks are, and how many: about 120 bytes for each 768 KiB.
    chunk_indexes: Vec<u8>,
    chunks: u32,
    /// Earliest and latest message in ns.
    times: Option<[u64; 2]>,
}

/// A chunk that is being gathered.
#[derive(Debug, Default)]
struct Chunk {
    records: Vec<u8>,
    /// For each channel time and offset of its messages.
    index: [Vec<u8>; TOPICS.len()],
    /// Earliest and latest message in ns.
    times: Option<[u64; 2]>,
}

impl McapEncoder {
    /// Adds a message of this time.
    fn message(&mut self, topic: usize, t_us: u64, data: &[u8]) -> Result<(), Error> {
        if self.messages[topic] == 0 {
            names(&mut self.chunk.records, topic);
        }
        let t_ns = t_us * 1000;
        let offset = self.chunk.records.len() as u64;
        let (channel, sequence) = (topic as u16 + 1, self.messages[topic] as u32);
        let head =
            [&channel.to_le_bytes()[..], &sequence.to_le_bytes(), &t_ns.to_le_bytes(), &t_ns.to_le_bytes()]
                .concat();
        record_head(&mut self.chunk.records, OP_MESSAGE, head.len() + data.len());
        self.chunk.records.extend(head);
        self.chunk.records.extend(data);
        self.chunk.index[topic].extend(t_ns.to_le_bytes().into_iter().chain(offset.to_le_bytes()));
        self.messages[topic] += 1;
        for times in [&mut self.chunk.times, &mut self.times] {
            let [low, high] = times.unwrap_or([t_ns; 2]);
            *times = Some([low.min(t_ns), high.max(t_ns)]);
        }
        if self.chunk.records.len() >= CHUNK_BYTES { self.flush_chunk() } else { Ok(()) }
    }

    /// Sends what was encoded so far as a message.
    fn flush_events(&mut self) -> Result<(), Error> {
        if self.payload.is_empty() {
            return Ok(());
        }
        let payload = std::mem::take(&mut self.payload);
        let seq = self.messages[EVENTS];
        let data = serial::event_packet(&payload, self.geometry, seq, self.t_last, Wire::Cdr);
        self.message(EVENTS, self.t_last, &data)?;
        self.payload = payload;
        self.payload.clear();
        self.t_first = None;
        Ok(())
    }

    /// Begins a new message where the one that is gathered is long enough for an item of this time.
    fn make_room(&mut self, t: u64) -> Result<(), Error> {
        let late = self.t_first.is_some_and(|first| t.abs_diff(first) > MESSAGE_US);
        if late || self.payload.len() >= MESSAGE_BYTES {
            self.flush_events()?;
        }
        self.t_first = self.t_first.or(Some(t));
        self.t_last = t;
        Ok(())
    }

    fn flush_chunk(&mut self) -> Result<(), Error> {
        let Chunk { records, index, times } = std::mem::take(&mut self.chunk);
        let Some([start, end]) = times else { return Ok(()) };
        let packed = self
            .packing
            .pack(&records)
            .map_err(|source| Error::io(self.output.path(), "packing it", source))?;
        let compression = if self.packing == Packing::Plain { "" } else { self.packing.name() };
        let (records_len, packed_len) = (records.len() as u64, packed.len() as u64);
        let head = [
            &start.to_le_bytes()[..],
            &end.to_le_bytes(),
            &records_len.to_le_bytes(),
            &crc32fast::hash(&records).to_le_bytes(),
            &string(compression),
            &packed_len.to_le_bytes(),
        ]
        .concat();
        let offset = self.output.len();
        let mut bytes = Vec::with_capacity(packed.len() + 4096);
        record_head(&mut bytes, OP_CHUNK, head.len() + packed.len());
        bytes.extend(head);
        bytes.extend(packed);
        let chunk_len = bytes.len() as u64;
        let mut indexes = Vec::new();
        for (channel, index) in (1u16..).zip(&index).filter(|(_, index)| !index.is_empty()) {
            indexes.extend(channel.to_le_bytes());
            indexes.extend((offset + bytes.len() as u64).to_le_bytes());
            let len = (index.len() as u32).to_le_bytes();
            record(&mut bytes, OP_MESSAGE_INDEX, &[&channel.to_le_bytes()[..], &len, index].concat());
        }
        let chunk_index = [
            &start.to_le_bytes()[..],
            &end.to_le_bytes(),
            &offset.to_le_bytes(),
            &chunk_len.to_le_bytes(),
            &(indexes.len() as u32).to_le_bytes(),
            &indexes,
            &(bytes.len() as u64 - chunk_len).to_le_bytes(),
            &string(compression),
            &packed_len.to_le_bytes(),
            &records_len.to_le_bytes(),
        ]
        .concat();
        record(&mut self.chunk_indexes, OP_CHUNK_INDEX, &chunk_index);
        self.chunks += 1;
        self.output.write(&bytes)
    }

    /// What stands after the data.
    fn summary(&self) -> Vec<u8> {
        let used = || (0..TOPICS.len()).filter(|topic| self.messages[*topic] > 0);
        let mut summary = Vec::new();
        used().for_each(|topic| names(&mut summary, topic));
        let counts: Vec<u8> = used()
            .flat_map(|topic| {
                (topic as u16 + 1).to_le_bytes().into_iter().chain(self.messages[topic].to_le_bytes())
            })
            .collect();
        let [start, end] = self.times.unwrap_or_default();
        let topics = used().count();
        let statistics = [
            &self.messages.iter().sum::<u64>().to_le_bytes()[..],
            &(topics as u16).to_le_bytes(),
            &(topics as u32).to_le_bytes(),
            &[0; 8], // attachments and metadata
            &self.chunks.to_le_bytes(),
            &start.to_le_bytes(),
            &end.to_le_bytes(),
            &(counts.len() as u32).to_le_bytes(),
            &counts,
        ]
        .concat();
        record(&mut summary, OP_STATISTICS, &statistics);
        summary.extend(&self.chunk_indexes);
        summary
    }

    /// Refuses a time that a stamp does not tell.
    fn check_time(&self, t_us: u64) -> Result<(), Error> {
        ros::check_time(t_us, S_BITS, self.written, self.output.path())
    }
}

impl Encoder for McapEncoder {
    fn events(&mut self, span: Span<'_>) -> Result<(), Error> {
        let mut rest = span.events;
        while let Some(first) = rest.first() {
            let t = span.time(*first);
            self.check_time(t)?;
            self.make_room(t)?;
            // As many as belong into one message.
            let near = rest.iter().take_while(|event| span.time(**event).abs_diff(t) <= MESSAGE_US).count();
            let near = span.with_events(rest.get(..near).unwrap_or(rest));
            let done = self.encoder.encode(near, &mut self.code);
            self.payload.extend(self.code.get(..done.bytes).unwrap_or_default());
            self.written += done.events as u64;
            if let Some(last) = done.events.checked_sub(1).and_then(|last| rest.get(last)) {
                self.t_last = span.time(*last);
            }
            if let Some(refused) = done.refused {
                return Err(raw::refused(refused, self.written, self.output.path()));
            }
            rest = rest.get(done.events..).unwrap_or_default();
        }
        Ok(())
    }

    fn trigger(&mut self, trigger: Trigger) -> Result<Kept, Error> {
        self.check_time(trigger.t)?;
        loop {
            self.make_room(trigger.t)?;
            let done = self.encoder.trigger(trigger, &mut self.code);
            self.payload.extend(self.code.get(..done.bytes).unwrap_or_default());
            match done.refused {
                Some(refused) => return Err(raw::refused(refused, self.written, self.output.path())),
                None if done.events == 1 => return Ok(Kept::Yes),
                None => {}
            }
        }
    }

    fn imu(&mut self, sample: &ImuSample) -> Result<Kept, Error> {
        self.check_time(sample.t)?;
        let data = serial::imu(sample, 0, Wire::Cdr);
        self.message(IMU, sample.t, &data)?;
        Ok(Kept::Without(serial::parts_of_imu(sample)))
    }

    fn frame(&mut self, frame: &Frame) -> Result<Kept, Error> {
        self.check_time(frame.t)?;
        let data = serial::image(frame, 0, Wire::Cdr);
        self.message(FRAMES, frame.t, &data)?;
        Ok(Kept::Without(serial::parts_of_image(frame)))
    }

    fn finish(mut self: Box<Self>) -> Result<u64, Error> {
        loop {
            let len = self.encoder.finish(&mut self.code);
            if len == 0 {
                break;
            }
            self.payload.extend(self.code.get(..len).unwrap_or_default());
        }
        self.flush_events()?;
        self.flush_chunk()?;
        let mut end = Vec::new();
        record(&mut end, OP_DATA_END, &[0; 4]);
        let summary_start = self.output.len() + end.len() as u64;
        let mut summary = self.summary();
        record_head(&mut summary, OP_FOOTER, 20);
        summary.extend(summary_start.to_le_bytes());
        summary.extend([0; 8]);
        let crc = crc32fast::hash(&summary);
        summary.extend(crc.to_le_bytes());
        end.append(&mut summary);
        end.extend(MAGIC);
        self.output.write(&end)?;
        self.output.finish()
    }
}

fn string(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

fn record_head(out: &mut Vec<u8>, op: u8, bytes: usize) {
    out.push(op);
    out.extend((bytes as u64).to_le_bytes());
}

fn record(out: &mut Vec<u8>, op: u8, content: &[u8]) {
    record_head(out, op, content.len());
    out.extend(content);
}

/// The schema and the channel of a topic.
fn names(out: &mut Vec<u8>, topic: usize) {
    let (name, definition) = TOPICS[topic];
    let id = (topic as u16 + 1).to_le_bytes();
    let schema =
        [&id[..], &string(definition.name), &string("ros2msg"), &string(&definition.text())].concat();
    record(out, OP_SCHEMA, &schema);
    let channel = [&id[..], &id, &string(name), &string("cdr"), &[0; 4]].concat();
    record(out, OP_CHANNEL, &channel);
}
