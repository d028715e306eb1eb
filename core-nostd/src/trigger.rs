//! Side items of a stream: what a camera sends beside its events.

use crate::Polarity;

/// An edge on an external trigger input of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trigger {
    /// Sensor time in µs.
    pub t: u64,
    /// How many events of the stream came before it.
    pub ordinal: u64,
    /// Number of the input.
    pub channel: u8,
    /// Rising (ON) or falling edge.
    pub edge: Polarity,
}

impl Default for Trigger {
    fn default() -> Self {
        Self { t: 0, ordinal: 0, channel: 0, edge: Polarity::Off }
    }
}
