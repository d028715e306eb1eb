//! Items beside the events: one message each.

use super::log::{Log, Message};
use crate::{Error, ErrorKind, OpenOptions};

/// The items of a topic, in file order.
pub(crate) struct SideItems<L, P, U> {
    log: L,
    connections: Vec<u64>,
    bytes_max: usize,
    shift_us: i64,
    /// Makes an item of a message.
    parse: P,
    /// Is told how many messages made none.
    unread: U,
    count_unread: u64,
    ended: bool,
}

impl<L: Log, P, U: Fn(u64)> SideItems<L, P, U> {
    pub fn new(log: L, connections: Vec<u64>, options: &OpenOptions, parse: P, unread: U) -> Self {
        let (bytes_max, shift_us) = (options.limits.chunk_bytes_max, options.time_shift_us);
        Self { log, connections, bytes_max, shift_us, parse, unread, count_unread: 0, ended: false }
    }

    /// The next item; `Ok(None)` at the end.
    fn read<T>(&mut self) -> Result<Option<T>, Error>
    where
        P: Fn(&[u8], &dyn Fn(i64) -> Option<u64>) -> Option<T>,
    {
        while let Some(Message { bytes, available, .. }) = self.log.next(&self.connections)? {
            if available > self.bytes_max as u64 {
                return Err(self.too_large(available));
            }
            let len = available as usize;
            let message = self.log.peek(len)?;
            let shift_us = self.shift_us;
            let time = |t: i64| t.checked_add(shift_us).and_then(|t| u64::try_from(t).ok());
            let item = (self.parse)(message.get(..len).unwrap_or(message), &time);
            if item.is_some() && available == bytes {
                return Ok(item);
            }
            self.count_unread += 1;
            (self.unread)(self.count_unread);
        }
        Ok(None)
    }

    fn too_large(&self, bytes: u64) -> Error {
        let what = format!("has a message of {bytes} bytes, beyond {}", self.bytes_max);
        let remedy = "it is damaged there: copy it again";
        Error::new(ErrorKind::TooLarge, self.log.input().path(), what, remedy).at(self.log.position())
    }
}

impl<T, L: Log, P, U: Fn(u64)> Iterator for SideItems<L, P, U>
where
    P: Fn(&[u8], &dyn Fn(i64) -> Option<u64>) -> Option<T>,
{
    type Item = Result<T, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let item = self.read().transpose();
        self.ended = !matches!(item, Some(Ok(_)));
        item
    }
}
