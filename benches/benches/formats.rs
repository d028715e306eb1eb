//! Files: how fast each format is read, in blocks on one core and whole on one core and on all of them.
//!
//! `cargo bench -p lobula-benches --bench formats -- [NAME...]`: only the files whose name contains one of the names.
//! The files are written by ourselves from the scene of the other benches, into the system's temporary folder, and read
//! once before they are measured, so that they come from the page cache.

use lobula_benches::clock::{allowed_cores, median, timed};
use lobula_benches::input::{EVENTS, Scene};
use lobula_core::Span;
use lobula_core::wire::Encoding;
use lobula_formats::{OpenOptions, Recording, WriteOptions, Writer, open_with};
use std::path::Path;
use std::time::{Duration, Instant};

/// A file to read.
struct File {
    name: &'static str,
    set: fn(&mut WriteOptions),
    say: fn(&mut OpenOptions),
}

const fn file(name: &'static str, set: fn(&mut WriteOptions)) -> File {
    File { name, set, say: |_| {} }
}

/// A line for each kind of file.
const FILES: &[File] = &[
    file("evt2.raw", |options| options.encoding = Some(Encoding::Evt2)),
    file("evt21.raw", |options| options.encoding = Encoding::from_name("evt21")),
    file("evt3.raw", |options| options.encoding = Some(Encoding::Evt3)),
];

/// How often each is read.
const ROUNDS: usize = 5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let wanted: Vec<_> = std::env::args().skip(1).filter(|arg| !arg.starts_with("--")).collect();
    let is_wanted =
        |file: &&File| wanted.is_empty() || wanted.iter().any(|name| file.name.contains(name.as_str()));
    let scene = Scene::load(EVENTS)?;
    println!("{}; medians of {ROUNDS}", scene.source);
    println!(
        "{:<24} {:>8} {:>16} {:>13} {:>13} {:>6}",
        "file", "B/event", "blocks, Mev/s CPU", "load, 1 core", "all cores", "times"
    );
    let folder = std::env::temp_dir().join(format!("lobula-formats-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let done = FILES.iter().filter(is_wanted).try_for_each(|file| measure(file, &scene, &folder));
    std::fs::remove_dir_all(&folder)?;
    done
}

fn measure(file: &File, scene: &Scene, folder: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let path = folder.join(file.name);
    let mut options = WriteOptions::default();
    (file.set)(&mut options);
    let mut writer = Writer::create(&path, Some(scene.geometry), &options)?;
    let t_last = scene.tensor_window.t1;
    writer.write(Span { t_first: scene.t_first, t_last, geometry: scene.geometry, events: &scene.events })?;
    let written = writer.finish()?;
    let mut options = OpenOptions::default();
    (file.say)(&mut options);
    let recording = open_with(&path, &options)?;
    assert_eq!(read(&recording)?, scene.events.len() as u64);

    let mevs = |time: Duration| scene.events.len() as f64 / time.as_secs_f64() / 1e6;
    let mut times = rounds(|| timed(|| read(&recording)).0);
    let blocks = mevs(median(&mut times));
    let cores = allowed_cores()?.len();
    let load = |threads| -> Result<f64, Box<dyn std::error::Error>> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let mut times = rounds(|| {
            let start = Instant::now();
            let loaded = pool.install(|| recording.load());
            let taken = start.elapsed();
            assert_eq!(loaded.map(|loaded| loaded.len()).ok(), Some(scene.events.len()));
            taken
        });
        Ok(mevs(median(&mut times)))
    };
    let (one, all) = (load(1)?, load(cores)?);
    let size = written.bytes as f64 / scene.events.len() as f64;
    println!("{:<24} {size:>8.2} {blocks:>16.0} {one:>13.0} {all:>13.0} {:>6.2}", file.name, all / one);
    std::fs::remove_file(&path)?;
    Ok(())
}

fn rounds(mut once: impl FnMut() -> Duration) -> Vec<Duration> {
    (0..ROUNDS).map(|_| once()).collect()
}

/// Number of events, read in blocks.
fn read(recording: &Recording) -> Result<u64, lobula_formats::Error> {
    let mut blocks = recording.blocks();
    let mut events = 0;
    while let Some(chunk) = blocks.next_block()? {
        events += chunk.block.len() as u64;
    }
    Ok(events)
}
