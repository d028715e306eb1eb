//! Events and control between a microcontroller and a host, without an allocation on either end.
//!
//! | carrier | frame | holds | file |
//! |---|---|---|---|
//! | UART, RS-485 | COBS(sequence, message, CRC-32), 0 | a `Message`: control, tensors, a few events (feature `link`) | `serial` |
//! | USB bulk, UDP | 16-byte header, words | raw EVT words, as the sensor gave them | [`bulk`] |
//!
//! Both decoders take bytes split anywhere, find the next whole frame after garbage or a loss, and give nothing that
//! its CRC does not vouch for. What did not arrive is told by the [`Ledger`], and with the frame after it, so that a
//! decoder of events is given its [`gap`](crate::Decode::gap).

pub mod bulk;
#[cfg(feature = "link")]
mod cobs;
mod crc32;
mod ledger;
#[cfg(feature = "link")]
mod message;
#[cfg(feature = "link")]
pub mod serial;

pub use crc32::Crc32;
pub use ledger::{Fault, Ledger};
#[cfg(feature = "link")]
pub use message::Message;
