//! The job of a board with 16 KiB: decode, double window filter, counts of tiles.

use crate::feed;
use crate::job::{FRAME_BYTES, GEOMETRY, Sender, Small, TILES, Tiles, WINDOWS, WINDOWS_LEN};
use crate::measure::Meter;
use crate::sent::Sent;
use core::cell::UnsafeCell;
use lobula_core::filter::DoubleWindow;
use lobula_core::ring::Ring;
use lobula_core::wire::evt2;
use lobula_core::{Decode, Event, Filter, Sink};
use semihosting::println;

static EVT2: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/crop.evt2"));

/// Events of a block.
const EVENTS: usize = 2 * Sink::LEN_MIN;

/// All that the firmware keeps.
struct Memory {
    feed: feed::Memory,
    ring: Option<Ring<'static, u32, u8>>,
    events: [Event; EVENTS],
    windows: [u32; WINDOWS_LEN],
    counted: [u16; TILES],
    frame: [u8; FRAME_BYTES],
}

struct Cell(UnsafeCell<Memory>);

// SAFETY: `run` alone takes it, once at a time.
unsafe impl Sync for Cell {}

static MEMORY: Cell = Cell(UnsafeCell::new(Memory {
    feed: feed::Memory::new(),
    ring: None,
    events: [Event::new(0, 0, 0, lobula_core::Polarity::Off); EVENTS],
    windows: [0; WINDOWS_LEN],
    counted: [0; TILES],
    frame: [0; FRAME_BYTES],
}));

pub fn run() -> bool {
    println!("state_bytes={}", size_of::<Memory>() + size_of::<Small<'static, fn(&[u8])>>());
    job() && measure()
}

fn job() -> bool {
    // SAFETY: what was made of it before is gone.
    let memory = unsafe { &mut *MEMORY.0.get() };
    let mut sent = Sent::new();
    let sender = Sender::new(&mut memory.frame, |frame: &[u8]| sent.send(frame));
    let filter = DoubleWindow::try_new(GEOMETRY, WINDOWS, &mut memory.windows[..]);
    let (Ok(filter), Some(tiles)) = (filter, Tiles::new(&mut memory.counted)) else { return false };
    let decoder = evt2::Decoder::new(GEOMETRY);
    let Some(mut job) = Small::new(decoder, filter, tiles, sender, &mut memory.events) else { return false };
    let ring = memory.ring.insert(Ring::new(&mut memory.feed.slots, &mut memory.feed.elements));
    let Some(rejected) = feed::run(ring, EVT2, |index, bytes, rejected| job.packet(index, bytes, rejected))
    else {
        return false;
    };
    job.finish(rejected);
    drop(job);
    sent.print("evt2");
    true
}

fn measure() -> bool {
    // SAFETY: what was made of it before is gone.
    let memory = unsafe { &mut *MEMORY.0.get() };
    let (mut decoding, mut filtering) = (Meter::default(), Meter::default());
    let mut decoder = evt2::Decoder::new(GEOMETRY);
    let Ok(mut filter) = DoubleWindow::try_new(GEOMETRY, WINDOWS, &mut memory.windows[..]) else {
        return false;
    };
    let mut rest = EVT2;
    while !rest.is_empty() {
        let mut sink = Sink::new(&mut memory.events);
        let mut taken = 0;
        decoding.run(|| {
            taken = decoder.decode(rest, &mut sink);
            sink.len()
        });
        rest = rest.get(taken..).unwrap_or_default();
        let mut block = sink.block(GEOMETRY);
        filtering.run(|| {
            let len = block.len();
            let _ = filter.retain(&mut block);
            len
        });
    }
    println!("decode_evt2={}", decoding.per_event_x100());
    println!("double_window={}", filtering.per_event_x100());
    true
}
