//! What a container of messages owes: they come in file order, each in pieces.

use super::fields::Wire;
use crate::Error;
use crate::input::Input;
use lobula_core::{Counters, Fault};
use std::fmt::Debug;
use std::sync::Arc;

/// Messages of a file in file order, and a place among them.
pub(crate) trait Log: Debug + Send + Sync + Sized + 'static {
    /// The next message of these connections, past what is left of the one before; `None` at the end. What cannot be
    /// read is counted and passed over.
    fn next(&mut self, wanted: &[u64]) -> Result<Option<Message>, Error>;

    /// The next bytes of the message: at least `min`, or all that are left of it where these are fewer.
    fn peek(&mut self, min: usize) -> Result<&[u8], Error>;

    /// Passes over bytes of the message.
    fn take(&mut self, bytes: usize);

    /// Offset in the file, as [`Cursor::position`](crate::container::Cursor::position).
    fn position(&self) -> u64;

    /// What could not be read so far.
    fn counters(&self) -> &Counters;

    fn input(&self) -> &Arc<Input>;

    /// Another at the same place, without buffers.
    fn fork(&self) -> Self;

    /// About `n` that together have the messages from here on, each from where the one before it ends. One where
    /// that cannot be.
    fn pieces(&self, n: usize) -> Result<Vec<Self>, Error> {
        let _ = n;
        Ok(vec![self.fork()])
    }
}

/// A message that comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Message {
    /// Number of its connection.
    pub connection: u64,
    /// Its length, as the file says.
    pub bytes: u64,
    /// Those that are there: fewer where the file was cut.
    pub available: u64,
}

/// What tells the type of messages and the name they are sent under.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Connection {
    pub id: u64,
    pub topic: String,
    /// Name of the type, such as `dvs_msgs/EventArray`; ROS 2 puts `/msg/` between.
    pub kind: String,
    /// How messages are serialised; `None` is a way that we do not read.
    pub wire: Option<Wire>,
}

/// Most connections of a file, and longest names: a bag has tens.
const CONNECTIONS_MAX: usize = 1 << 14;
const NAME_BYTES_MAX: usize = 1 << 10;

/// The connections of a file, in file order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Connections(pub Vec<Connection>);

impl Connections {
    /// Adds one, if it is new; one beyond what any bag has is passed over.
    pub fn add(&mut self, connection: Connection) {
        let known = self.0.iter().any(|one| one.id == connection.id);
        let long = connection.topic.len().max(connection.kind.len()) > NAME_BYTES_MAX;
        if !known && !long && self.0.len() < CONNECTIONS_MAX {
            self.0.push(connection);
        }
    }
}

/// Counts bytes that cannot be read.
pub(crate) fn fault(counters: &mut Counters, fault: Fault, bytes: u64) {
    if bytes > 0 {
        counters.faults.count(fault);
        counters.bytes_faulty += bytes;
    }
}
