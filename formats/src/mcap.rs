//! MCAP: the log format of rosbag2 since ROS 2 Iron, and of Foxglove.
//!
//! Spec: <https://mcap.dev/spec>
//!
//! ```text
//! 0x89 MCAP0 \r\n, records, the same again
//! record: u8 op, u64 length, content
//!   1 header      profile, library
//!   3 schema      u16 id, name, encoding, data          4 channel  u16 id, u16 schema, topic, encoding, metadata
//!   5 message     u16 channel, u32 sequence, u64 log time, u64 publish time (ns), data
//!   6 chunk       u64 start, u64 end, u64 bytes, u32 CRC-32, compression, u64 length: records of op 3, 4 and 5
//!   F end of data, then the summary: schemas, channels, statistics, index of chunks; 2 footer: u64 where it begins
//! ```
//!
//! Strings are u32 length and bytes. A file without summary, or cut, is read by its records in order.

mod write;

use crate::container::Container;
use crate::input::Input;
use crate::open::Probe;
use crate::ros::{
    self, Connection, Connections, Found, Log, Message, Opened, Packing, RecordLog, Records, Tape, Wire,
};
use crate::{Error, Format, OpenOptions};
use lobula_core::Fault;
use std::sync::Arc;

/// Its line in the table of formats.
pub(crate) const FORMAT: Format =
    Format { name: "MCAP", extensions: &["mcap"], create: Some(write::create), probe, open };

/// What every file begins and ends with.
const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Bytes of a record before its content.
const HEAD_BYTES: usize = 9;
/// Bytes of a message's content before its data.
const MESSAGE_HEAD_BYTES: usize = 2 + 4 + 8 + 8;
/// Most bytes of a chunk's content before its data.
const CHUNK_HEAD_BYTES_MAX: usize = 8 + 8 + 8 + 4 + 4 + 32 + 8;
/// Most bytes of a channel or a schema that are looked at: the names stand first.
const NAMES_BYTES_MAX: usize = 4096;
/// Bytes of the footer's content.
const FOOTER_BYTES: usize = 20;

const OP_HEADER: u8 = 0x01;
const OP_FOOTER: u8 = 0x02;
const OP_SCHEMA: u8 = 0x03;
const OP_CHANNEL: u8 = 0x04;
const OP_MESSAGE: u8 = 0x05;
const OP_CHUNK: u8 = 0x06;
const OP_MESSAGE_INDEX: u8 = 0x07;
const OP_CHUNK_INDEX: u8 = 0x08;
const OP_STATISTICS: u8 = 0x0B;
const OP_DATA_END: u8 = 0x0F;
/// Ops from here on are anyone's own.
const OP_PRIVATE: u8 = 0x80;

fn probe(Probe { head, .. }: &Probe<'_>) -> bool {
    head.starts_with(MAGIC)
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    let mut warnings = Vec::new();
    let summary = Summary::read(&input, options)?;
    let range = MAGIC.len() as u64..summary.as_ref().map_or(input.len(), |summary| summary.offset);
    let tape = Tape::new(input.clone(), range, options.limits.chunk_bytes_max);
    let (channels, chunks) = match summary {
        Some(Summary { channels, chunks, .. }) => (channels, chunks),
        None => {
            warnings.push(
                "has no summary (it was not closed) or a damaged one: all of it is read in order".into(),
            );
            (Channels::default(), Vec::new())
        }
    };
    let log = RecordLog::<McapRecords>::new(tape, chunks.into());
    // A summary need not repeat the channels.
    let channels = if channels.connections.0.is_empty() { scan(log.fork())? } else { channels };
    let connections = channels.connections.0;
    ros::open(Opened { log, connections, fields: Vec::new(), warnings }, options)
}

/// A record's op and the length of its content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Record {
    op: u8,
    bytes: u64,
}

impl Record {
    /// Looks at the record that comes; `None` where its head is cut.
    fn read(tape: &mut Tape) -> Result<Option<Self>, Error> {
        let head: Option<&[u8; HEAD_BYTES]> = tape.peek(HEAD_BYTES)?.first_chunk();
        Ok(head.map(|[op, len @ ..]| Self { op: *op, bytes: u64::from_le_bytes(*len) }))
    }

    /// Bytes with its head.
    fn whole(self) -> u64 {
        self.bytes.saturating_add(HEAD_BYTES as u64)
    }

    /// The first bytes of its content: `most` at most.
    fn content(self, tape: &mut Tape, most: usize) -> Result<&[u8], Error> {
        let len = usize::try_from(self.bytes).unwrap_or(usize::MAX).min(most);
        let bytes = tape.peek(HEAD_BYTES + len)?;
        let end = bytes.len().min(HEAD_BYTES + len);
        Ok(bytes.get(HEAD_BYTES..end).unwrap_or_default())
    }
}

/// Fields of a record's content; `None` is its end.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (number, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*number)
    }

    fn u16(&mut self) -> Option<u16> {
        self.number().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    fn string(&mut self) -> Option<&'a [u8]> {
        let len = self.u32()? as usize;
        let (text, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(text)
    }
}

/// Channels with the names of their schemas.
#[derive(Debug, Default)]
struct Channels {
    /// Numbers and names of schemas.
    schemas: Vec<(u16, String)>,
    connections: Connections,
}

impl Channels {
    /// Most schemas.
    const SCHEMAS_MAX: usize = 4096;

    /// Adds what a record of a schema or a channel tells; `None` where it is damaged.
    fn add(&mut self, op: u8, content: &[u8]) -> Option<()> {
        let mut fields = Fields(content);
        let id = fields.u16()?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        if op == OP_SCHEMA {
            let name = text(fields.string()?);
            let known = self.schemas.iter().any(|(one, _)| *one == id);
            if !known && self.schemas.len() < Self::SCHEMAS_MAX {
                self.schemas.push((id, name));
            }
            return Some(());
        }
        let schema = fields.u16()?;
        let (topic, encoding) = (text(fields.string()?), fields.string()?);
        let wire = match encoding {
            b"cdr" => Some(Wire::Cdr),
            b"ros1" => Some(Wire::Ros1),
            _ => None,
        };
        let kind = self.schemas.iter().find(|(one, _)| *one == schema).map(|(_, name)| name.clone());
        self.connections.add(Connection { id: id.into(), topic, kind: kind.unwrap_or_default(), wire });
        Some(())
    }
}

/// What stands at the end of a file that was closed.
struct Summary {
    /// Offset of the end of the data.
    offset: u64,
    channels: Channels,
    /// Offsets of the chunks, upwards.
    chunks: Vec<u64>,
}

impl Summary {
    /// `None` where there is none, or it is damaged.
    fn read(input: &Arc<Input>, options: &OpenOptions) -> Result<Option<Self>, Error> {
        let mut footer = [0; HEAD_BYTES + FOOTER_BYTES + MAGIC.len()];
        let at = input.len().saturating_sub(footer.len() as u64);
        input.read_at(at, &mut footer)?;
        let [OP_FOOTER, ..] = footer else { return Ok(None) };
        if !footer.ends_with(MAGIC) {
            return Ok(None);
        }
        let offset = Fields(footer.get(HEAD_BYTES..).unwrap_or_default()).u64().unwrap_or(0);
        if offset < MAGIC.len() as u64 || offset > at {
            return Ok(None);
        }
        let mut tape = Tape::new(input.clone(), offset..at, options.limits.chunk_bytes_max);
        let mut summary = Self { offset, channels: Channels::default(), chunks: Vec::new() };
        while tape.left() > 0 {
            let Some(record) = Record::read(&mut tape)?.filter(|record| record.whole() <= tape.left()) else {
                return Ok(None);
            };
            let content = record.content(&mut tape, NAMES_BYTES_MAX)?;
            let good = match record.op {
                OP_SCHEMA | OP_CHANNEL => summary.channels.add(record.op, content),
                OP_CHUNK_INDEX => {
                    let mut fields = Fields(content);
                    let offset = fields.u64().and_then(|_| fields.u64()).and_then(|_| fields.u64());
                    offset.map(|offset| summary.chunks.push(offset))
                }
                _ => Some(()),
            };
            if good.is_none() {
                return Ok(None);
            }
            tape.take(record.whole());
        }
        summary.chunks.sort_unstable();
        Ok(Some(summary))
    }
}

/// The records of an MCAP file.
#[derive(Debug)]
struct McapRecords;

impl Records for McapRecords {
    type Names = Record;

    fn find(log: &mut RecordLog<Self>) -> Result<Found<Record>, Error> {
        log.tape.take(std::mem::take(&mut log.left));
        let in_chunk = log.tape.in_chunk();
        if log.tape.left() == 0 {
            log.tape.leave();
            return Ok(if in_chunk { Found::Other } else { Found::End });
        }
        let Some(record) = Record::read(&mut log.tape)? else { return log.damaged() };
        if in_chunk && record.whole() > log.tape.left() {
            return log.damaged();
        }
        match (record.op, in_chunk) {
            (OP_MESSAGE, _) if record.bytes >= MESSAGE_HEAD_BYTES as u64 => log.message(record),
            (OP_SCHEMA | OP_CHANNEL, _) if record.whole() <= log.tape.available() => {
                log.left = record.whole();
                Ok(Found::Names(record))
            }
            (OP_CHUNK, false) => log.chunk(record),
            (OP_DATA_END, false) => {
                log.tape.jump(log.tape.position() + log.tape.left());
                Ok(Found::End)
            }
            (OP_HEADER | OP_MESSAGE_INDEX..OP_DATA_END | OP_PRIVATE.., false)
                if record.whole() <= log.tape.available() =>
            {
                log.tape.take(record.whole());
                Ok(Found::Other)
            }
            (OP_PRIVATE.., true) => {
                log.tape.take(record.whole());
                Ok(Found::Other)
            }
            _ => log.damaged(),
        }
    }
}

impl RecordLog<McapRecords> {
    fn message(&mut self, record: Record) -> Result<Found<Record>, Error> {
        let Some(connection) = Fields(record.content(&mut self.tape, MESSAGE_HEAD_BYTES)?).u16() else {
            return self.damaged();
        };
        self.tape.take((HEAD_BYTES + MESSAGE_HEAD_BYTES) as u64);
        let bytes = record.bytes - MESSAGE_HEAD_BYTES as u64;
        self.left = bytes;
        let available = bytes.min(self.tape.available());
        Ok(Found::Message(Message { connection: connection.into(), bytes, available }))
    }

    fn chunk(&mut self, record: Record) -> Result<Found<Record>, Error> {
        let content = record.content(&mut self.tape, CHUNK_HEAD_BYTES_MAX)?;
        let Some(head) = ChunkHead::parse(content).filter(|head| head.fits(record)) else {
            return self.pass(record);
        };
        let ChunkHead { packing, bytes, crc, head_bytes, packed_bytes } = head;
        self.tape.take((HEAD_BYTES + head_bytes) as u64);
        if !self.tape.enter(packing, packed_bytes, bytes, crc)? {
            ros::fault(&mut self.counters, Fault::Damaged, packed_bytes);
        }
        Ok(Found::Other)
    }

    /// Counts a record that cannot be read, if it is whole.
    fn pass(&mut self, record: Record) -> Result<Found<Record>, Error> {
        if record.whole() > self.tape.available() {
            return self.damaged();
        }
        ros::fault(&mut self.counters, Fault::Damaged, record.whole());
        self.tape.take(record.whole());
        Ok(Found::Other)
    }
}

/// Every channel, by a full pass.
fn scan(log: RecordLog<McapRecords>) -> Result<Channels, Error> {
    let mut channels = Channels::default();
    log.scan(|tape, record| {
        channels.add(record.op, record.content(tape, NAMES_BYTES_MAX)?);
        Ok(())
    })?;
    Ok(channels)
}

/// What comes before a chunk's data.
struct ChunkHead {
    packing: Packing,
    /// Bytes once unpacked.
    bytes: u64,
    crc: Option<u32>,
    head_bytes: usize,
    packed_bytes: u64,
}

impl ChunkHead {
    /// `None` where it is damaged, or packed in a way that we do not know.
    fn parse(content: &[u8]) -> Option<Self> {
        let mut fields = Fields(content);
        let _times = (fields.u64()?, fields.u64()?);
        let (bytes, crc) = (fields.u64()?, fields.u32()?);
        let packing = Packing::from_name(fields.string()?)?;
        let packed_bytes = fields.u64()?;
        let head_bytes = content.len() - fields.0.len();
        Some(Self { packing, bytes, crc: (crc != 0).then_some(crc), head_bytes, packed_bytes })
    }

    fn fits(&self, record: Record) -> bool {
        self.packed_bytes.checked_add(self.head_bytes as u64) == Some(record.bytes)
    }
}
