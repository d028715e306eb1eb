//! What came over a link, what did not, and what was wrong with it.

/// What can be wrong with a frame; each is counted, skipped, and harms no other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Fault {
    /// Bytes that are no frame: noise, or the rest of a frame whose start was lost.
    Framing = 0,
    /// A frame longer than the receiver's memory.
    TooLong = 1,
    /// A checksum that does not fit.
    Checksum = 2,
    /// A whole frame whose message means nothing to this version.
    Message = 3,
}

impl Fault {
    /// Every kind, in the order of their counts.
    pub const ALL: [Self; 4] = [Self::Framing, Self::TooLong, Self::Checksum, Self::Message];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Framing => "framing",
            Self::TooLong => "too_long",
            Self::Checksum => "checksum",
            Self::Message => "message",
        }
    }
}

/// The receiver's book. Frames sent = `frames` + the faults [`Message`](Fault::Message) + `lost`, up to the last frame
/// received, where no more than 2^15 were lost in a row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ledger {
    /// Frames handed on.
    pub frames: u64,
    /// Frames that never arrived whole, by their numbers.
    pub lost: u64,
    /// How often the sender started anew, the first time included.
    pub starts: u64,
    /// Packets that the sender itself had to drop, as far as [`bulk`](super::bulk) frames tell.
    pub overruns: u64,
    faults: [u64; Fault::ALL.len()],
    last: Option<u16>,
}

impl Ledger {
    /// The number of the frame after this one; 0 is the first of a run alone.
    pub(super) const fn after(sequence: u16) -> u16 {
        if sequence == u16::MAX { 1 } else { sequence + 1 }
    }

    /// How many frames of this fault; of [`Framing`](Fault::Framing) how many stretches of bytes.
    pub fn faults(&self, fault: Fault) -> u64 {
        self.faults.get(fault as usize).copied().unwrap_or_default()
    }

    pub(super) fn count(&mut self, fault: Fault) {
        if let Some(n) = self.faults.get_mut(fault as usize) {
            *n = n.saturating_add(1);
        }
    }

    /// A frame of this number has arrived. How many before it did not.
    ///
    /// Number 0 is a start. One that is far behind is of a run whose start was lost.
    pub(super) fn arrived(&mut self, sequence: u16) -> u16 {
        let last = self.last.replace(sequence).filter(|_| sequence != 0);
        let lost = match last.map(|last| ahead(sequence, Self::after(last))) {
            Some(Some(lost)) => lost,
            started => {
                self.starts = self.starts.saturating_add(1);
                // Of what came before the first frame of all nothing is known.
                if started.is_some() { sequence } else { 0 }
            }
        };
        self.lost = self.lost.saturating_add(lost.into());
        lost
    }
}

/// How far `sequence` is ahead of `expected`, both from 1; `None` if it is rather behind.
fn ahead(sequence: u16, expected: u16) -> Option<u16> {
    let ahead =
        if sequence >= expected { sequence - expected } else { (sequence - 1).wrapping_sub(expected) };
    (ahead < 1 << 15).then_some(ahead)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(sequences: &[u16], lost: u64, starts: u64) {
        let mut ledger = Ledger::default();
        sequences.iter().for_each(|sequence| {
            ledger.arrived(*sequence);
        });
        assert_eq!((ledger.lost, ledger.starts), (lost, starts), "{sequences:?}");
    }

    #[test]
    fn tells_losses_from_starts() {
        check(&[0, 1, 2], 0, 1);
        check(&[7, 8], 0, 1); // came late
        check(&[0, 1, 4], 2, 1);
        check(&[65_534, 65_535, 1], 0, 1);
        check(&[65_534, 2], 2, 1);
        check(&[5, 0, 1], 0, 2);
        check(&[60_000, 3], 3 + 65_535 - 60_000 - 1, 1);
        check(&[20_000, 3], 3, 2); // 0, 1 and 2 of a new run
        check(&[9, 9], 9, 2);
    }
}
