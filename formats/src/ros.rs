//! Messages of ROS in files: what ROS 1 bags, MCAP and rosbag2 databases have in common.
//!
//! ```text
//! container (Log: messages in file order) ─▶ topic ─▶ EventArray ──────────────▶ events
//!                                              │  └─▶ EventPacket ─▶ decoder ─▶ events, triggers
//!                                              └─▶ Image, Imu, CameraInfo ─▶ frames, samples, fields
//! ```

mod cursor;
pub(crate) mod definition;
mod event_array;
mod event_packet;
mod fields;
mod image;
mod imu;
mod libcaer_cmp;
mod log;
mod notes;
mod packing;
mod records;
pub(crate) mod serial;
mod side;
mod tape;

use crate::container::{Container, Cursor, Items, Piece};
use crate::intake::Intake;
use crate::write;
use crate::{Error, ErrorKind, Frame, ImuSample, OpenOptions, Stream, StreamKind, WriteOptions};
use cursor::{Body, EventTopic, HEAD_BYTES_MAX, TopicCursor};
use event_array::EventArrays;
use event_packet::EventPackets;
use lobula_core::Geometry;
use lobula_core::wire::Encoding;
use notes::Notes;
use side::SideItems;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

pub(crate) use fields::Wire;
pub(crate) use log::{Connection, Connections, Log, Message, fault};
pub(crate) use packing::Packing;
pub(crate) use records::{Found, RecordLog, Records};
pub(crate) use tape::Tape;

/// Largest sensor that the fields of an event in an array can tell.
const ARRAY_GEOMETRY_MAX: Geometry = Geometry::new(u16::MAX, 1 << 15);
/// How far into a file its calibration is looked for.
const CAMERA_INFO_BYTES: u64 = 4 << 20;

/// What a Zstandard frame begins with.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xB5, 0x2F, 0xFD];

/// What a message is to us.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Array,
    Packet,
    Image,
    Imu,
    CameraInfo,
    Other,
}

impl Kind {
    /// That of a type of this name, of ROS 1 or 2.
    fn of(connection: &Connection) -> Self {
        if connection.wire.is_none() {
            return Self::Other;
        }
        match connection.kind.replace("/msg/", "/").as_str() {
            "dvs_msgs/EventArray" | "prophesee_event_msgs/EventArray" | "dv_ros_msgs/EventArray" => {
                Self::Array
            }
            "event_camera_msgs/EventPacket"
            | "event_camera_msgs/EventArray"
            | "event_array_msgs/EventArray" => Self::Packet,
            "sensor_msgs/Image" => Self::Image,
            "sensor_msgs/Imu" => Self::Imu,
            "sensor_msgs/CameraInfo" => Self::CameraInfo,
            _ => Self::Other,
        }
    }

    const fn is_events(self) -> bool {
        matches!(self, Self::Array | Self::Packet)
    }
}

/// How to pack the chunks of a file, out of what its format has; none where nothing was asked for.
pub(crate) fn packing_of(options: &WriteOptions, has: &[Packing], path: &Path) -> Result<Packing, Error> {
    let Some(wanted) = options.compression else { return Ok(Packing::Plain) };
    let found = has.iter().find(|packing| packing.name() == wanted.name());
    found.copied().ok_or_else(|| {
        let what = format!("cannot be written: the format has no compression {}", wanted.name());
        let names: Vec<_> = has.iter().map(|packing| packing.name()).collect();
        let remedy = format!("give --compression one of {}", names.join(", "));
        Error::new(ErrorKind::Refused, path, what, remedy)
    })
}

/// A topic: the connections of one name and type.
#[derive(Clone, Debug)]
struct Topic {
    name: String,
    kind: Kind,
    wire: Wire,
    connections: Vec<u64>,
}

/// Joins the connections of a topic.
fn topics(connections: &[Connection]) -> Vec<Topic> {
    let mut topics: Vec<Topic> = Vec::new();
    for connection in connections {
        let (name, kind) = (connection.topic.clone(), Kind::of(connection));
        let wire = connection.wire.unwrap_or(Wire::Ros1);
        match topics.iter_mut().find(|one| one.name == name && one.kind == kind && one.wire == wire) {
            Some(topic) => topic.connections.push(connection.id),
            None => topics.push(Topic { name, kind, wire, connections: vec![connection.id] }),
        }
    }
    topics
}

/// Refuses a time that does not fit a stamp of so many bits of seconds.
pub(crate) fn check_time(t_us: u64, s_bits: u32, written: u64, path: &Path) -> Result<(), Error> {
    if t_us / 1_000_000 < 1 << s_bits {
        return Ok(());
    }
    let what = format!("time {t_us} µs is beyond the 2^{s_bits} s of the format");
    Err(write::refused(path, written, &what, "write it with --rebase"))
}

/// What a container found when it was opened.
#[derive(Debug)]
pub(crate) struct Opened<L> {
    /// At the first message.
    pub log: L,
    pub connections: Vec<Connection>,
    pub fields: Vec<(String, String)>,
    pub warnings: Vec<String>,
}

/// Chooses the topics and reads the first message of events.
pub(crate) fn open<L: Log>(opened: Opened<L>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let Opened { log, connections, mut fields, mut warnings } = opened;
    let topics = topics(&connections);
    let events = choose(&topics, log.input().path(), options)?;
    let beside = |kind| beside(&topics, &topics[events], kind);
    let [images, imu, camera_info] = [Kind::Image, Kind::Imu, Kind::CameraInfo].map(beside);
    let streams = streams(&topics, &[images, imu]);
    let topic = &topics[events];
    let topic = EventTopic { connections: topic.connections.clone(), wire: topic.wire };
    let first = first_message(&log, &topic, topics[events].kind, options)?;
    if let Some(camera_info) = camera_info {
        fields.extend(self::camera_info(&log, &topics[camera_info], &topic)?);
    }
    if images.is_none() && topics.iter().any(|topic| topic.kind == Kind::Image) {
        warnings.push("frames are not read: several topics have them, and none is beside the events'".into());
    }
    if imu.is_none() && topics.iter().any(|topic| topic.kind == Kind::Imu) {
        warnings.push(
            "samples of inertial sensors are not read: several topics have them, and none is beside the events'".into(),
        );
    }
    let notes = Arc::new(Notes::default());
    let FirstMessage { geometry, geometry_of_blocks, encoding, body } = first;
    let events = TopicCursor::new(log.fork(), Arc::new(topic), notes.clone(), body);
    let side = |topic: Option<usize>| topic.map(|topic| topics[topic].clone());
    Ok(Box::new(RosRecording {
        images: side(images),
        imu: side(imu),
        log,
        streams,
        fields,
        warnings,
        notes,
        geometry,
        geometry_of_blocks,
        encoding,
        events,
        options: options.clone(),
    }))
}

/// The topic of events that was asked for, or the only one.
fn choose(topics: &[Topic], path: &Path, options: &OpenOptions) -> Result<usize, Error> {
    let events: Vec<_> = (0..topics.len()).filter(|i| topics[*i].kind.is_events()).collect();
    let names = || events.iter().map(|i| topics[*i].name.as_str()).collect::<Vec<_>>().join(", ");
    if let Some(name) = &options.topic {
        let found = events.iter().find(|i| topics[**i].name == *name);
        return found.copied().ok_or_else(|| {
            let what = format!("has no topic of events called {name}");
            Error::new(ErrorKind::NeedsOption, path, what, format!("give --topic one of: {}", names()))
        });
    }
    match events.as_slice() {
        [only] => Ok(*only),
        [] if topics.is_empty() => {
            let what = "holds no message that can be read: it ends before the first, or is damaged there";
            Err(Error::new(ErrorKind::Malformed, path, what, "copy it again from where it was recorded"))
        }
        [] => {
            let all = topics.iter().map(|topic| topic.name.as_str()).collect::<Vec<_>>().join(", ");
            let what = format!("has no topic of events that we read (its topics: {all})");
            let remedy = "record dvs_msgs/EventArray or event_camera_msgs/EventPacket";
            Err(Error::new(ErrorKind::Unsupported, path, what, remedy))
        }
        several => {
            let what = format!("has {} topics of events", several.len());
            Err(Error::new(
                ErrorKind::NeedsOption,
                path,
                what,
                format!("choose one with --topic: {}", names()),
            ))
        }
    }
}

/// The topic of a kind that belongs to the events: in their namespace, else the only one.
fn beside(topics: &[Topic], events: &Topic, kind: Kind) -> Option<usize> {
    let namespace = |name: &str| name.rsplit_once('/').map(|(namespace, _)| namespace.to_owned());
    let all: Vec<_> = (0..topics.len()).filter(|i| topics[*i].kind == kind).collect();
    let near: Vec<_> =
        all.iter().copied().filter(|i| namespace(&topics[*i].name) == namespace(&events.name)).collect();
    match (near.as_slice(), all.as_slice()) {
        ([only], _) | ([], [only]) => Some(*only),
        _ => None,
    }
}

fn streams(topics: &[Topic], read: &[Option<usize>]) -> Vec<Stream> {
    let kind = |i: usize, topic: &Topic| match topic.kind {
        Kind::Array | Kind::Packet => StreamKind::Events,
        Kind::Image if read.contains(&Some(i)) => StreamKind::Frames,
        Kind::Imu if read.contains(&Some(i)) => StreamKind::Imu,
        _ => StreamKind::Other,
    };
    topics.iter().enumerate().map(|(i, topic)| Stream::new(kind(i, topic), topic.name.clone())).collect()
}

/// What the first message tells of all.
struct FirstMessage {
    geometry: Option<Geometry>,
    geometry_of_blocks: Geometry,
    encoding: Option<Encoding>,
    body: Body,
}

fn first_message<L: Log>(
    log: &L,
    topic: &EventTopic,
    kind: Kind,
    options: &OpenOptions,
) -> Result<FirstMessage, Error> {
    let mut log = log.fork();
    let path = log.input().path().to_owned();
    while let Some(message) = log.next(&topic.connections)? {
        let available = usize::try_from(message.available).unwrap_or(usize::MAX);
        let head = log.peek(HEAD_BYTES_MAX.min(available))?;
        let head = head.get(..available.min(head.len())).unwrap_or_default();
        if head.starts_with(&ZSTD_MAGIC) {
            let what = "has messages that are compressed one by one, which we do not read";
            let remedy = "write it again with ros2 bag convert, without compression";
            return Err(Error::new(ErrorKind::Unsupported, &path, what, remedy));
        }
        let first = match kind {
            Kind::Packet => {
                event_packet::Head::parse(head, topic.wire).map(|head| packets(head, &path, options))
            }
            _ => event_array::Head::parse(head, topic.wire)
                .map(|head| arrays(head, topic.wire, &path, options)),
        };
        if let Some(first) = first {
            return first;
        }
    }
    let geometry = options.sensor_size;
    let geometry_of_blocks = geometry.unwrap_or(ARRAY_GEOMETRY_MAX);
    Ok(FirstMessage { geometry, geometry_of_blocks, encoding: None, body: Body::None })
}

fn arrays(
    head: event_array::Head,
    wire: Wire,
    path: &Path,
    options: &OpenOptions,
) -> Result<FirstMessage, Error> {
    let geometry = geometry(head.size, path, options)?;
    let geometry_of_blocks = geometry.unwrap_or(ARRAY_GEOMETRY_MAX);
    let intake = Intake::new(geometry_of_blocks, options);
    let body = Body::Arrays(EventArrays::new(intake, options.time_shift_us, wire));
    Ok(FirstMessage { geometry, geometry_of_blocks, encoding: None, body })
}

fn packets(head: event_packet::Head<'_>, path: &Path, options: &OpenOptions) -> Result<FirstMessage, Error> {
    let unsupported =
        |what: String, remedy: &str| Err(Error::new(ErrorKind::Unsupported, path, what, remedy));
    let Some(encoding) = event_packet::encoding(head.encoding) else {
        let name = String::from_utf8_lossy(head.encoding).into_owned();
        let what = format!("has packets of encoding {name:?}; we read {}", event_packet::ENCODINGS);
        return unsupported(what, "record it with one of these");
    };
    if head.is_bigendian {
        let what = "has packets of a big-endian machine, whose byte order is nowhere defined".to_owned();
        return unsupported(what, "record it on another machine");
    }
    if encoding.is_some() && options.time_shift_us != 0 {
        let what = "has a camera's bytes, whose times cannot be shifted while they are read".to_owned();
        return unsupported(what, "leave out --time-shift: a camera's times are never negative");
    }
    let geometry = geometry(head.size, path, options)?;
    let geometry_of_blocks = geometry.unwrap_or(EventPackets::GEOMETRY_MAX);
    let body = Body::Packets(EventPackets::new(encoding, geometry_of_blocks, options));
    Ok(FirstMessage { geometry, geometry_of_blocks, encoding, body })
}

/// The size that was asked for, else the message's; 0 is unknown.
fn geometry(
    [width, height]: [u32; 2],
    path: &Path,
    options: &OpenOptions,
) -> Result<Option<Geometry>, Error> {
    if options.sensor_size.is_some() || width == 0 || height == 0 {
        return Ok(options.sensor_size);
    }
    let side = options.limits.sensor_side_px_max;
    match (u16::try_from(width), u16::try_from(height)) {
        (Ok(width), Ok(height)) if width.max(height) <= side => Ok(Some(Geometry::new(width, height))),
        _ => {
            let what = format!("has the sensor size {width}x{height}, beyond {side} pixels a side");
            let remedy = "give the true size with --sensor-size WxH";
            Err(Error::new(ErrorKind::TooLarge, path, what, remedy))
        }
    }
}

/// The calibration of the camera, if it is told near the start.
fn camera_info<L: Log>(log: &L, topic: &Topic, events: &EventTopic) -> Result<Vec<(String, String)>, Error> {
    let mut log = log.fork();
    let until = log.position().saturating_add(CAMERA_INFO_BYTES);
    // The events' messages are only where to stop looking.
    let both: Vec<_> = topic.connections.iter().chain(&events.connections).copied().collect();
    while let Some(message) = log.next(&both)? {
        if log.position() > until {
            break;
        }
        if !topic.connections.contains(&message.connection) {
            continue;
        }
        let len = usize::try_from(message.available).unwrap_or(usize::MAX).min(HEAD_BYTES_MAX);
        let bytes = log.peek(len)?;
        if let Some(told) = image::camera_info(bytes.get(..len).unwrap_or(bytes), topic.wire) {
            return Ok(told);
        }
    }
    Ok(Vec::new())
}

/// An open file of messages.
#[derive(Debug)]
struct RosRecording<L> {
    /// At the first message.
    log: L,
    streams: Vec<Stream>,
    images: Option<Topic>,
    imu: Option<Topic>,
    fields: Vec<(String, String)>,
    warnings: Vec<String>,
    notes: Arc<Notes>,
    geometry: Option<Geometry>,
    geometry_of_blocks: Geometry,
    encoding: Option<Encoding>,
    /// At the first event.
    events: TopicCursor<L>,
    options: OpenOptions,
}

impl<L: Log> Container for RosRecording<L> {
    fn geometry(&self) -> Option<Geometry> {
        self.geometry
    }

    fn geometry_of_blocks(&self) -> Geometry {
        self.geometry_of_blocks
    }

    fn encoding(&self) -> Option<Encoding> {
        self.encoding
    }

    fn fields(&self) -> Vec<(&str, &str)> {
        self.fields.iter().map(|(key, value)| (key.as_str(), value.as_str())).collect()
    }

    fn streams(&self) -> Vec<Stream> {
        self.streams.clone()
    }

    fn warnings(&self) -> Vec<String> {
        self.warnings.iter().cloned().chain(self.notes.warnings()).collect()
    }

    fn start(&self) -> Box<dyn Cursor> {
        self.events.fork()
    }

    fn pieces(&self, n: usize) -> Result<Vec<Piece>, Error> {
        self.events.pieces(n)
    }

    fn imu(&self) -> Items<ImuSample> {
        let Some(topic) = &self.imu else { return Box::new(std::iter::empty()) };
        let Topic { connections, wire, .. } = topic.clone();
        let (notes, cut) = (self.notes.clone(), AtomicU64::new(0));
        let more = move || notes.cut_samples(cut.fetch_add(1, Ordering::Relaxed) + 1);
        let parse =
            move |message: &[u8], time: &dyn Fn(i64) -> Option<u64>| imu::sample(message, wire, time, &more);
        let notes = self.notes.clone();
        let unread = move |count| notes.unread_samples(count);
        Box::new(SideItems::new(self.log.fork(), connections, &self.options, parse, unread))
    }

    fn frames(&self) -> Items<Frame> {
        let Some(topic) = &self.images else { return Box::new(std::iter::empty()) };
        let Topic { connections, wire, .. } = topic.clone();
        let parse =
            move |message: &[u8], time: &dyn Fn(i64) -> Option<u64>| image::frame(message, wire, time);
        let notes = self.notes.clone();
        let unread = move |count| notes.unread_frames(count);
        Box::new(SideItems::new(self.log.fork(), connections, &self.options, parse, unread))
    }
}
