//! What passes over a file found odd, for its warnings: the most that any pass saw, so that two say it once.

use std::sync::atomic::{AtomicU64, Ordering};

/// Counts kept while a recording is read.
#[derive(Debug, Default)]
pub(crate) struct Notes {
    missing_messages: AtomicU64,
    unread_frames: AtomicU64,
    unread_samples: AtomicU64,
    cut_samples: AtomicU64,
}

impl Notes {
    /// So many messages of events are missing by their sequence numbers, counted from the start.
    pub fn missing_messages(&self, count: u64) {
        self.missing_messages.fetch_max(count, Ordering::Relaxed);
    }

    /// So many frames could not be read, counted from the start.
    pub fn unread_frames(&self, count: u64) {
        self.unread_frames.fetch_max(count, Ordering::Relaxed);
    }

    /// So many samples of the inertial sensor could not be read, counted from the start.
    pub fn unread_samples(&self, count: u64) {
        self.unread_samples.fetch_max(count, Ordering::Relaxed);
    }

    /// So many samples tell what is not read of them, counted from the start.
    pub fn cut_samples(&self, count: u64) {
        self.cut_samples.fetch_max(count, Ordering::Relaxed);
    }

    /// In sentences.
    pub fn warnings(&self) -> Vec<String> {
        let told = [
            (&self.missing_messages, "messages of events are missing by their sequence numbers"),
            (&self.unread_frames, "frames are damaged or of a pixel format that we do not read"),
            (&self.unread_samples, "samples of the inertial sensor are damaged"),
            (
                &self.cut_samples,
                "samples of the inertial sensor tell orientation or covariances, which are not read",
            ),
        ];
        let counts = told.map(|(count, what)| (count.load(Ordering::Relaxed), what));
        counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect()
    }
}
