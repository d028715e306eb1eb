//! The digest by which any two programs can compare what they read.

use lobula_core::Span;
use sha2::Digest as _;

/// SHA-256 over events in order, each as little-endian u64 t (µs), u16 x, u16 y, u8 p.
///
/// ```
/// use lobula_core::{Event, Geometry, Polarity, Span};
/// use lobula_formats::Digest;
/// let events = [Event::new(7, 1, 2, Polarity::On)];
/// let mut digest = Digest::default();
/// digest.update(Span { t_first: 7, t_last: 7, geometry: Geometry::new(4, 4), events: &events });
/// assert!(digest.finish().starts_with("3cdef7"));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Digest {
    sha: sha2::Sha256,
}

/// Bytes of one event in the digest.
const EVENT_BYTES: usize = 13;
/// Events hashed at once, so that the hash runs over whole blocks.
const BATCH: usize = 512;

impl Digest {
    /// Adds events.
    pub fn update(&mut self, span: Span<'_>) {
        let mut bytes = [0; BATCH * EVENT_BYTES];
        for events in span.events.chunks(BATCH) {
            for (event, slot) in events.iter().zip(bytes.chunks_exact_mut(EVENT_BYTES)) {
                slot[..8].copy_from_slice(&span.time(*event).to_le_bytes());
                slot[8..10].copy_from_slice(&event.x().to_le_bytes());
                slot[10..12].copy_from_slice(&event.y().to_le_bytes());
                slot[12] = event.is_on() as u8;
            }
            self.sha.update(&bytes[..events.len() * EVENT_BYTES]);
        }
    }

    /// The digest in 64 hexadecimal digits.
    pub fn finish(self) -> String {
        self.sha.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}
