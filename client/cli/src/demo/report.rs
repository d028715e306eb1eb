//! The sums at the end, for people and for programs, and whether the demo holds.

use super::book::{Lost, Page};
use super::live::Outcome;
use super::percentiles::Percentiles;
use super::replay::Replay;
use crate::Failure;
use crate::output::thousands;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The line of `demo --json`: sums over the last generation and the client that was never stopped.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// Events that came into the daemon.
    #[serde(rename = "in")]
    pub input: u64,
    /// Events given to the client.
    pub delivered: u64,
    /// Events the filters removed.
    pub filtered: u64,
    /// Events lost, by cause.
    pub lost: Lost,
    /// From due to received by the client.
    pub latency_ns: Percentiles,
    /// The same through iceoryx2 alone.
    pub floor_ns: Percentiles,
    /// Process ids.
    pub pids: Pids,
    /// Digest of the events a client received in the lossless replay.
    pub sha256_live: String,
    /// Digest of the same bytes, decoded and filtered offline.
    pub sha256_offline: String,
    /// The picture.
    pub png: PathBuf,
}

/// Process ids; of the daemon that of its last generation.
#[derive(Debug, Serialize)]
pub struct Pids {
    /// This process.
    pub demo: u32,
    /// The daemon.
    pub daemon: u32,
    /// The client that was never stopped.
    pub steady: u32,
    /// The client that was stopped.
    pub second: u32,
}

impl Summary {
    /// Adds up what is left when all has ended.
    pub fn new(outcome: &Outcome, floor: Percentiles, replay: &Replay, png: &Path) -> Self {
        let [steady, _] = &outcome.reports;
        let page = steady.book.pages.last().copied().unwrap_or_default();
        let [steady_pid, second_pid] = outcome.reader_pids;
        Self {
            input: page.input(),
            delivered: page.delivered,
            filtered: page.filtered(),
            lost: page.lost(),
            latency_ns: steady.latency,
            floor_ns: floor,
            pids: Pids {
                demo: std::process::id(),
                daemon: outcome.daemon_pid,
                steady: steady_pid,
                second: second_pid,
            },
            sha256_live: replay.sha256_live.clone(),
            sha256_offline: replay.sha256_offline.clone(),
            png: png.to_owned(),
        }
    }
}

/// The sum of one generation, as one client saw it.
pub fn sum(page: &Page) -> String {
    format!(
        "{} in {} {} delivered + {} filtered + {} lost",
        thousands(page.input()),
        if page.is_exact() { "=" } else { "≠" },
        thousands(page.delivered),
        thousands(page.filtered()),
        thousands(page.lost().total()),
    )
}

/// Why events were lost, if any were.
pub fn causes(page: &Page) -> String {
    let lost = page.lost();
    let causes = [
        ("overrun", lost.overrun),
        ("off_sensor", lost.off_sensor),
        ("overload", lost.overload),
        ("no_memory", lost.no_memory),
    ];
    let causes: Vec<_> = causes.into_iter().filter(|(_, n)| *n > 0).map(|(cause, _)| cause).collect();
    if causes.is_empty() { String::new() } else { format!(" ({})", causes.join(", ")) }
}

/// Fails where a sum is not exact, a digest differs, or a client was told of no restart.
pub fn verdict(outcome: &Outcome, replay: &Replay) -> Result<(), Failure> {
    let pages = || outcome.reports.iter().flat_map(|report| &report.book.pages);
    if let Some(page) = pages().find(|page| !page.is_exact()) {
        return Err(Failure::general(format!("events are not accounted for: {}", sum(page))));
    }
    if outcome.reports.iter().any(|report| report.book.pages.len() < 2) {
        return Err(Failure::general("a client saw no second generation of the daemon"));
    }
    if let Some(unknown) = outcome.verdict.as_ref().map(|verdict| verdict.unknown).filter(|n| *n > 0) {
        return Err(Failure::general(format!("{unknown} events came that the camera never sent")));
    }
    if !replay.is_equal() {
        let Replay { lost, sha256_live, sha256_offline, .. } = replay;
        return Err(Failure::general(format!(
            "live is not offline: {sha256_live} with {lost} lost, {sha256_offline}"
        )));
    }
    Ok(())
}
