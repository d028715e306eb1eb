//! A ring of packets between one producer and one consumer, over the caller's memory: the daemon's hops from source to
//! pipeline (bytes) and from pipeline to views (events), and firmware's from interrupt to main loop.
//!
//! A packet is a header and up to `slot_len` elements. Nobody waits: full is a value, and what was rejected is counted
//! where both sides see it. Only loads and stores of one word are used, no compare-and-swap: a Cortex-M0 has none.
//!
//! ```text
//!  slots     [ header, len | header, len | header, len | ... ]      count = slots.len()
//!  elements  [ slot_len    | slot_len    | slot_len    | ... ]   slot_len = elements.len() / count
//! ```
//!
//! Firmware: memory is `&'static mut`, the producer goes to the interrupt, the consumer stays in the main loop. Host:
//! memory outlives the threads of a scope, or is the ring's own on the heap ([`Shared::new`], feature `alloc`).
//!
//! ```
//! use lobula_core::ring::{Ring, Slot};
//! let mut slots = [const { Slot::new() }; 3];
//! let mut elements = [0u8; 3 * 512];
//! let mut ring = Ring::new(&mut slots, &mut elements);
//! let (mut source, mut pipeline) = ring.split();
//! let sum = std::thread::scope(|scope| {
//!     scope.spawn(move || {
//!         for stamp in 0..100u64 {
//!             while source.try_push(stamp, &[1, 2, 3]).is_err() {
//!                 std::thread::yield_now();
//!             }
//!         }
//!     });
//!     let (mut packets, mut sum) = (0, 0u64);
//!     while packets < 100 {
//!         let Some(packet) = pipeline.pop() else {
//!             std::thread::yield_now();
//!             continue;
//!         };
//!         assert_eq!((packet.header(), packet.elements()), (packets, &[1u8, 2, 3][..]));
//!         packets += 1;
//!         sum += packet.header();
//!     } // a packet's slot is free again when it is dropped
//!     sum
//! });
//! assert_eq!(sum, 99 * 100 / 2);
//! ```
#![allow(unsafe_code)] // two threads share the caller's memory: that is what this file is for

#[cfg(feature = "alloc")]
mod shared;
mod sync;

#[cfg(all(test, loom))]
mod loom_tests;
#[cfg(all(test, not(loom)))]
mod tests;

#[cfg(feature = "alloc")]
pub use shared::Shared;

use bytemuck::Pod;
use core::marker::PhantomData;
use core::mem::MaybeUninit;
use core::ops::Deref;
use core::ptr::NonNull;
use sync::{AtomicUsize, Cell, Ordering, Reading, Writing};

/// Room for a packet's header and length; its elements lie in a slice of their own.
#[derive(Debug)]
pub struct Slot<H> {
    content: Cell<Content<H>>,
}

#[derive(Debug)]
struct Content<H> {
    /// Written before `head` passes the slot, read after.
    header: MaybeUninit<H>,
    len: usize,
}

// Not derived: that would ask for a `Clone` of what may not be there.
impl<H: Copy> Clone for Content<H> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<H: Copy> Copy for Content<H> {}

impl<H> Slot<H> {
    sync::const_unless_loom! {
        /// An empty slot.
        pub fn new() -> Self {
            Self { content: Cell::new(Content { header: MaybeUninit::uninit(), len: 0 }) }
        }
    }
}

impl<H> Default for Slot<H> {
    fn default() -> Self {
        Self::new()
    }
}

/// The ring itself: [`split`](Self::split) gives its two ends.
///
/// `head` and `tail` are positions in `0..2 * count`, so that full (they differ by `count`) and empty (they are equal)
/// differ without a slot left free, and `count` may be any number. Slots from `tail` up to `head` are the consumer's,
/// all others the producer's; only the producer stores `head`, only the consumer `tail`.
#[derive(Debug)]
pub struct Ring<'m, H, T> {
    slots: NonNull<Slot<H>>,
    count: usize,
    elements: NonNull<T>,
    slot_len: usize,
    head: AtomicUsize,
    tail: AtomicUsize,
    rejected_packets: AtomicUsize,
    rejected_elements: AtomicUsize,
    memory: PhantomData<(&'m mut [Slot<H>], &'m mut [T])>,
}

// SAFETY: the ring has the only reference to its memory for 'm. Through `&Ring` nothing but atomics is touched; slots
// and elements are touched by the one producer and the one consumer, each in its own part (see `Ring`), which is
// handed over by a release store and an acquire load. H and T go from one thread to the other, hence Send.
unsafe impl<H: Send, T: Send> Sync for Ring<'_, H, T> {}
// SAFETY: as above; nothing in it belongs to a thread.
unsafe impl<H: Send, T: Send> Send for Ring<'_, H, T> {}

impl<'m, H: Copy + 'static, T: Pod> Ring<'m, H, T> {
    /// A ring of `slots.len()` packets of up to `elements.len() / slots.len()` elements. Without slots it is always
    /// full.
    pub fn new(slots: &'m mut [Slot<H>], elements: &'m mut [T]) -> Self {
        let (count, len) = (slots.len(), elements.len());
        Self {
            slots: NonNull::from(slots).cast(),
            count,
            elements: NonNull::from(elements).cast(),
            slot_len: len.checked_div(count).unwrap_or(0),
            head: AtomicUsize::new(0),
            tail: AtomicUsize::new(0),
            rejected_packets: AtomicUsize::new(0),
            rejected_elements: AtomicUsize::new(0),
            memory: PhantomData,
        }
    }

    /// Its two ends. Packets that an end before left in the ring are still there.
    pub fn split(&mut self) -> (Producer<&Self>, Consumer<&Self>) {
        (Producer::new(&*self), Consumer::new(&*self))
    }

    /// Most packets it holds.
    pub const fn count(&self) -> usize {
        self.count
    }

    /// Most elements of a packet.
    pub const fn slot_len(&self) -> usize {
        self.slot_len
    }

    /// Packets in it now.
    pub fn len(&self) -> usize {
        self.distance(self.head.load(Ordering::Acquire), self.tail.load(Ordering::Acquire))
    }

    /// Whether no packet is in it now.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What did not fit since the start.
    pub fn rejected(&self) -> Rejected {
        Rejected {
            packets: self.rejected_packets.load(Ordering::Relaxed),
            elements: self.rejected_elements.load(Ordering::Relaxed),
        }
    }

    /// From `tail` to `head`. Each may be newer than the other here, but for the end that owns one of them.
    fn distance(&self, head: usize, tail: usize) -> usize {
        let ahead = if head >= tail { head - tail } else { (head + 2 * self.count).wrapping_sub(tail) };
        ahead.min(self.count)
    }

    /// The slot of a position below `2 * count`, and its first element.
    fn slot(&self, position: usize) -> (&Cell<Content<H>>, NonNull<T>) {
        let index = if position >= self.count { position - self.count } else { position };
        // SAFETY: `head` and `tail` stay below `2 * count` (`next`), so `index` is below `count`, and its elements end
        // at or before `count * slot_len <= elements.len()`: both within the memory that `new` was given.
        unsafe { (&self.slots.add(index).as_ref().content, self.elements.add(index * self.slot_len)) }
    }
}

impl<H, T> Ring<'_, H, T> {
    /// The position after this one.
    fn next(&self, position: usize) -> usize {
        let next = position.wrapping_add(1);
        if next >= 2 * self.count { 0 } else { next }
    }
}

/// Packets and elements that did not fit; each wraps at the machine's word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejected {
    /// Number of packets.
    pub packets: usize,
    /// Number of elements in them.
    pub elements: usize,
}

/// Why a packet did not go in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PushError {
    /// No slot is free: the consumer is behind.
    Full,
    /// It has more elements than a slot.
    TooLong {
        /// Its elements.
        len: usize,
        /// A slot's.
        slot_len: usize,
    },
}

impl core::fmt::Display for PushError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Full => write!(f, "ring is full: its consumer is behind"),
            Self::TooLong { len, slot_len } => {
                write!(f, "packet of {len} elements, where a slot has {slot_len}: push it in parts")
            }
        }
    }
}

impl core::error::Error for PushError {}

/// The end that packets go in. `R` leads to the ring: `&Ring`, or [`Shared`] on the heap.
#[derive(Debug)]
pub struct Producer<R> {
    ring: R,
    /// The ring's `head`, which nobody else stores: never to be loaded again.
    head: usize,
    /// Likewise.
    rejected: Rejected,
}

impl<'m, H: Copy + 'static, T: Pod, R: Deref<Target = Ring<'m, H, T>>> Producer<R> {
    /// The only one of the ring, at a time.
    fn new(ring: R) -> Self {
        let (head, rejected) = (ring.head.load(Ordering::Acquire), ring.rejected());
        Self { ring, head, rejected }
    }

    /// The ring, to ask what is in it.
    pub fn ring(&self) -> &Ring<'m, H, T> {
        &self.ring
    }

    /// Puts a packet in. What does not fit is counted as rejected.
    pub fn try_push(&mut self, header: H, elements: &[T]) -> Result<(), PushError> {
        let (len, slot_len) = (elements.len(), self.ring.slot_len);
        if len > slot_len {
            self.count_rejected(len);
            return Err(PushError::TooLong { len, slot_len });
        }
        let Some(mut grant) = self.claim() else {
            self.count_rejected(len);
            return Err(PushError::Full);
        };
        for (slot, element) in grant.elements_mut().iter_mut().zip(elements) {
            *slot = *element;
        }
        grant.commit(header, len);
        Ok(())
    }

    /// The next slot, to write a packet in place; `None` when full. What is then given up is the caller's to
    /// [count](Self::count_rejected).
    pub fn claim(&mut self) -> Option<Grant<'_, 'm, H, T>> {
        let ring = &*self.ring;
        // Acquire: the consumer's reads of the slot come before our writes.
        let tail = ring.tail.load(Ordering::Acquire);
        if ring.distance(self.head, tail) >= ring.count {
            return None;
        }
        let (content, elements) = ring.slot(self.head);
        Some(Grant { ring, head: &mut self.head, content: content.write(), elements })
    }

    /// Counts a packet of `elements` as rejected.
    pub fn count_rejected(&mut self, elements: usize) {
        let Rejected { packets, elements: before } = self.rejected;
        self.rejected =
            Rejected { packets: packets.wrapping_add(1), elements: before.wrapping_add(elements) };
        self.ring.rejected_packets.store(self.rejected.packets, Ordering::Relaxed);
        self.ring.rejected_elements.store(self.rejected.elements, Ordering::Relaxed);
    }
}

/// A free slot: write its elements, then [`commit`](Self::commit). Dropped without, it stays free.
#[derive(Debug)]
pub struct Grant<'p, 'm, H, T> {
    ring: &'p Ring<'m, H, T>,
    head: &'p mut usize,
    content: Writing<Content<H>>,
    elements: NonNull<T>,
}

// SAFETY: it stands for `&mut` of the slot's header and elements.
unsafe impl<H: Send, T: Send> Send for Grant<'_, '_, H, T> {}

impl<H: Copy + 'static, T: Pod> Grant<'_, '_, H, T> {
    /// The slot's elements, with whatever was there before.
    pub fn elements_mut(&mut self) -> &mut [T] {
        // SAFETY: the slot at `head` is the producer's, and this grant borrows the producer; `slot` gave the first of
        // its `slot_len` elements, which the caller of `new` initialised.
        unsafe { core::slice::from_raw_parts_mut(self.elements.as_ptr(), self.ring.slot_len) }
    }

    /// Sends the packet of the first `len` elements; a larger `len` sends the whole slot.
    pub fn commit(self, header: H, len: usize) {
        let content = Content { header: MaybeUninit::new(header), len: len.min(self.ring.slot_len) };
        // SAFETY: the slot at `head` is the producer's until `head` passes it, below.
        unsafe { self.content.set(content) };
        // Release: what was written comes before the consumer's reads.
        *self.head = self.ring.next(*self.head);
        self.ring.head.store(*self.head, Ordering::Release);
    }
}

/// The end that packets come out. `R` leads to the ring: `&Ring`, or [`Shared`] on the heap.
#[derive(Debug)]
pub struct Consumer<R> {
    ring: R,
    /// The ring's `tail`, which nobody else stores: never to be loaded again.
    tail: usize,
}

impl<'m, H: Copy + 'static, T: Pod, R: Deref<Target = Ring<'m, H, T>>> Consumer<R> {
    /// The only one of the ring, at a time.
    fn new(ring: R) -> Self {
        let tail = ring.tail.load(Ordering::Acquire);
        Self { ring, tail }
    }

    /// The ring, to ask what is in it.
    pub fn ring(&self) -> &Ring<'m, H, T> {
        &self.ring
    }

    /// The oldest packet, to read in place; its slot is free again once it is dropped. `None` when the ring is empty.
    pub fn pop(&mut self) -> Option<Packet<'_, 'm, H, T>> {
        let ring = &*self.ring;
        // Acquire: the producer's writes come before our reads.
        if ring.head.load(Ordering::Acquire) == self.tail {
            return None;
        }
        let (content, elements) = ring.slot(self.tail);
        let reading = content.read();
        // SAFETY: the slot at `tail` is the consumer's until `tail` passes it, when the packet is dropped.
        let Content { header, len } = unsafe { reading.get() };
        // SAFETY: `commit` wrote the header before `head` passed the slot.
        let header = unsafe { header.assume_init() };
        Some(Packet { ring, tail: &mut self.tail, header, len, elements, reading: Some(reading) })
    }

    /// Copies of the oldest packet's header and length; it stays.
    pub fn peek(&mut self) -> Option<(H, usize)> {
        let packet = self.pop()?;
        let found = (packet.header, packet.len);
        packet.keep();
        Some(found)
    }
}

/// A packet to read in place. Its slot is free again when this is dropped.
#[derive(Debug)]
pub struct Packet<'c, 'm, H, T> {
    ring: &'c Ring<'m, H, T>,
    tail: &'c mut usize,
    header: H,
    len: usize,
    elements: NonNull<T>,
    /// `Some` while the slot is ours.
    reading: Option<Reading<Content<H>>>,
}

// SAFETY: it stands for `&mut` of the slot's header and elements.
unsafe impl<H: Send, T: Send> Send for Packet<'_, '_, H, T> {}

impl<H: Copy + 'static, T: Pod> Packet<'_, '_, H, T> {
    /// The packet's header.
    pub const fn header(&self) -> H {
        self.header
    }

    /// The packet's elements.
    pub const fn elements(&self) -> &[T] {
        // SAFETY: the slot at `tail` is the consumer's, and this packet borrows the consumer; `commit` kept `len`
        // within the slot.
        unsafe { core::slice::from_raw_parts(self.elements.as_ptr(), self.len) }
    }

    /// Leaves the packet in the ring: the next [`pop`](Consumer::pop) gives it again.
    pub fn keep(mut self) {
        self.reading = None;
        core::mem::forget(self);
    }
}

impl<H, T> Drop for Packet<'_, '_, H, T> {
    fn drop(&mut self) {
        self.reading = None;
        *self.tail = self.ring.next(*self.tail);
        // Release: our reads come before the producer's writes to the slot.
        self.ring.tail.store(*self.tail, Ordering::Release);
    }
}
