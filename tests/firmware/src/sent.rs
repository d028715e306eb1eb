//! What leaves the board: through its UART, counted and digested.

use crate::board;
use crate::job::Digest;
use semihosting::println;

/// All that was sent.
pub struct Sent {
    digest: Digest,
    bytes: u64,
}

impl Sent {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self { digest: Digest::new(), bytes: 0 }
    }

    /// Sends a frame.
    pub fn send(&mut self, frame: &[u8]) {
        self.digest.extend(frame);
        self.bytes += frame.len() as u64;
        frame.iter().for_each(|byte| board::send(*byte));
    }

    /// Tells the host of it.
    pub fn print(&self, name: &str) {
        println!("digest_{name}={:016x}", self.digest.0);
        println!("sent_{name}={}", self.bytes);
    }
}
