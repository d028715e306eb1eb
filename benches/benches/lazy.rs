//! Long files: how soon they open, how long a window anywhere in them takes, and in how much memory.
//!
//! `cargo bench -p lobula-benches --bench lazy -- [--mevents N] [NAME...]`: N million events (default 20), only the files
//! whose name contains one of the names. Each file is written by ourselves into $TMPDIR and read by a process of its own,
//! whose highest resident memory is told. The first window is told apart: it makes the index.

use lobula_benches::clock::median;
use lobula_core::wire::Encoding;
use lobula_core::{Event, Geometry, Polarity, Span};
use lobula_formats::{Compression, WriteOptions, Writer, open};
use std::error::Error;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// A file to read: its name, and how it is written.
type File = (&'static str, fn(&mut WriteOptions));

/// A line for each kind of file.
const FILES: &[File] = &[
    ("evt2.raw", |options| options.encoding = Some(Encoding::Evt2)),
    ("evt3.raw", |options| options.encoding = Some(Encoding::Evt3)),
    ("cd.dat", |_| {}),
    ("none.h5", |options| options.compression = Some(Compression::None)),
    ("events.npy", |_| {}),
    ("events.npz", |_| {}),
    ("none.aedat4", |options| options.compression = Some(Compression::None)),
];

const GEOMETRY: Geometry = Geometry::new(1280, 720);
/// Rate of the events in the files.
const EVENTS_A_SECOND: u64 = 1_075_000;
/// Windows asked for, of this length.
const WINDOWS: u64 = 300;
const WINDOW_US: u64 = 33_000;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<_> = std::env::args().skip(1).filter(|arg| arg != "--bench").collect();
    if let [child, path] = &args[..]
        && child == "--read"
    {
        return read(Path::new(path));
    }
    let mut mevents = 20;
    let mut names = Vec::new();
    let mut rest = args.into_iter();
    while let Some(arg) = rest.next() {
        match arg.as_str() {
            "--mevents" => mevents = rest.next().ok_or("--mevents takes a number")?.parse()?,
            _ => names.push(arg),
        }
    }
    let folder = std::env::temp_dir().join(format!("lobula-lazy-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    println!("{mevents} M events at {EVENTS_A_SECOND}/s; {WINDOWS} random windows of {WINDOW_US} µs");
    println!(
        "{:<20} {:>8} {:>9} {:>12} {:>9} {:>9} {:>9} {:>9}",
        "file", "MB", "open, ms", "1st, ms", "p50, ms", "p99, ms", "max, ms", "RSS, MB"
    );
    let is_wanted =
        |file: &&File| names.is_empty() || names.iter().any(|name| file.0.contains(name.as_str()));
    let done =
        FILES.iter().filter(is_wanted).try_for_each(|file| measure(file, mevents * 1_000_000, &folder));
    std::fs::remove_dir_all(&folder)?;
    done
}

fn measure((name, set): &File, events: u64, folder: &Path) -> Result<(), Box<dyn Error>> {
    let path = folder.join(name);
    let mut options = WriteOptions::default();
    set(&mut options);
    let bytes = write(&path, events, &options)?;
    let output = Command::new(std::env::current_exe()?).arg("--read").arg(&path).output()?;
    print!("{name:<20} {:>8.0} {}", bytes as f64 / 1e6, String::from_utf8_lossy(&output.stdout));
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into());
    }
    std::fs::remove_file(&path)?;
    Ok(())
}

/// A file of so many events, evenly in time and anywhere on the sensor.
fn write(path: &Path, events: u64, options: &WriteOptions) -> Result<u64, lobula_formats::Error> {
    let mut writer = Writer::create(path, Some(GEOMETRY), options)?;
    let mut batch = vec![Event::default(); 1 << 16];
    let time = |i: u64| i * 1_000_000 / EVENTS_A_SECOND;
    let mut draw = Draw(7);
    let mut done = 0;
    while done < events {
        let len = batch.len().min((events - done) as usize);
        for (i, slot) in batch[..len].iter_mut().enumerate() {
            let random = draw.next();
            let (x, y) = (random % u64::from(GEOMETRY.width), (random >> 16) % u64::from(GEOMETRY.height));
            let polarity = Polarity::from_bit((random >> 40) as u16);
            *slot = Event::new(time(done + i as u64) as u32, x as u16, y as u16, polarity);
        }
        let (t_first, t_last) = (time(done), time(done + len as u64 - 1));
        writer.write(Span { t_first, t_last, geometry: GEOMETRY, events: &batch[..len] })?;
        done += len as u64;
    }
    Ok(writer.finish()?.bytes)
}

/// xorshift: the same files and windows in every run.
struct Draw(u64);

impl Draw {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
}

/// The child: opens the file and reads windows of it.
fn read(path: &Path) -> Result<(), Box<dyn Error>> {
    let start = Instant::now();
    let recording = open(path)?;
    let opened = start.elapsed();
    let first = window(&recording, 0)?;
    let times = recording.index()?.times().ok_or("there are no events")?;
    let mut draw = Draw(11);
    let mut taken = Vec::new();
    for _ in 0..WINDOWS {
        let t0 = times.t_min + draw.next() % (times.t_max - times.t_min - WINDOW_US);
        taken.push(window(&recording, t0)?);
    }
    let middle = median(&mut taken);
    let [p99, max] = [taken.len() * 99 / 100, taken.len() - 1].map(|i| taken[i]);
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    println!(
        "{:>9.2} {:>12.1} {:>9.2} {:>9.2} {:>9.2} {:>9.0}",
        ms(opened),
        ms(first),
        ms(middle),
        ms(p99),
        ms(max),
        peak_rss_bytes()? as f64 / 1e6
    );
    Ok(())
}

/// How long it takes to read the events of a window.
fn window(recording: &lobula_formats::Recording, t0: u64) -> Result<Duration, lobula_formats::Error> {
    let start = Instant::now();
    let mut blocks = recording.slice_time(t0..t0 + WINDOW_US)?;
    let mut events = 0;
    while let Some(chunk) = blocks.next_block()? {
        events += chunk.block.len();
    }
    let taken = start.elapsed();
    let expected = (EVENTS_A_SECOND * WINDOW_US / 1_000_000) as usize;
    assert!(events.abs_diff(expected) <= 1, "{events} events in the window at {t0} µs");
    Ok(taken)
}

fn peak_rss_bytes() -> Result<u64, Box<dyn Error>> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).ok_or("no VmHWM")?;
    Ok(line.trim().trim_end_matches("kB").trim().parse::<u64>()? * 1024)
}
