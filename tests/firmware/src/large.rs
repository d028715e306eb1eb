//! The job of boards with memory for maps: decode, denoise, count and time surface.

use crate::job::{self, DENOISE_LEN, FRAME_BYTES, GEOMETRY, Large, PLANE_BYTES, Planes, SURFACE_LEN, Sender};
use crate::measure::Meter;
use crate::sent::Sent;
use crate::{bits, feed};
use core::cell::UnsafeCell;
use lobula_core::ring::Ring;
use lobula_core::wire::{AnyDecoder, Encoding, evt2, evt3};
use lobula_core::{Decode, Event, Filter, Geometry, Sink, Window};
use semihosting::println;

static EVT3: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/crop.evt3"));
static EVT2: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/crop.evt2"));
/// Bytes of a whole sensor of 1280x720, as it sent them.
static WHOLE: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/whole.evt3"));

/// Events of a block in the job.
const EVENTS: usize = 512;
/// Events of a block where parts are measured: those of a crop's packets.
const MEASURED: usize = 4096;

/// All that the firmware keeps.
struct Memory {
    feed: feed::Memory,
    ring: Option<Ring<'static, u32, u8>>,
    events: [Event; EVENTS],
    denoise: [u16; DENOISE_LEN],
    counted: [u8; PLANE_BYTES],
    surface: [u32; SURFACE_LEN],
    decayed: [u8; 2 * PLANE_BYTES],
    frame: [u8; FRAME_BYTES],
    measured: [Event; MEASURED],
    bits: bits::Memory,
}

const NO_EVENT: Event = Event::new(0, 0, 0, lobula_core::Polarity::Off);

struct Cell(UnsafeCell<Memory>);

// SAFETY: `run` alone takes it, once at a time.
unsafe impl Sync for Cell {}

static MEMORY: Cell = Cell(UnsafeCell::new(Memory {
    feed: feed::Memory::new(),
    ring: None,
    events: [NO_EVENT; EVENTS],
    denoise: [0; DENOISE_LEN],
    counted: [0; PLANE_BYTES],
    surface: [0; SURFACE_LEN],
    decayed: [0; 2 * PLANE_BYTES],
    frame: [0; FRAME_BYTES],
    measured: [NO_EVENT; MEASURED],
    bits: bits::Memory::new(),
}));

/// What decoding and denoising with a hot mask and one plane of counts need.
const STATE_BYTES: usize = size_of::<feed::Memory>()
    + size_of::<Ring<'static, u32, u8>>()
    + size_of::<evt3::Decoder>()
    + size_of::<[Event; EVENTS]>()
    + size_of::<lobula_core::filter::Denoise<u16, &mut [u16]>>()
    + size_of::<[u16; DENOISE_LEN]>()
    + size_of::<[u8; PLANE_BYTES]>();

pub fn run() -> bool {
    println!("state_bytes={STATE_BYTES}");
    job("evt3", Encoding::Evt3, EVT3) && job("evt2", Encoding::Evt2, EVT2) && measure() && same_bits()
}

/// What every stage makes of a fixed stream.
fn same_bits() -> bool {
    // SAFETY: what was made of it before is gone.
    let memory = unsafe { &mut *MEMORY.0.get() };
    bits::each(&mut memory.bits, |name, digest| println!("bits_{name}={digest:016x}"));
    true
}

fn job(name: &str, encoding: Encoding, bytes: &'static [u8]) -> bool {
    // SAFETY: what was made of it before is gone.
    let memory = unsafe { &mut *MEMORY.0.get() };
    let mut sent = Sent::new();
    let sender = Sender::new(&mut memory.frame, |frame: &[u8]| sent.send(frame));
    let planes = Planes::new(&mut memory.counted, &mut memory.surface, &mut memory.decayed);
    let filter = job::denoise(&mut memory.denoise[..]);
    let (Some(planes), Some(filter)) = (planes, filter) else { return false };
    let decoder = AnyDecoder::new(encoding, GEOMETRY);
    let Some(mut job) = Large::new(decoder, filter, planes, sender, &mut memory.events) else { return false };
    let ring = memory.ring.insert(Ring::new(&mut memory.feed.slots, &mut memory.feed.elements));
    let Some(rejected) = feed::run(ring, bytes, |index, bytes, rejected| job.packet(index, bytes, rejected))
    else {
        return false;
    };
    job.finish(rejected);
    drop(job);
    sent.print(name);
    true
}

/// Each part alone, on the crop; decoding also on the whole sensor's words.
fn measure() -> bool {
    // SAFETY: what was made of it before is gone.
    let memory = unsafe { &mut *MEMORY.0.get() };
    let events = &mut memory.measured;
    decoding("decode_evt3", evt3::Decoder::new(GEOMETRY), EVT3, events);
    decoding("decode_evt3_whole", evt3::Decoder::new(Geometry::new(1280, 720)), WHOLE, events);
    decoding("decode_evt2", evt2::Decoder::new(GEOMETRY), EVT2, events);

    let (mut denoising, mut counting, mut stamping) = (Meter::default(), Meter::default(), Meter::default());
    let mut decoder = evt3::Decoder::new(GEOMETRY);
    let planes = Planes::new(&mut memory.counted, &mut memory.surface, &mut memory.decayed);
    let filter = job::denoise(&mut memory.denoise[..]);
    let (Some(mut planes), Some(mut filter)) = (planes, filter) else { return false };
    let mut rest = EVT3;
    let window = Window { t0: 0, t1: 10_000 };
    planes.begin(window);
    while !rest.is_empty() {
        let mut sink = Sink::new(events);
        let taken = decoder.decode(rest, &mut sink);
        rest = rest.get(taken..).unwrap_or_default();
        let mut block = sink.block(GEOMETRY);
        let span = block.span();
        counting.run(|| planes.count(span));
        stamping.run(|| planes.stamp(span));
        denoising.run(|| {
            let len = block.len();
            let _ = filter.retain(&mut block);
            len
        });
    }
    println!("denoise={}", denoising.per_event_x100());
    println!("count={}", counting.per_event_x100());
    println!("time_surface={}", stamping.per_event_x100());
    true
}

fn decoding(name: &str, mut decoder: impl Decode, bytes: &[u8], events: &mut [Event]) {
    let mut meter = Meter::default();
    let mut rest = bytes;
    while !rest.is_empty() {
        let mut sink = Sink::new(events);
        let mut taken = 0;
        meter.run(|| {
            taken = decoder.decode(rest, &mut sink);
            sink.len()
        });
        if taken == 0 {
            break;
        }
        rest = rest.get(taken..).unwrap_or_default();
    }
    println!("{name}={}", meter.per_event_x100());
}
