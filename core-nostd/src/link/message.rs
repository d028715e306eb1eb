//! What a microcontroller and its host tell each other, as postcard writes it (<https://postcard.jamesmunns.com>).

use serde::{Deserialize, Serialize};

/// A message of either side. A variant's number is its place: new ones go to the end, none is changed.
///
/// ```
/// use lobula_core::link::{Message, serial};
/// let mut wire = [0; 64];
/// let len = serial::Encoder::new().encode(&Message::Ping { token: 7 }, &mut wire)?;
/// let mut decoder = serial::Decoder::new([0; 64]);
/// let mut tokens = vec![];
/// decoder.decode(&wire[..len], |frame| {
///     if let Message::Ping { token } = frame.message {
///         tokens.push(token);
///     }
/// });
/// assert_eq!(tokens, [7]);
/// # Ok::<(), serial::TooLong>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Message<'a> {
    /// To the host, first: who is there.
    Hello {
        /// [`Message::PROTOCOL`].
        protocol: u16,
        /// Columns of the sensor.
        width: u16,
        /// Rows of the sensor.
        height: u16,
        /// Format of [`Words`](Self::Words), as in [`bulk`](super::bulk).
        encoding: u8,
        /// Name of the camera.
        name: &'a str,
    },
    /// To the host: words of a camera's format, which go on where those of the last such message ended.
    Words {
        /// Stream time before them, in µs.
        t_base: u64,
        /// The words; they may be split anywhere.
        bytes: &'a [u8],
    },
    /// To the host: a piece of a tensor.
    Tensor {
        /// Which of the sender's views.
        view: u8,
        /// [`Dtype`](crate::representation::Dtype) of its elements, as a number.
        dtype: u8,
        /// Start of its window, in µs.
        t0: u64,
        /// End of its window, in µs.
        t1: u64,
        /// Where the piece begins, in bytes.
        offset: u32,
        /// The piece, elements little-endian.
        bytes: &'a [u8],
    },
    /// To the host: what was lost or dropped before the link, since the start.
    Losses {
        /// Packets of the camera that found the ring full.
        packets: u32,
        /// Bytes in them.
        bytes: u32,
        /// Malformed words.
        faults: u32,
        /// Events off the sensor.
        off_sensor: u32,
    },
    /// To either: answer with [`Pong`](Self::Pong).
    Ping {
        /// To tell answers apart.
        token: u32,
    },
    /// To either: the answer.
    Pong {
        /// That of the ping.
        token: u32,
        /// Stream time, in µs.
        now: u64,
    },
    /// To the microcontroller: begin to send.
    Start,
    /// To the microcontroller: send no more.
    Stop,
    /// To the microcontroller: new [parameters](crate::filter::DenoiseParams), in its units.
    Denoise {
        /// Least time between events of a pixel, in µs.
        refractory_us: u32,
        /// How long ago a neighbour's event still supports, in µs.
        support_us: u32,
        /// How many neighbours must support.
        support: u8,
        /// How long a trail of the same polarity is dropped, in µs.
        trail_us: u32,
    },
    /// To the microcontroller: a hot pixel.
    MaskPixel {
        /// Column.
        x: u16,
        /// Row.
        y: u16,
    },
    /// To the microcontroller: length of the views' windows.
    Period {
        /// In µs.
        period_us: u32,
    },
}

impl Message<'_> {
    /// Version of the messages; it changes where an older end would misread.
    pub const PROTOCOL: u16 = 1;
}
