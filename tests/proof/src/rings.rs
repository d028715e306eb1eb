//! The ring, of bytes and of events.

use crate::export;
use crate::export::{Export, slice, slice_mut};
use bytemuck::Pod;
use lobula_core::Event;
use lobula_core::ring::{Consumer, Producer, PushError, Ring, Slot};

type Header = [u64; 4];
type Ends<T> = (Producer<&'static Ring<'static, Header, T>>, Consumer<&'static Ring<'static, Header, T>>);

unsafe fn make<T: Pod>(
    at: *mut Ring<'static, Header, T>,
    ends: *mut Ends<T>,
    slots: (*mut Slot<Header>, usize),
    elements: (*mut T, usize),
) {
    // SAFETY: the caller's promise.
    unsafe {
        at.write(Ring::new(slice_mut(slots.0, slots.1), slice_mut(elements.0, elements.1)));
        ends.write((*at).split());
    }
}

unsafe fn push<T: Pod>(
    ends: *mut Ends<T>,
    header: Header,
    elements: (*const T, usize),
) -> Result<(), PushError> {
    // SAFETY: the caller's promise.
    unsafe { (*ends).0.try_push(header, slice(elements.0, elements.1)) }
}

unsafe fn claim<T: Pod>(ends: *mut Ends<T>, header: Header, len: usize, fill: extern "C" fn(*mut T, usize)) {
    // SAFETY: the caller's promise.
    let Some(mut grant) = (unsafe { (*ends).0.claim() }) else { return };
    let elements = grant.elements_mut();
    fill(elements.as_mut_ptr(), elements.len());
    grant.commit(header, len);
}

unsafe fn pop<T: Pod>(ends: *mut Ends<T>, take: extern "C" fn(*const T, usize, u64) -> bool) -> usize {
    // SAFETY: the caller's promise.
    let consumer = unsafe { &mut (*ends).1 };
    let left = consumer.ring().len() + consumer.ring().rejected().elements;
    let Some(packet) = consumer.pop() else { return left };
    if !take(packet.elements().as_ptr(), packet.elements().len(), packet.header()[0]) {
        packet.keep();
    }
    left
}

macro_rules! rings {
    ($($type:ty),+) => {
        pub const EXPORTS: &[Export] =
            &[$(export!(make::<$type>), export!(push::<$type>), export!(claim::<$type>), export!(pop::<$type>),)+];
    };
}

rings!(u8, Event);
