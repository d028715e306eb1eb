//! A ring that owns its memory, on the heap, for threads that outlive the one that made it.
#![allow(unsafe_code)] // its memory must stay where it is while both ends hold pointers into it

use super::{Consumer, Producer, Ring, Slot};
use alloc::boxed::Box;
use alloc::sync::Arc;
use alloc::vec;
use bytemuck::Pod;
use core::ops::Deref;

/// Leads both ends to a ring on the heap, which goes away with the last of them.
///
/// ```
/// use lobula_core::ring::{Consumer, Producer, Shared};
/// let (mut source, mut pipeline): (Producer<Shared<u64, u8>>, Consumer<Shared<u64, u8>>) = Shared::new(8, 4096);
/// let thread = std::thread::spawn(move || source.try_push(7, b"event bytes"));
/// assert_eq!(thread.join().unwrap(), Ok(()));
/// let packet = pipeline.pop().unwrap();
/// assert_eq!((packet.header(), packet.elements()), (7, &b"event bytes"[..]));
/// ```
#[derive(Debug)]
pub struct Shared<H: 'static, T: 'static>(Arc<Heap<H, T>>);

#[derive(Debug)]
struct Heap<H: 'static, T: 'static> {
    ring: Ring<'static, H, T>,
    slots: *mut [Slot<H>],
    elements: *mut [T],
}

// SAFETY: the pointers are there to free the memory with the last end; it is the ring's alone, which is Send and Sync
// for such H and T.
unsafe impl<H: Send, T: Send> Send for Heap<H, T> {}
// SAFETY: as above.
unsafe impl<H: Send, T: Send> Sync for Heap<H, T> {}

impl<H: Copy + 'static, T: Pod> Shared<H, T> {
    /// Both ends of a ring of `count` packets of up to `slot_len` elements. The only place that allocates.
    ///
    /// # Panics
    /// As every collection does, where `count * slot_len` elements are more than a machine can address.
    #[allow(clippy::new_ret_no_self)] // the two ends are what there is to have
    pub fn new(count: usize, slot_len: usize) -> (Producer<Self>, Consumer<Self>) {
        let slots: *mut [Slot<H>] = Box::into_raw((0..count).map(|_| Slot::new()).collect());
        let elements = Box::into_raw(vec![T::zeroed(); count.saturating_mul(slot_len)].into_boxed_slice());
        // SAFETY: both come from boxes that nobody else has, and `Heap` frees them only with the ring.
        let ring = unsafe { Ring::new(&mut *slots, &mut *elements) };
        let heap = Arc::new(Heap { ring, slots, elements });
        (Producer::new(Self(Arc::clone(&heap))), Consumer::new(Self(heap)))
    }
}

impl<H, T> Deref for Shared<H, T> {
    type Target = Ring<'static, H, T>;

    fn deref(&self) -> &Self::Target {
        &self.0.ring
    }
}

impl<H, T> Drop for Heap<H, T> {
    fn drop(&mut self) {
        // SAFETY: from `Box::into_raw` in `new`; both ends are gone, and with them all grants and packets.
        unsafe {
            drop(Box::from_raw(self.slots));
            drop(Box::from_raw(self.elements));
        }
    }
}
