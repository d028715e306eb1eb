//! Both ends of the link.

use crate::export;
use crate::export::{Export, slice, slice_mut};
use lobula_core::link::{Ledger, Message, bulk, serial};

type Memory = &'static mut [u8];

unsafe fn send(
    encoder: *mut serial::Encoder,
    message: *const Message<'_>,
    out: (*mut u8, usize),
) -> Result<usize, serial::TooLong> {
    // SAFETY: the caller's promise.
    unsafe { (*encoder).encode(&*message, slice_mut(out.0, out.1)) }
}

unsafe fn receiver(at: *mut serial::Decoder<Memory>, memory: (*mut u8, usize)) {
    // SAFETY: the caller's promise.
    unsafe { at.write(serial::Decoder::new(slice_mut(memory.0, memory.1))) }
}

unsafe fn receive(
    decoder: *mut serial::Decoder<Memory>,
    bytes: (*const u8, usize),
    each: extern "C" fn(*const Message<'_>, u16),
) -> Ledger {
    // SAFETY: the caller's promise.
    let (decoder, bytes) = unsafe { (&mut *decoder, slice(bytes.0, bytes.1)) };
    decoder.decode(bytes, |frame| each(&frame.message, frame.lost_before));
    *decoder.ledger()
}

unsafe fn send_words(
    encoder: *mut bulk::Encoder,
    header: bulk::Header,
    words: (*const u8, usize),
    out: (*mut u8, usize),
) -> Result<usize, bulk::TooLong> {
    // SAFETY: the caller's promise.
    unsafe { (*encoder).encode(header, slice(words.0, words.1), slice_mut(out.0, out.1)) }
}

unsafe fn words_receiver(at: *mut bulk::Decoder<Memory>, memory: (*mut u8, usize)) {
    // SAFETY: the caller's promise.
    unsafe { at.write(bulk::Decoder::new(slice_mut(memory.0, memory.1))) }
}

unsafe fn receive_words(
    decoder: *mut bulk::Decoder<Memory>,
    bytes: (*const u8, usize),
    each: extern "C" fn(*const u8, usize, bulk::Header, u16),
) -> (u64, usize) {
    // SAFETY: the caller's promise.
    let (decoder, bytes) = unsafe { (&mut *decoder, slice(bytes.0, bytes.1)) };
    decoder.decode(bytes, |frame| {
        each(frame.words.as_ptr(), frame.words.len(), frame.header, frame.lost_before);
    });
    (decoder.skipped_bytes(), decoder.pending())
}

pub const EXPORTS: &[Export] = &[
    export!(send),
    export!(receiver),
    export!(receive),
    export!(send_words),
    export!(words_receiver),
    export!(receive_words),
];
