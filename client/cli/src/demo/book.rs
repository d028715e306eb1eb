//! What a client writes down: for each generation of the daemon, what came in there and what became of it.

use lobula_client::{EventLedger, PacketHeader};
use serde::{Deserialize, Serialize};

/// Events that did not reach the client and were not filtered, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lost {
    /// Overwritten before this client read them.
    pub overrun: u64,
    /// Their pixel is not on the sensor.
    pub off_sensor: u64,
    /// The daemon was overloaded.
    pub overload: u64,
    /// Shared memory was refused.
    pub no_memory: u64,
}

impl Lost {
    /// Of all causes.
    pub const fn total(&self) -> u64 {
        self.overrun + self.off_sensor + self.overload + self.no_memory
    }
}

/// One generation as one client saw it, from the end of its first packet to the end of its last.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Page {
    /// The daemon's run.
    pub generation: u64,
    /// The daemon's ledger at the end of the first packet.
    pub first: EventLedger,
    /// The daemon's ledger at the end of the last packet.
    pub last: EventLedger,
    /// Events this client was given.
    pub delivered: u64,
    /// Events that were overwritten before it read them.
    pub overrun: u64,
}

impl Page {
    /// Events that came into the daemon.
    pub const fn input(&self) -> u64 {
        self.last.decoded - self.first.decoded
    }

    /// Events its filters removed.
    pub const fn filtered(&self) -> u64 {
        self.last.filtered - self.first.filtered
    }

    /// Events that reached neither the client nor a filter.
    pub const fn lost(&self) -> Lost {
        Lost {
            overrun: self.overrun,
            off_sensor: self.last.off_sensor - self.first.off_sensor,
            overload: self.last.overload - self.first.overload,
            no_memory: self.last.no_memory - self.first.no_memory,
        }
    }

    /// `in = delivered + filtered + lost`.
    pub const fn is_exact(&self) -> bool {
        self.input() == self.delivered + self.filtered() + self.lost().total()
    }
}

/// All generations, in order.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Book {
    /// One page each.
    pub pages: Vec<Page>,
}

impl Book {
    /// Writes down a packet of which `events` were given to the client, `overrun` having been lost before it.
    pub fn take(&mut self, header: &PacketHeader, events: u64, overrun: u64) {
        let known = self.pages.last_mut().filter(|page| page.generation == header.generation);
        let Some(page) = known else {
            let (generation, ledger) = (header.generation, header.events);
            self.pages.push(Page { generation, first: ledger, last: ledger, ..Page::default() });
            return;
        };
        page.delivered += events;
        page.overrun += overrun;
        page.last = header.events;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(generation: u64, decoded: u64, published: u64) -> PacketHeader {
        let events =
            EventLedger { decoded, published, filtered: decoded - published, ..EventLedger::default() };
        PacketHeader { generation, events, ..PacketHeader::default() }
    }

    #[test]
    fn pages_add_up_in_each_generation() {
        let mut book = Book::default();
        book.take(&header(1, 100, 60), 60, 0);
        book.take(&header(1, 200, 150), 90, 0);
        book.take(&header(1, 400, 300), 50, 100);
        book.take(&header(2, 10, 10), 10, 0);
        book.take(&header(2, 30, 15), 5, 0);
        let sums: Vec<_> =
            book.pages.iter().map(|p| (p.input(), p.delivered, p.filtered(), p.lost().total())).collect();
        assert_eq!(sums, [(300, 140, 60, 100), (20, 5, 15, 0)]);
        assert!(book.pages.iter().all(Page::is_exact));
    }

    #[test]
    fn what_is_not_accounted_for_shows() {
        let mut book = Book::default();
        book.take(&header(1, 100, 60), 60, 0);
        book.take(&header(1, 200, 150), 89, 0);
        assert!(!book.pages[0].is_exact());
    }
}
