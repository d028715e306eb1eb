//! How far a long job is: one line on a terminal, nothing elsewhere.

use std::io::{IsTerminal, Write, stderr};
use std::time::{Duration, Instant};

/// Characters of the bar.
const WIDTH: usize = 30;
/// Time between two lines.
const INTERVAL: Duration = Duration::from_millis(100);

/// Progress of a job over so many bytes.
pub struct Progress {
    bytes: u64,
    started: Instant,
    /// When to draw next; `None` where nothing is to be drawn.
    next: Option<Instant>,
    drawn: bool,
}

impl Progress {
    /// Starts; what takes less than an interval draws nothing.
    pub fn start(bytes: u64) -> Self {
        let started = Instant::now();
        let next = stderr().is_terminal().then(|| started + INTERVAL);
        Self { bytes, started, next, drawn: false }
    }

    /// So many bytes are done.
    pub fn at(&mut self, position: u64) {
        let now = Instant::now();
        if self.next.is_some_and(|next| now >= next) {
            self.next = Some(now + INTERVAL);
            self.drawn = true;
            // Progress that cannot be shown is no reason to stop.
            let _ = write!(stderr(), "\r\x1b[K{}", bar(position, self.bytes, now - self.started));
        }
    }

    /// Takes the line away.
    pub fn end(&mut self) {
        if self.drawn {
            let _ = write!(stderr(), "\r\x1b[K");
        }
    }
}

fn bar(position: u64, bytes: u64, taken: Duration) -> String {
    let part = (position as f64 / bytes.max(1) as f64).clamp(0.0, 1.0);
    let full = (part * WIDTH as f64) as usize;
    let rate = position as f64 / taken.as_secs_f64().max(1e-3);
    let left = (bytes.saturating_sub(position)) as f64 / rate.max(1.0);
    let bar = "█".repeat(full) + &"░".repeat(WIDTH - full);
    format!("{bar} {:3.0} %  {:.0} MB/s  {left:.0} s left", part * 100.0, rate / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_of_one_width() {
        let second = Duration::from_secs(1);
        for (position, text) in [(0, "  0 %"), (50, " 50 %"), (100, "100 %"), (900, "100 %")] {
            let bar = bar(position, 100, second);
            assert!(bar.contains(text), "{bar}");
            assert_eq!(bar.chars().filter(|c| "█░".contains(*c)).count(), WIDTH);
        }
        assert!(bar(0, 0, Duration::ZERO).contains("0 %"));
    }
}
