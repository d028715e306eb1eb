//! A client process of the demo: reads, counts, measures, and tells the demo on standard output.

use super::book::Book;
use super::percentiles::Percentiles;
use crate::args::ReaderArgs;
use crate::{Failure, output};
use lobula_client::{Client, ClientOptions, Error, Root, SubscribeOptions};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

/// What a reader tells, a few times a second and at its end.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Report {
    /// What it has counted.
    pub book: Book,
    /// From due to received, in the generation that is now.
    pub latency: Percentiles,
    /// Whether nothing follows.
    pub last: bool,
}

/// Time between two reports.
const REPORT: Duration = Duration::from_millis(200);

/// What goes from the reading thread to the telling one, so that sorting and printing never delay a packet.
struct Note {
    book: Book,
    latencies_ns: Vec<u64>,
}

/// Reads until its input ends.
pub fn run(args: &ReaderArgs) -> Result<(), Failure> {
    lobulad::die_with_parent();
    let ended = input_ends();
    let options = ClientOptions::default().root(Root::new(&args.root)?).name(&args.name);
    let client = Client::connect_within(options, Duration::from_secs(120))?;
    let mut events = client.events(SubscribeOptions::default())?;
    let (notes, told) = channel();
    let teller = thread::spawn(move || tell(&told));
    let mut note = Note { book: Book::default(), latencies_ns: Vec::with_capacity(4096) };
    let mut due = Instant::now();
    // The daemon's run, and when its first packet was received here.
    let (mut generation, mut live_ns) = (0, 0);
    while !ended.load(Ordering::Relaxed) {
        match events.recv(Duration::from_millis(50)) {
            Ok(packet) => {
                let (now, header) = (lobulad::now_ns(), packet.header());
                note.book.take(header, packet.len() as u64, packet.lost_before());
                if generation != header.generation {
                    (generation, live_ns) = (header.generation, now);
                }
                // What waited in the queue while this client still connected says nothing of the way.
                let is_live = header.stamps.published_ns >= live_ns;
                if is_live && header.stamps.due_ns > 0 && !packet.is_empty() {
                    note.latencies_ns.push(now.saturating_sub(header.stamps.due_ns));
                }
            }
            Err(Error::Timeout { .. } | Error::NoDaemon { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        if Instant::now() >= due {
            due = Instant::now() + REPORT;
            let latencies_ns = std::mem::replace(&mut note.latencies_ns, Vec::with_capacity(4096));
            // The teller ends only where nobody listens any more, and then so does this process.
            let _ = notes.send(Note { book: note.book.clone(), latencies_ns });
        }
    }
    let _ = notes.send(note);
    drop(notes);
    teller.join().unwrap_or_else(|_| Err(Failure::general("the reader's report failed")))
}

/// Prints a report for each note, and a last one.
fn tell(notes: &Receiver<Note>) -> Result<(), Failure> {
    let (mut report, mut latencies_ns) = (Report::default(), Vec::new());
    while let Ok(mut note) = notes.recv() {
        if note.book.pages.len() > report.book.pages.len() {
            latencies_ns.clear();
        }
        latencies_ns.append(&mut note.latencies_ns);
        report.book = note.book;
        report.latency = Percentiles::of(&mut latencies_ns);
        output::json(&report)?;
    }
    report.last = true;
    output::json(&report)
}

/// Set once standard input ends: the demo has gone, or wants the last report.
fn input_ends() -> Arc<AtomicBool> {
    let ended = Arc::new(AtomicBool::new(false));
    let set = ended.clone();
    thread::spawn(move || {
        let mut byte = [0];
        while matches!(std::io::stdin().read(&mut byte), Ok(n) if n > 0) {}
        set.store(true, Ordering::Relaxed);
    });
    ended
}
