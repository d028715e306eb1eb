//! Two sides do the same work in turn; medians of CPU time, and whether ours is as much faster as asked.

use std::time::Duration;

use serde::Serialize;

use crate::clock::{median, timed};

/// How the work is handed over; the same for both sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Protocol {
    /// All at once, into fresh arrays.
    Whole,
    /// A packet at a time, into buffers used again; where the peer has no such way, its best one.
    Stream,
}

impl Protocol {
    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Whole => "whole",
            Self::Stream => "stream",
        }
    }
}

/// What a figure counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Unit {
    /// Millions of events a second of CPU time; more is better.
    #[serde(rename = "Mev/s")]
    Rate,
    /// Milliseconds of CPU time for one tensor; less is better.
    #[serde(rename = "ms")]
    Time,
}

impl Unit {
    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rate => "Mev/s",
            Self::Time => "ms",
        }
    }

    fn figure(self, time: Duration, events: usize) -> f64 {
        match self {
            Self::Rate => events as f64 / time.as_secs_f64().max(1e-9) / 1e6,
            Self::Time => time.as_secs_f64() * 1e3,
        }
    }
}

/// One way of doing the work: called again and again; returns a number that tells a wrong answer (a count).
pub type Work<'a> = Box<dyn FnMut() -> u64 + 'a>;

/// A peer's way of doing it, and its name.
pub struct Peer<'a> {
    /// Library, version and the call.
    pub name: String,
    /// The work.
    pub work: Work<'a>,
    /// The count it must give, where the two sides mean something else by it; else ours.
    pub expected: Option<u64>,
}

/// An operation in one protocol, ready to run.
pub struct Contest<'a> {
    /// Name of the operation.
    pub op: &'static str,
    /// Kernel of ours: `portable`, `avx512`.
    pub kernel: &'static str,
    /// How the work is handed over.
    pub protocol: Protocol,
    /// What the figures count.
    pub unit: Unit,
    /// Events of one run.
    pub events: usize,
    /// The count one run must give.
    pub expected: u64,
    /// Our side.
    pub ours: Work<'a>,
    /// The other sides; the quickest counts.
    pub peers: Vec<Peer<'a>>,
    /// How much faster ours shall be.
    pub bar: Option<f64>,
    /// How the two sides differ in what they do.
    pub note: &'static str,
}

/// A line of the report.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// Name of the operation.
    pub op: &'static str,
    /// Kernel of ours.
    pub kernel: &'static str,
    /// How the work was handed over.
    pub protocol: Protocol,
    /// What `ours` and `peer` count.
    pub unit: Unit,
    /// Our figure.
    pub ours: f64,
    /// Which peer, and its call.
    pub peer_name: Option<String>,
    /// The peer's figure.
    pub peer: Option<f64>,
    /// How many times as fast ours is.
    pub ratio: Option<f64>,
    /// How many times as fast it shall be.
    pub bar: Option<f64>,
    /// Instructions of our portable code for an event, where there is no peer to compare with and they can be counted.
    pub instructions: Option<f64>,
    /// How the two sides differ in what they do.
    pub note: &'static str,
}

impl Contest<'_> {
    /// Runs every side once to warm up and then `rounds` times in turn.
    ///
    /// # Errors
    /// A sentence, where a side gives a count other than the one expected: a wrong answer has no speed.
    pub fn run(mut self, rounds: usize) -> Result<Line, String> {
        let mut ours = Vec::new();
        let mut theirs = vec![Vec::new(); self.peers.len()];
        let (op, expected) = (self.op, self.expected);
        for round in 0..=rounds {
            let times = turn(&mut self.ours, |count| check(op, "ours", expected, count))?;
            record(&mut ours, round, &times);
            for (peer, all) in self.peers.iter_mut().zip(&mut theirs) {
                let expected = peer.expected.unwrap_or(expected);
                let times = turn(&mut peer.work, |count| check(op, &peer.name, expected, count))?;
                record(all, round, &times);
            }
        }
        let times = theirs.iter_mut().map(|times| median(times));
        let best = times.zip(&self.peers).min_by_key(|(time, _)| *time);
        Ok(self.line(median(&mut ours), best))
    }

    fn line(&self, ours: Duration, best: Option<(Duration, &Peer<'_>)>) -> Line {
        let figure = |time| self.unit.figure(time, self.events);
        Line {
            op: self.op,
            kernel: self.kernel,
            protocol: self.protocol,
            unit: self.unit,
            ours: figure(ours),
            peer_name: best.map(|(_, peer)| peer.name.clone()),
            peer: best.map(|(time, _)| figure(time)),
            ratio: best.map(|(time, _)| time.as_secs_f64() / ours.as_secs_f64().max(1e-9)),
            bar: self.bar,
            instructions: None,
            note: self.note,
        }
    }
}

fn check(op: &str, side: &str, expected: u64, count: u64) -> Result<(), String> {
    if count == expected { Ok(()) } else { Err(format!("{op}, {side}: gave {count}, expected {expected}")) }
}

/// One side's turn: times of its runs.
///
/// A long run is one. A short one would tell what the other side left in the caches, so it is made again and again, and
/// the first does not count.
fn turn(work: &mut Work<'_>, check: impl Fn(u64) -> Result<(), String>) -> Result<Vec<Duration>, String> {
    let (first, count) = timed(&mut *work);
    check(count)?;
    if first > SHORT {
        return Ok(vec![first]);
    }
    let mut times = Vec::new();
    for _ in 0..AGAIN {
        let (time, count) = timed(&mut *work);
        check(count)?;
        times.push(time);
    }
    Ok(times)
}

/// A run that takes no longer is repeated.
const SHORT: Duration = Duration::from_millis(100);
/// How often.
const AGAIN: usize = 4;

/// The first round warms up and is not counted.
fn record(all: &mut Vec<Duration>, round: usize, times: &[Duration]) {
    if round > 0 {
        all.extend_from_slice(times);
    }
}
