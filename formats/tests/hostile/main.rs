//! Hostile files: no panic, bounded memory, every byte counted.
#![allow(clippy::unwrap_used)] // helpers of tests may too

use lobula_core::wire::Encoding;
use lobula_core::{Event, Geometry, Polarity, Span};
use lobula_formats::{OpenOptions, RawWriter, Summary, WithDigest, WriteOptions, open, open_with};
use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

/// The system's allocator, which keeps count of what is in use and of the most that was.
struct Counting;

static IN_USE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

#[allow(unsafe_code)] // an allocator cannot be written without
// SAFETY: every call goes to the system's allocator unchanged; only numbers are kept beside it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = IN_USE.fetch_add(layout.size(), Relaxed) + layout.size();
        PEAK.fetch_max(now, Relaxed);
        // SAFETY: the caller's promise, passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        IN_USE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise, passed on.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Memory that opening and reading may take above the file's size.
const BYTES_MAX: usize = 64 << 20;

/// One at a time: the peak is the process's.
static ALONE: Mutex<()> = Mutex::new(());

/// Runs `job`; the most memory it took above what was in use before.
fn peak(job: impl FnOnce()) -> usize {
    let before = IN_USE.load(Relaxed);
    PEAK.store(before, Relaxed);
    job();
    PEAK.load(Relaxed) - before
}

/// Runs `job` and checks its memory.
fn bounded<T>(job: impl FnOnce() -> T) -> T {
    let mut done = None;
    let peak = peak(|| done = Some(job()));
    assert!(peak <= BYTES_MAX, "{peak} bytes above the start");
    done.unwrap()
}

/// Opens and reads to the end, by blocks and by a slice: an error that says where, or every byte in one count.
fn read(path: &Path) -> Option<Summary> {
    let recording = match open(path) {
        Ok(recording) => recording,
        Err(error) => {
            assert!(error.to_string().contains("; "), "{error}");
            return None;
        }
    };
    let payload = recording.payload().unwrap().range();
    let summary = Summary::of(&recording, WithDigest::No).unwrap();
    assert_eq!(summary.bytes_decoded + summary.bytes_faulty, payload.end - payload.start, "{summary:?}");
    let mut slice = recording.slice_time(summary.t_first_us.unwrap_or(0)..u64::MAX).unwrap();
    let mut events = 0;
    while let Some(chunk) = slice.next_block().unwrap() {
        events += chunk.block.len() as u64;
    }
    assert!(events <= summary.events);
    Some(summary)
}

/// A small file with every kind of word that the encoder makes.
fn small(path: &Path, encoding: Encoding) -> Vec<u8> {
    let geometry = Geometry::new(1280, 720);
    let mut options = WriteOptions::default();
    options.overwrite = true;
    let mut writer = RawWriter::create(path, encoding, geometry, &options).unwrap();
    for i in 0..120u64 {
        let t = 1_000 + i * i * 37;
        let run = [0, 1, 2, 5].map(|x| Event::new(t as u32, 64 + x, i as u16, Polarity::from_bit(i as u16)));
        writer.write(Span { t_first: t, t_last: t, geometry, events: &run }).unwrap();
    }
    writer.finish().unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn every_prefix() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.raw");
    for encoding in Encoding::ALL.iter().copied() {
        let whole = small(&path, encoding);
        let mut events_before = 0;
        for len in 0..=whole.len() {
            std::fs::write(&path, &whole[..len]).unwrap();
            let Some(summary) = bounded(|| read(&path)) else { continue };
            assert!(summary.events >= events_before, "a longer prefix has no fewer events");
            assert!(summary.faults["cut_short"] <= 1);
            events_before = summary.events;
        }
        assert_eq!(events_before, 480, "{encoding}");
    }
}

/// A file of 40 MB is written, read, indexed and sliced in the memory of one of 1 MB, and within the index's limit.
#[test]
fn memory_does_not_grow_with_the_file() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir_in(memory()).unwrap();
    let path = folder.path().join("long.raw");
    let geometry = Geometry::new(1280, 720);
    let (mut options, limit) = (OpenOptions::default(), 16 << 10);
    options.limits.index_bytes_max = limit;
    let peak = peak(|| {
        let mut writer =
            RawWriter::create(&path, Encoding::Evt2, geometry, &WriteOptions::default()).unwrap();
        for second in 0..1_000u32 {
            let events: Vec<_> =
                (0..10_000).map(|i| Event::new(second * 1_000_000 + i * 100, 1, 2, Polarity::On)).collect();
            let (t_first, t_last) = (u64::from(second) * 1_000_000, u64::from(second) * 1_000_000 + 999_900);
            writer.write(Span { t_first, t_last, geometry, events: &events }).unwrap();
        }
        assert!(writer.finish().unwrap().bytes > 40_000_000);
        let recording = open_with(&path, &options).unwrap();
        assert_eq!(Summary::of(&recording, WithDigest::No).unwrap().events, 10_000_000);
        let mut slice = recording.slice_time(777_000_000..778_000_000).unwrap();
        let mut events = 0;
        while let Some(chunk) = slice.next_block().unwrap() {
            events += chunk.block.len();
        }
        assert_eq!(events, 10_000);
        assert!(recording.index().unwrap().bytes() <= limit);
    });
    assert!(peak < 1 << 20, "{peak} bytes");
}

/// xorshift: the same mutations in every run.
struct Draw(u64);

impl Draw {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % end as u64) as usize
    }

    /// Flips, overwrites, removes or repeats a few bytes; half of the time in the header, where lies are told.
    fn mutate(&mut self, bytes: &mut Vec<u8>) {
        for _ in 0..=self.below(4) {
            let end = if self.below(2) == 0 { bytes.len().min(80) } else { bytes.len() };
            if end == 0 {
                return;
            }
            let at = self.below(end);
            match self.below(5) {
                0 => bytes[at] ^= 1 << self.below(8),
                1 => bytes[at] = self.below(256) as u8,
                2 => bytes[at] = b"0123456789x;=%\n"[self.below(15)],
                3 => drop(bytes.drain(at..(at + self.below(20)).min(end))),
                _ => {
                    let piece = bytes[at..(at + self.below(20)).min(end)].to_vec();
                    bytes.splice(at..at, piece);
                }
            }
        }
    }
}

#[test]
fn a_hundred_thousand_mutations() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir_in(memory()).unwrap();
    let path = folder.path().join("it.raw");
    let wholes = Encoding::ALL.iter().map(|encoding| small(&path, *encoding)).collect::<Vec<_>>();
    let mut draw = Draw(0x2545_F491_4F6C_DD1D);
    let (mut opened, mut faulty) = (0, 0);
    for i in 0..100_000 {
        let mut bytes = wholes[i % wholes.len()].clone();
        draw.mutate(&mut bytes);
        std::fs::write(&path, &bytes).unwrap();
        let Some(summary) = bounded(|| read(&path)) else { continue };
        opened += 1;
        faulty += usize::from(summary.bytes_faulty > 0);
    }
    assert!(
        opened > 20_000 && faulty > 10_000,
        "the mutations reach the decoders: {opened} opened, {faulty} faulty"
    );
}

/// A folder in memory where there is one: the files are many.
fn memory() -> std::path::PathBuf {
    let shm = Path::new("/dev/shm");
    if shm.is_dir() { shm.to_owned() } else { std::env::temp_dir() }
}
