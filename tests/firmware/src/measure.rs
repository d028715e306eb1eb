//! Instructions of stretches of code.

use crate::board;

/// Instructions per event, in hundredths: counted over many stretches.
#[derive(Clone, Copy, Default)]
pub struct Meter {
    instructions: u64,
    events: u64,
}

impl Meter {
    /// Runs `work`, which tells how many events it worked on.
    pub fn run(&mut self, work: impl FnOnce() -> usize) {
        let before = board::ticks();
        let events = work();
        let ticks = board::ticks_since(before);
        self.instructions += board::instructions(ticks);
        self.events += events as u64;
    }

    /// The result.
    pub fn per_event_x100(self) -> u64 {
        (self.instructions * 100).checked_div(self.events).unwrap_or_default()
    }
}
