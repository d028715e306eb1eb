//! What a recording holds beside events: samples of an inertial sensor, frames.

use serde::Serialize;
use std::ops::Range;

/// What kind a stream of a recording is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum StreamKind {
    /// Brightness changes.
    Events,
    /// Edges on trigger inputs.
    Triggers,
    /// [`ImuSample`]s.
    Imu,
    /// [`Frame`]s.
    Frames,
    /// Something we do not read; it is named so that nothing is missing silently.
    Other,
}

impl StreamKind {
    /// Its name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Events => "events",
            Self::Triggers => "triggers",
            Self::Imu => "IMU",
            Self::Frames => "frames",
            Self::Other => "not read",
        }
    }
}

/// A stream of a recording, as its header or index tells it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Stream {
    /// What kind it is.
    pub kind: StreamKind,
    /// Its name in the file: a topic, a number; empty where the format has none.
    pub name: String,
}

impl Stream {
    pub(crate) fn new(kind: StreamKind, name: impl Into<String>) -> Self {
        Self { kind, name: name.into() }
    }
}

/// A sample of an inertial measurement unit, in the camera's axes as the file tells them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImuSample {
    /// Time in µs, on the clock of the events.
    pub t: u64,
    /// Acceleration along x, y, z, in m/s².
    pub acceleration: [f64; 3],
    /// Rotation about x, y, z, in rad/s.
    pub rotation: [f64; 3],
    /// Magnetic field along x, y, z, in µT, where it is measured.
    pub magnetic_field: Option<[f64; 3]>,
    /// Temperature in °C, where it is measured.
    pub temperature: Option<f64>,
}

/// Layout of a frame's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum PixelFormat {
    /// One byte of brightness.
    Gray8,
    /// Two bytes of brightness, little-endian.
    Gray16,
    /// A byte each of blue, green, red.
    Bgr8,
    /// A byte each of blue, green, red, opacity.
    Bgra8,
    /// A byte each of red, green, blue.
    Rgb8,
}

impl PixelFormat {
    /// Bytes of a pixel.
    pub const fn bytes(self) -> usize {
        match self {
            Self::Gray8 => 1,
            Self::Gray16 => 2,
            Self::Bgr8 | Self::Rgb8 => 3,
            Self::Bgra8 => 4,
        }
    }
}

/// An image that the camera took beside its events.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Time in µs, on the clock of the events, as the file's own time of it (the start or middle of exposure).
    pub t: u64,
    /// Start and end of the exposure in µs, where the file tells them.
    pub exposure: Option<Range<u64>>,
    /// Column on the sensor of its left edge.
    pub x: u16,
    /// Row on the sensor of its top edge.
    pub y: u16,
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// Layout of a pixel.
    pub format: PixelFormat,
    /// Rows from the top, without padding: `width * height * format.bytes()` bytes.
    pub pixels: Vec<u8>,
}
