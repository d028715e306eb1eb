//! What the pipeline has counted, for other threads to read whole at any time, without a lock.

use bytemuck::{Pod, Zeroable};
use core::sync::atomic::{AtomicU64, Ordering, fence};
use lobula_client::{ByteLedger, EventLedger};
use lobula_core::Fault;

/// The pipeline's counts after a packet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Counts {
    /// Ledger of bytes.
    pub bytes: ByteLedger,
    /// Ledger of events.
    pub events: EventLedger,
    /// Malformed words, in the order of [`Fault::ALL`].
    pub faults: [u64; Fault::ALL.len()],
    /// External triggers decoded.
    pub triggers: u64,
    /// Packets published.
    pub packets: u64,
    /// Stream time in µs.
    pub stream_time_us: u64,
    /// Published - arrived of all packets with events, in ns.
    pub latency_ns_sum: u64,
    /// Number of those packets.
    pub latency_packets: u64,
    /// The longest published - arrived of the last second, in ns.
    pub latency_ns_max: u64,
}

const WORDS: usize = size_of::<Counts>() / size_of::<u64>();

/// Where the pipeline writes its counts, and others read them. One writer.
///
/// A sequence lock over atomic words: the writer never waits; a reader that met it in the middle reads again.
#[derive(Debug)]
pub struct Board {
    /// Odd while the counts are being written.
    version: AtomicU64,
    words: [AtomicU64; WORDS],
}

impl Default for Board {
    fn default() -> Self {
        Self { version: AtomicU64::new(0), words: [const { AtomicU64::new(0) }; WORDS] }
    }
}

impl Board {
    /// Replaces the counts. Only the pipeline's thread may call it.
    pub fn write(&self, counts: &Counts) {
        let version = self.version.load(Ordering::Relaxed);
        self.version.store(version.wrapping_add(1), Ordering::Relaxed);
        fence(Ordering::Release); // the odd version is seen before any new word
        let values: &[u64; WORDS] = bytemuck::cast_ref(counts);
        for (word, value) in self.words.iter().zip(values) {
            word.store(*value, Ordering::Relaxed);
        }
        self.version.store(version.wrapping_add(2), Ordering::Release);
    }

    /// The counts as they were after one packet.
    pub fn read(&self) -> Counts {
        loop {
            let before = self.version.load(Ordering::Acquire);
            let mut counts = Counts::default();
            let values: &mut [u64; WORDS] = bytemuck::cast_mut(&mut counts);
            for (value, word) in values.iter_mut().zip(&self.words) {
                *value = word.load(Ordering::Relaxed);
            }
            fence(Ordering::Acquire); // the words are read before the version is looked at again
            if before.is_multiple_of(2) && self.version.load(Ordering::Relaxed) == before {
                return counts;
            }
            core::hint::spin_loop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readers_never_see_half_of_a_write() {
        let board = Board::default();
        let counts =
            |n: u64| Counts { triggers: n, packets: 2 * n, latency_ns_max: 3 * n, ..Counts::default() };
        std::thread::scope(|scope| {
            scope.spawn(|| (1..=20_000).for_each(|n| board.write(&counts(n))));
            let mut last = 0;
            while last < 20_000 {
                let read = board.read();
                assert_eq!(read, counts(read.triggers));
                assert!(read.triggers >= last);
                last = read.triggers;
            }
        });
    }
}
