//! `lobula hot-pixels`: which pixels of a recording's camera fire without light changing, to a file for filters.

use crate::Failure;
use crate::args::HotPixelsArgs;
use crate::output::{json, line, thousands};
use crate::progress::Progress;
use lobula_formats::{HotPixels, LearnedHotPixels};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Learns them over the whole recording, tells how many there are and what they made, and saves them.
pub fn run(args: &HotPixelsArgs) -> Result<(), Failure> {
    let recording = args.input.open(&args.file)?;
    let mut progress = Progress::start(recording.bytes());
    let learned = HotPixels::learn(&recording, args.sigmas, |position| progress.at(position));
    progress.end();
    let mut learned = learned?;
    if args.serial.is_some() {
        learned.hot.serial.clone_from(&args.serial);
    }
    let output = args.output.as_deref().map(|path| file(path, &learned)).transpose()?;
    if let Some(path) = &output {
        learned.hot.save(path, args.overwrite)?;
    }
    let report = Report {
        pixels: learned.hot.pixels.len(),
        events: learned.events,
        removed: learned.removed,
        share: learned.removed as f64 / learned.events.max(1) as f64,
        serial: learned.hot.serial,
        output,
    };
    if args.json { json(&report) } else { report.print() }
}

/// In a folder each camera has a file of its own.
fn file(path: &Path, learned: &LearnedHotPixels) -> Result<PathBuf, Failure> {
    if !path.is_dir() {
        return Ok(path.into());
    }
    let harmless = |serial: &&String| serial.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
    match learned.hot.serial.as_ref().filter(harmless) {
        Some(serial) => Ok(path.join(format!("{serial}.txt"))),
        None => {
            let text = "is a folder, and the recording tells no serial number that can name a file";
            let text = format!("{}: {text}; give a file's name, or --serial", path.display());
            Err(Failure::new(Failure::INPUT, text))
        }
    }
}

#[derive(Serialize)]
struct Report {
    pixels: usize,
    events: u64,
    removed: u64,
    share: f64,
    serial: Option<String>,
    output: Option<PathBuf>,
}

impl Report {
    fn print(&self) -> Result<(), Failure> {
        line(format!("{:<12} {}", "hot pixels", thousands(self.pixels as u64)))?;
        let (removed, events) = (thousands(self.removed), thousands(self.events));
        line(format!("{:<12} {removed} of {events} ({:.3} %)", "their events", 100.0 * self.share))?;
        if let Some(serial) = &self.serial {
            line(format!("{:<12} {serial}", "camera"))?;
        }
        match &self.output {
            Some(path) => line(format!("{:<12} {}", "written", path.display())),
            None => line(format!("{:<12} nothing: give a file or a folder to keep the list", "written")),
        }
    }
}
