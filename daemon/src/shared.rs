//! What the threads of a camera know of each other beside the rings.

use crate::ledger::Board;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use lobula_client::control::SourceState;
use lobula_client::transport::Patience;
use lobula_core::Geometry;
use std::sync::{Arc, Mutex, PoisonError};

/// One camera's facts and flags.
#[derive(Debug)]
pub struct Shared {
    /// The daemon's run: ms since 1970 at its start.
    pub generation: u64,
    /// Name of the camera.
    pub camera: String,
    /// The sensor's size.
    pub geometry: Geometry,
    /// Whether nothing may be lost: the source waits for its clients.
    pub lossless: bool,
    /// How long lossless streams wait for slow clients.
    pub patience: Arc<Patience>,
    /// The pipeline's counts.
    pub board: Board,
    /// The views' counts, in the order of the configuration.
    pub views: Vec<ViewCounts>,
    /// Transfers that were taken long after they were due.
    pub behind: AtomicU64,
    /// Packets that the views did not get since they were behind.
    pub views_missed: AtomicU64,
    stop: AtomicBool,
    play: AtomicBool,
    state: AtomicU8,
    degraded: Mutex<Vec<String>>,
}

/// A view's counts.
#[derive(Debug, Default)]
pub struct ViewCounts {
    /// Windows published.
    pub published: AtomicU64,
    /// Windows not published.
    pub skipped: AtomicU64,
    /// Events older than their window.
    pub late: AtomicU64,
    /// Events that their slice had no room for.
    pub overflowed: AtomicU64,
}

impl Shared {
    /// A camera that has not started.
    pub fn new(generation: u64, camera: String, geometry: Geometry, lossless: bool, views: usize) -> Self {
        Self {
            generation,
            camera,
            geometry,
            lossless,
            patience: Arc::default(),
            board: Board::default(),
            views: (0..views).map(|_| ViewCounts::default()).collect(),
            behind: AtomicU64::new(0),
            views_missed: AtomicU64::new(0),
            stop: AtomicBool::new(false),
            play: AtomicBool::new(!lossless),
            state: AtomicU8::new(0),
            degraded: Mutex::default(),
        }
    }

    /// Ends the camera: no more bytes, what has come goes out, then the end.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Release);
        self.patience.give_up();
    }

    /// Whether it is to end.
    pub fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    /// Lets a lossless replay start.
    pub fn play(&self) {
        self.play.store(true, Ordering::Release);
    }

    /// Whether the source may give bytes.
    pub fn is_playing(&self) -> bool {
        self.play.load(Ordering::Acquire)
    }

    /// State of the source.
    pub fn state(&self) -> SourceState {
        let states = [SourceState::Waiting, SourceState::Playing, SourceState::Ended, SourceState::NoDevice];
        states.get(usize::from(self.state.load(Ordering::Relaxed))).copied().unwrap_or(SourceState::NoDevice)
    }

    /// Changes the state of the source.
    pub fn set_state(&self, state: SourceState) {
        let code = match state {
            SourceState::Waiting => 0,
            SourceState::Playing => 1,
            SourceState::Ended => 2,
            SourceState::NoDevice => 3,
        };
        self.state.store(code, Ordering::Relaxed);
    }

    /// Notes what is not as it should be, once.
    pub fn degrade(&self, reason: String) {
        let mut reasons = self.degraded.lock().unwrap_or_else(PoisonError::into_inner);
        if !reasons.contains(&reason) && reasons.len() < 16 {
            tracing::warn!("{reason}");
            reasons.push(reason);
        }
    }

    /// What is not as it should be.
    pub fn degraded(&self) -> Vec<String> {
        self.degraded.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
