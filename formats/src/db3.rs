//! rosbag2 in SQLite, `.db3`: the format of ROS 2 up to Humble. Read only, by its own reader of SQLite's tables.
//!
//! Spec: <https://github.com/ros2/rosbag2>, and `tables` for SQLite's file format
//!
//! ```text
//! topics    id, name, type, serialization_format (cdr), ...
//! messages  id, topic_id, timestamp (ns), data: one message each, in the order they were recorded
//! ```
//!
//! A database that another program has not finished (a `-wal` or `-journal` beside it) is refused: what is missing
//! in the file itself is in there.

mod tables;

use crate::container::Container;
use crate::input::Input;
use crate::open::Probe;
use crate::ros::{self, Connection, Connections, Log, Message, Opened, Wire};
use crate::{Error, ErrorKind, Format, OpenOptions};
use lobula_core::Counters;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;
use tables::{Database, Payload, Row, Table, Value};

/// Its line in the table of formats.
pub(crate) const FORMAT: Format = Format { name: "rosbag2", extensions: &["db3"], create: None, probe, open };

/// Bytes of a message gathered at once.
const PIECE_BYTES: usize = 64 << 10;
/// Longest row of a topic.
const TOPIC_BYTES_MAX: usize = 64 << 10;

fn probe(Probe { head, .. }: &Probe<'_>) -> bool {
    head.starts_with(tables::MAGIC)
}

fn open(input: Arc<Input>, options: &OpenOptions) -> Result<Box<dyn Container>, Error> {
    refuse_unfinished(&input)?;
    let mut database = Database::open(input.clone())?;
    let mut found = |name| {
        database.table(name)?.ok_or_else(|| {
            let what = "is a SQLite database without the tables of rosbag2";
            Error::new(ErrorKind::Unsupported, input.path(), what, "name the .db3 file of a bag")
        })
    };
    let (topics, messages) = (found("topics")?, found("messages")?);
    let connections = connections(&mut database, topics)?.0;
    let columns = ["topic_id", "data"].map(|name| messages.column(name));
    let [Some(topic_id), Some(data)] = columns else {
        let what = "has a table of messages without topic_id or data";
        return Err(Error::new(
            ErrorKind::Unsupported,
            input.path(),
            what,
            "write it again with ros2 bag convert",
        ));
    };
    let log = Db3Log::new(database, messages, topic_id, data);
    ros::open(Opened { log, connections, fields: Vec::new(), warnings: Vec::new() }, options)
}

/// What another program has not yet brought into the file.
fn refuse_unfinished(input: &Input) -> Result<(), Error> {
    for end in ["-wal", "-journal"] {
        let mut name = OsString::from(input.path());
        name.push(end);
        if std::fs::metadata(PathBuf::from(name)).is_ok_and(|beside| beside.len() > 0) {
            let what = format!("was not closed: the rest of it is in the file beside it that ends in {end}");
            let remedy = "stop the recorder, then run: sqlite3 FILE 'pragma journal_mode=delete'";
            return Err(Error::new(ErrorKind::Unsupported, input.path(), what, remedy));
        }
    }
    Ok(())
}

fn connections(database: &mut Database, mut topics: Table) -> Result<Connections, Error> {
    let columns = ["id", "name", "type", "serialization_format"].map(|name| topics.column(name));
    let mut connections = Connections::default();
    let [Some(id), Some(name), Some(kind), Some(format)] = columns else { return Ok(connections) };
    while let Some(row) = topics.next(database)? {
        let row_id = row.id;
        let Some(row) = row.whole(database, TOPIC_BYTES_MAX)? else { continue };
        let text = |column| row.value(column).and_then(Value::text);
        let id = row.value(id).and_then(Value::integer).unwrap_or(row_id);
        let (Some(topic), Some(kind)) = (text(name), text(kind)) else { continue };
        let wire = (text(format).as_deref() == Some("cdr")).then_some(Wire::Cdr);
        connections.add(Connection { id: id as u64, topic, kind, wire });
    }
    Ok(connections)
}

/// The messages of a database.
#[derive(Debug)]
struct Db3Log {
    database: Database,
    messages: Table,
    topic_id: usize,
    data: usize,
    /// The message that was found.
    payload: Payload,
    /// Bytes of it that were read and not taken.
    piece: Vec<u8>,
    /// How many of `piece` are taken.
    taken: usize,
    /// Bytes of rows so far.
    done: u64,
    counters: Counters,
}

impl Db3Log {
    fn new(database: Database, messages: Table, topic_id: usize, data: usize) -> Self {
        Self {
            database,
            messages,
            topic_id,
            data,
            payload: Payload::default(),
            piece: Vec::new(),
            taken: 0,
            done: 0,
            counters: Counters::new(),
        }
    }

    /// Its topic's number, if it is one of these, with what the message holds.
    fn message(&mut self, row: Row, wanted: &[u64]) -> Result<Option<Message>, Error> {
        let Some(head) = row.head(&mut self.database)? else {
            ros::fault(&mut self.counters, lobula_core::Fault::Damaged, row.bytes());
            return Ok(None);
        };
        let connection = head.value(self.topic_id).and_then(Value::integer).unwrap_or_default() as u64;
        if !wanted.contains(&connection) {
            return Ok(None);
        }
        let Some((offset, bytes)) = head.blob(self.data) else {
            ros::fault(&mut self.counters, lobula_core::Fault::Damaged, row.bytes());
            return Ok(None);
        };
        self.payload = row.payload(offset, bytes);
        Ok(Some(Message { connection, bytes, available: bytes }))
    }
}

impl Log for Db3Log {
    fn next(&mut self, wanted: &[u64]) -> Result<Option<Message>, Error> {
        self.piece.clear();
        (self.taken, self.payload) = (0, Payload::default());
        while let Some(row) = self.messages.next(&mut self.database)? {
            self.done += row.bytes();
            if self.done > self.input().len() {
                return Err(self
                    .database
                    .malformed("has more rows than bytes: its pages go round in a ring"));
            }
            if let Some(message) = self.message(row, wanted)? {
                return Ok(Some(message));
            }
        }
        Ok(None)
    }

    fn peek(&mut self, min: usize) -> Result<&[u8], Error> {
        if self.piece.len() - self.taken < min {
            self.piece.drain(..self.taken);
            self.taken = 0;
            let want = min.max(PIECE_BYTES);
            while self.piece.len() < want && self.payload.read(&mut self.database, &mut self.piece)? {}
        }
        Ok(self.piece.get(self.taken..).unwrap_or_default())
    }

    fn take(&mut self, bytes: usize) {
        self.taken = (self.taken + bytes).min(self.piece.len());
    }

    fn position(&self) -> u64 {
        let coming = self.payload.left() + (self.piece.len() - self.taken) as u64;
        self.done.saturating_sub(coming)
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }

    fn input(&self) -> &Arc<Input> {
        self.database.input()
    }

    fn fork(&self) -> Self {
        Self {
            database: self.database.fork(),
            messages: self.messages.clone(),
            payload: self.payload.clone(),
            piece: self.piece.get(self.taken..).unwrap_or_default().to_vec(),
            taken: 0,
            ..*self
        }
    }
}
