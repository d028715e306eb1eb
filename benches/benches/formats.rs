//! Files: how fast each format is read, in blocks on one core and whole on one core and on all of them.
//!
//! `cargo bench -p lobula-benches --bench formats -- [--json] [--keep FOLDER] [NAME...]`: only the files whose name
//! contains one of the names. They are written by ourselves from the scene of the other benches, into $TMPDIR or the
//! folder to keep them in (for `benches/peers/`), and read once before they are measured, so that they come from the
//! page cache. `--read PATH` measures a file that another program wrote; then ours are measured only if named.

use lobula_benches::clock::{allowed_cores, median, timed};
use lobula_benches::input::{EVENTS, Scene};
use lobula_core::Span;
use lobula_core::wire::Encoding;
use lobula_formats::{Compression, OpenOptions, Recording, WriteOptions, Writer, open_with};
use std::error::Error;
use std::path::{Path, PathBuf};
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
    file("none.aedat4", |options| options.compression = Some(Compression::None)),
    file("lz4.aedat4", |options| options.compression = Some(Compression::Lz4)),
    file("zstd.aedat4", |options| options.compression = Some(Compression::Zstd)),
    file("none.h5", |options| options.compression = Some(Compression::None)),
    file("gzip.h5", |options| options.compression = Some(Compression::Gzip)),
    file("zstd.h5", |options| options.compression = Some(Compression::Zstd)),
    file("none.bag", |_| {}),
    file("lz4.bag", |options| options.compression = Some(Compression::Lz4)),
    file("none.mcap", |_| {}),
    file("zstd.mcap", |options| options.compression = Some(Compression::Zstd)),
    file("cd.dat", |_| {}),
    file("events.es", |_| {}),
    file("events.npy", |_| {}),
    file("events.npz", |_| {}),
    file("events.csv", |_| {}),
    file("events.txt", |_| {}),
];

/// How often each is read.
const ROUNDS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1).filter(|arg| arg != "--bench");
    let (mut json, mut keep, mut names, mut paths) = (false, None, Vec::new(), Vec::new());
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--json" => json = true,
            "--keep" => keep = Some(PathBuf::from(args.next().ok_or("--keep takes a folder")?)),
            "--read" => paths.push(PathBuf::from(args.next().ok_or("--read takes a file")?)),
            _ => names.push(arg),
        }
    }
    let all = names.is_empty() && paths.is_empty();
    let is_wanted = |file: &&File| all || names.iter().any(|name| file.name.contains(name.as_str()));
    if !json {
        println!(
            "{:<24} {:>8} {:>18} {:>13} {:>13} {:>6}",
            "file", "B/event", "blocks, Mev/s CPU", "load, 1 core", "all cores", "times"
        );
    }
    for path in &paths {
        measure(path, &OpenOptions::default())?.print(json)?;
    }
    if !FILES.iter().any(|file| is_wanted(&file)) {
        return Ok(());
    }
    let scene = Scene::load(EVENTS)?;
    let temporary = std::env::temp_dir().join(format!("lobula-formats-{}", std::process::id()));
    let folder = keep.clone().unwrap_or(temporary);
    std::fs::create_dir_all(&folder)?;
    if !json {
        println!("{}; medians of {ROUNDS}", scene.source);
    }
    for file in FILES.iter().filter(is_wanted) {
        let path = folder.join(file.name);
        write(file, &scene, &path)?;
        let mut options = OpenOptions::default();
        (file.say)(&mut options);
        let row = measure(&path, &options)?;
        assert_eq!(row.events, scene.events.len());
        row.print(json)?;
        if keep.is_none() {
            std::fs::remove_file(folder.join(file.name))?;
        }
    }
    if keep.is_none() {
        std::fs::remove_dir_all(&folder)?;
    }
    Ok(())
}

/// What was measured of a file; rates in Mev/s, of `blocks` by CPU time, of loading by the clock on the wall.
#[derive(serde::Serialize)]
struct Row {
    file: String,
    events: usize,
    bytes_per_event: f64,
    blocks: f64,
    load_one_core: f64,
    load: f64,
}

impl Row {
    fn print(&self, json: bool) -> Result<(), Box<dyn Error>> {
        let Self { file, bytes_per_event, blocks, load_one_core, load, .. } = self;
        let times = load / load_one_core;
        match json {
            true => println!("{}", serde_json::to_string(self)?),
            false => println!(
                "{file:<24} {bytes_per_event:>8.2} {blocks:>18.0} {load_one_core:>13.0} {load:>13.0} {times:>6.2}"
            ),
        }
        Ok(())
    }
}

fn write(file: &File, scene: &Scene, path: &Path) -> Result<(), Box<dyn Error>> {
    let mut options = WriteOptions::default();
    options.overwrite = true;
    (file.set)(&mut options);
    let mut writer = Writer::create(path, Some(scene.geometry), &options)?;
    let t_last = scene.tensor_window.t1;
    writer.write(Span { t_first: scene.t_first, t_last, geometry: scene.geometry, events: &scene.events })?;
    writer.finish()?;
    Ok(())
}

fn measure(path: &Path, options: &OpenOptions) -> Result<Row, Box<dyn Error>> {
    let recording = open_with(path, options)?;
    let events = usize::try_from(read(&recording)?)?;

    let mevs = |time: Duration| events as f64 / time.as_secs_f64() / 1e6;
    let blocks = mevs(median(&mut rounds(|| timed(|| read(&recording)).0)));
    let load = |threads| -> Result<f64, Box<dyn Error>> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let mut times = rounds(|| {
            let start = Instant::now();
            let loaded = pool.install(|| recording.load());
            let taken = start.elapsed();
            assert_eq!(loaded.map(|loaded| loaded.len()).ok(), Some(events));
            taken
        });
        Ok(mevs(median(&mut times)))
    };
    Ok(Row {
        file: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        events,
        bytes_per_event: recording.bytes() as f64 / events as f64,
        blocks,
        load_one_core: load(1)?,
        load: load(allowed_cores()?.len())?,
    })
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
