//! The camera: a packet of its bytes at each tick of the timer, into the ring.

use crate::board;
use crate::job::{LOST, PACKET_BYTES, SLOTS, stall_at};
use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicUsize, Ordering};
use lobula_core::ring::{Consumer, Producer, Rejected, Ring, Slot};

type Bytes = Ring<'static, u32, u8>;

/// Memory of a feed.
pub struct Memory {
    pub slots: [Slot<u32>; SLOTS],
    pub elements: [u8; SLOTS * PACKET_BYTES],
}

impl Memory {
    pub const fn new() -> Self {
        Self { slots: [const { Slot::new() }; SLOTS], elements: [0; SLOTS * PACKET_BYTES] }
    }
}

/// The interrupt's end of the ring, and what it sends.
struct Camera {
    producer: Producer<&'static Bytes>,
    packets: core::slice::Chunks<'static, u8>,
}

/// For the interrupt alone while it is enabled.
struct Isr(UnsafeCell<Option<Camera>>);

// SAFETY: written by `run` with the interrupt off, and by the interrupt; there is one core.
unsafe impl Sync for Isr {}

static CAMERA: Isr = Isr(UnsafeCell::new(None));
/// Packets that the interrupt has offered to the ring. Loads and stores only: a Cortex-M0 has no more.
static OFFERED: AtomicUsize = AtomicUsize::new(0);

/// A tick of the board's timer.
pub fn tick() {
    // SAFETY: the main loop touches it with the interrupt off only.
    let Some(camera) = (unsafe { &mut *CAMERA.0.get() }) else { return };
    let Some(packet) = camera.packets.next() else { return };
    let index = OFFERED.load(Ordering::Relaxed);
    // A full ring counts what it turns away.
    let _ = camera.producer.try_push(index as u32, packet);
    OFFERED.store(index + 1, Ordering::Release);
}

/// Feeds `bytes` to `each` by way of the interrupt and the ring; what the ring turned away.
pub fn run(
    ring: &'static mut Bytes,
    bytes: &'static [u8],
    mut each: impl FnMut(u32, &[u8], Rejected) -> bool,
) -> Option<Rejected> {
    let (producer, mut consumer) = ring.split();
    OFFERED.store(0, Ordering::Relaxed);
    // SAFETY: the interrupt is off.
    unsafe { *CAMERA.0.get() = Some(Camera { producer, packets: bytes.chunks(PACKET_BYTES) }) };
    board::start_ticks();
    let ok = drain(&mut consumer, bytes, &mut each);
    board::stop_ticks();
    let rejected = consumer.ring().rejected();
    // SAFETY: the interrupt is off.
    unsafe { *CAMERA.0.get() = None };
    ok.then_some(rejected)
}

fn drain(
    consumer: &mut Consumer<&'static Bytes>,
    bytes: &[u8],
    each: &mut impl FnMut(u32, &[u8], Rejected) -> bool,
) -> bool {
    let packets = bytes.len().div_ceil(PACKET_BYTES);
    let mut next = 0;
    loop {
        // Something else keeps the core busy for a while.
        while next == stall_at(bytes) && OFFERED.load(Ordering::Acquire) < (next + SLOTS + LOST).min(packets)
        {
            board::wait();
        }
        let all_offered = OFFERED.load(Ordering::Acquire) >= packets; // before the look into the ring
        let rejected = consumer.ring().rejected();
        match consumer.pop() {
            Some(packet) if !each(packet.header(), packet.elements(), rejected) => return false,
            Some(packet) => next = packet.header() as usize + 1,
            None if all_offered => return true,
            None => board::wait(),
        }
    }
}
