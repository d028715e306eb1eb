//! ROS 1 bags: records of named fields, in chunks that may be packed, with an index at the end.
//!
//! Spec: <http://wiki.ros.org/Bags/Format/2.0>
//!
//! ```text
//! #ROSBAG V2.0\n
//! record: u32 length, fields (u32 length, name=value), u32 length, data
//!   op 3  bag header   index_pos, conn_count, chunk_count       0 where the bag was not closed
//!   op 5  chunk        compression (none, bz2, lz4), size       data: records of op 2 and 7
//!   op 2  message      conn, time
//!   op 7  connection   conn, topic                              data: fields type, md5sum, message_definition
//!   op 4  index of a chunk's messages, after it                 op 6  what a chunk holds, at the end
//! ```
//!
//! A bag without an index, or with a damaged one, is read by its records in order.

mod write;

use crate::container::Container;
use crate::input::Input;
use crate::open::Probe;
use crate::ros::{
    self, Connection, Connections, Found, Log, Message, Opened, Packing, RecordLog, Records, Tape, Wire,
};
use crate::{Error, ErrorKind, Format, OpenOptions};
use lobula_core::Fault;
use std::sync::Arc;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format =
    Format { name: "ROS 1 bag", extensions: &["bag"], create: Some(write::create), probe, open };

/// What every bag begins with.
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// Longest header of a record: a topic's name is the only long field.
const HEADER_BYTES_MAX: usize = 4096;
/// Longest data of a connection: the definition of its messages.
const CONNECTION_BYTES_MAX: usize = 1 << 20;

const OP_MESSAGE: u8 = 2;
const OP_BAG: u8 = 3;
const OP_INDEX: u8 = 4;
const OP_CHUNK: u8 = 5;
const OP_CHUNK_INFO: u8 = 6;
const OP_CONNECTION: u8 = 7;

fn probe(Probe { head, .. }: &Probe<'_>) -> bool {
    head.starts_with(b"#ROSBAG V")
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let mut warnings = Vec::new();
    let header = BagHeader::read(&input)?;
    let index = Index::read(&input, header.index_pos, options)?;
    let range = MAGIC.len() as u64..index.as_ref().map_or(input.len(), |index| index.offset);
    let tape = Tape::new(input.clone(), range, options.limits.chunk_bytes_max);
    let (connections, chunks) = match index {
        Some(Index { connections, chunks, .. }) => (connections, chunks),
        None => {
            warnings
                .push("has no index (it was not closed) or a damaged one: all of it is read in order".into());
            (Connections::default(), Vec::new())
        }
    };
    let log = RecordLog::<BagRecords>::new(tape, chunks.into());
    let connections = if connections.0.is_empty() { scan(log.fork())? } else { connections };
    let connections = connections.0;
    ros::open(Opened { log, connections, fields: Vec::new(), warnings }, options)
}

/// What the bag's own header says.
struct BagHeader {
    /// Offset of the index; 0 where there is none.
    index_pos: u64,
}

impl BagHeader {
    fn read(input: &Arc<Input>) -> Result<Self, Error> {
        let refused = |kind, what: &str, remedy: &str| Err(Error::new(kind, input.path(), what, remedy));
        let mut magic = [0; MAGIC.len()];
        if input.read_at(0, &mut magic)? < magic.len() || magic != MAGIC {
            let remedy = "convert it with: rosbag fix";
            return refused(ErrorKind::Unsupported, "is a bag of another version than 2.0", remedy);
        }
        let mut tape = Tape::new(input.clone(), MAGIC.len() as u64..input.len(), 0);
        let Some(record) = Record::read(&mut tape)? else {
            return refused(
                ErrorKind::Malformed,
                "ends inside its header",
                "copy it again from where it was recorded",
            );
        };
        let header = tape.peek(record.head_bytes)?;
        let fields = record.fields(header);
        if fields.bytes(b"op") != Some(&[OP_BAG]) {
            return refused(
                ErrorKind::Malformed,
                "has no bag header",
                "copy it again from where it was recorded",
            );
        }
        if fields.bytes(b"encryptor").is_some_and(|name| !name.is_empty()) {
            return refused(ErrorKind::Unsupported, "is encrypted", "decrypt it with: rosbag decrypt");
        }
        Ok(Self { index_pos: fields.u64(b"index_pos").unwrap_or(0) })
    }
}

/// What stands at the end of a bag that was closed.
struct Index {
    offset: u64,
    connections: Connections,
    /// Offsets of the chunks, upwards.
    chunks: Vec<u64>,
}

impl Index {
    /// `None` where there is none, or it is damaged.
    fn read(input: &Arc<Input>, offset: u64, options: &OpenOptions) -> Result<Option<Self>, Error> {
        if offset < MAGIC.len() as u64 || offset > input.len() {
            return Ok(None);
        }
        let mut tape = Tape::new(input.clone(), offset..input.len(), options.limits.chunk_bytes_max);
        let mut index = Self { offset, connections: Connections::default(), chunks: Vec::new() };
        while tape.left() > 0 {
            let Some(record) = Record::read(&mut tape)? else { return Ok(None) };
            let header = tape.peek(record.head_bytes)?;
            let fields = record.fields(header);
            match fields.op() {
                Some(OP_CONNECTION) => {
                    let Some(connection) = read_connection(&mut tape, &record)? else { return Ok(None) };
                    index.connections.add(connection);
                }
                Some(OP_CHUNK_INFO) => index.chunks.extend(fields.u64(b"chunk_pos")),
                _ => return Ok(None),
            }
            if record.bytes() > tape.left() {
                return Ok(None);
            }
            tape.take(record.bytes());
        }
        index.chunks.sort_unstable();
        Ok(Some(index))
    }
}

/// Lengths of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Record {
    /// Bytes before its data.
    head_bytes: usize,
    /// Bytes of its data.
    data_bytes: u64,
}

impl Record {
    /// Looks at the record that comes; `None` where its head is cut or too long.
    fn read(tape: &mut Tape) -> Result<Option<Self>, Error> {
        let Some(header_bytes) = tape.peek(4)?.first_chunk().map(|len| u32::from_le_bytes(*len) as usize)
        else {
            return Ok(None);
        };
        if header_bytes > HEADER_BYTES_MAX {
            return Ok(None);
        }
        let head_bytes = 4 + header_bytes + 4;
        let head = tape.peek(head_bytes)?;
        let data_bytes = head.get(4 + header_bytes..).and_then(<[u8]>::first_chunk);
        let data_bytes = data_bytes.map(|len| u64::from(u32::from_le_bytes(*len)));
        Ok(data_bytes.map(|data_bytes| Self { head_bytes, data_bytes }))
    }

    fn bytes(self) -> u64 {
        self.head_bytes as u64 + self.data_bytes
    }

    /// The fields of its header; `record` begins with the record.
    fn fields(self, record: &[u8]) -> Fields<'_> {
        Fields(record.get(4..self.head_bytes - 4).unwrap_or_default())
    }
}

/// Named fields, one after the other.
#[derive(Clone, Copy)]
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn bytes(self, name: &[u8]) -> Option<&'a [u8]> {
        let mut rest = self.0;
        loop {
            let (len, after) = rest.split_first_chunk()?;
            let (field, after) = after.split_at_checked(u32::from_le_bytes(*len) as usize)?;
            if let Some(value) = field.strip_prefix(name).and_then(|value| value.strip_prefix(b"=")) {
                return Some(value);
            }
            rest = after;
        }
    }

    fn op(self) -> Option<u8> {
        let [op] = self.bytes(b"op")? else { return None };
        Some(*op)
    }

    fn u32(self, name: &[u8]) -> Option<u32> {
        self.bytes(name)?.try_into().ok().map(u32::from_le_bytes)
    }

    fn u64(self, name: &[u8]) -> Option<u64> {
        self.bytes(name)?.try_into().ok().map(u64::from_le_bytes)
    }
}

/// The connection of the record that comes; `None` where it is damaged.
fn read_connection(tape: &mut Tape, record: &Record) -> Result<Option<Connection>, Error> {
    if record.data_bytes > CONNECTION_BYTES_MAX as u64 {
        return Ok(None);
    }
    let whole = tape.peek(record.bytes() as usize)?;
    let (fields, data) = (record.fields(whole), Fields(whole.get(record.head_bytes..).unwrap_or_default()));
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let connection = || {
        let (id, topic) = (fields.u32(b"conn")?.into(), text(fields.bytes(b"topic")?));
        Some(Connection { id, topic, kind: text(data.bytes(b"type")?), wire: Some(Wire::Ros1) })
    };
    Ok(connection())
}

/// Every connection, by a full pass.
fn scan(log: RecordLog<BagRecords>) -> Result<Connections, Error> {
    let mut connections = Connections::default();
    log.scan(|_, connection| {
        connections.add(connection);
        Ok(())
    })?;
    Ok(connections)
}

/// The records of a bag.
#[derive(Debug)]
struct BagRecords;

impl Records for BagRecords {
    type Names = Connection;

    fn find(log: &mut RecordLog<Self>) -> Result<Found<Connection>, Error> {
        log.tape.take(std::mem::take(&mut log.left));
        if log.tape.left() == 0 {
            if !log.tape.in_chunk() {
                return Ok(Found::End);
            }
            log.tape.leave();
            return Ok(Found::Other);
        }
        let Some(record) = Record::read(&mut log.tape)? else { return log.damaged() };
        if log.tape.in_chunk() && record.bytes() > log.tape.left() {
            return log.damaged();
        }
        let in_chunk = log.tape.in_chunk();
        let head = log.tape.peek(record.head_bytes)?;
        let fields = record.fields(head);
        match (fields.op(), in_chunk) {
            (Some(OP_MESSAGE), _) => match fields.u32(b"conn") {
                Some(connection) => Ok(log.message(connection, record)),
                None => log.damaged(),
            },
            (Some(OP_CHUNK), false) => {
                let packing = fields.bytes(b"compression").and_then(Packing::from_name);
                let packing = packing.filter(|packing| *packing != Packing::Zstd);
                match packing.zip(fields.u32(b"size")) {
                    Some((packing, size)) => log.chunk(packing, size, record),
                    None => log.pass(record, Fault::Damaged),
                }
            }
            (Some(OP_CONNECTION), _) => match read_connection(&mut log.tape, &record)? {
                Some(connection) => {
                    log.tape.take(record.bytes());
                    Ok(Found::Names(connection))
                }
                None => log.damaged(),
            },
            (Some(OP_BAG | OP_INDEX | OP_CHUNK_INFO), false) => {
                log.tape.take(record.bytes());
                Ok(Found::Other)
            }
            _ => log.damaged(),
        }
    }
}

impl RecordLog<BagRecords> {
    fn message(&mut self, connection: u32, record: Record) -> Found<Connection> {
        self.tape.take(record.head_bytes as u64);
        self.left = record.data_bytes;
        let available = record.data_bytes.min(self.tape.available());
        Found::Message(Message { connection: connection.into(), bytes: record.data_bytes, available })
    }

    fn chunk(&mut self, packing: Packing, size: u32, record: Record) -> Result<Found<Connection>, Error> {
        self.tape.take(record.head_bytes as u64);
        if !self.tape.enter(packing, record.data_bytes, size.into(), None)? {
            ros::fault(&mut self.counters, Fault::Damaged, record.data_bytes);
        }
        Ok(Found::Other)
    }

    /// Counts a record that cannot be read.
    fn pass(&mut self, record: Record, fault: Fault) -> Result<Found<Connection>, Error> {
        ros::fault(&mut self.counters, fault, record.bytes().min(self.tape.available()));
        self.tape.take(record.bytes());
        Ok(Found::Other)
    }
}
