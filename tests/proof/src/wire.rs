//! Every decoder and encoder of [`lobula_core::for_each_encoding`].

use crate::export;
use crate::export::{Export, slice, slice_mut};
use lobula_core::wire::{self, WordOrder};
use lobula_core::{Counters, Decode, Encode, Encoded, Event, Geometry, Sink, Span, Trigger};

unsafe fn decode<D: Decode>(
    decoder: *mut D,
    bytes: (*const u8, usize),
    events: (*mut Event, usize),
    triggers: (*mut Trigger, usize),
    found: *mut (usize, usize, u64, u64),
) -> usize {
    // SAFETY: the caller's promise.
    let (decoder, bytes) = unsafe { (&mut *decoder, slice(bytes.0, bytes.1)) };
    // SAFETY: the caller's promise.
    let (events, triggers) = unsafe { (slice_mut(events.0, events.1), slice_mut(triggers.0, triggers.1)) };
    let mut sink = Sink::with_triggers(events, triggers);
    let taken = decoder.decode(bytes, &mut sink);
    let triggers = sink.triggers().len();
    let block = sink.block(decoder.geometry());
    // SAFETY: the caller's promise.
    unsafe { *found = (block.len(), triggers, block.t_first, block.t_last) };
    taken
}

unsafe fn state<D: Decode>(decoder: *mut D, near: u64, ended: bool, counters: *mut Counters) -> (u64, usize) {
    // SAFETY: the caller's promise.
    let decoder = unsafe { &mut *decoder };
    if ended {
        decoder.finish();
    } else {
        decoder.gap((near > 0).then_some(near));
    }
    // SAFETY: the caller's promise.
    unsafe { *counters = *decoder.counters() };
    (decoder.now(), decoder.pending())
}

unsafe fn encode<E: Encode>(encoder: *mut E, span: *const Span<'_>, out: (*mut u8, usize)) -> Encoded {
    // SAFETY: the caller's promise.
    unsafe { (*encoder).encode(*span, slice_mut(out.0, out.1)) }
}

unsafe fn trigger<E: Encode>(encoder: *mut E, trigger: Trigger, out: (*mut u8, usize)) -> Encoded {
    // SAFETY: the caller's promise.
    unsafe { (*encoder).trigger(trigger, slice_mut(out.0, out.1)) }
}

unsafe fn finish<E: Encode>(encoder: *mut E, out: (*mut u8, usize)) -> usize {
    // SAFETY: the caller's promise.
    unsafe { (*encoder).finish(slice_mut(out.0, out.1)) }
}

macro_rules! encodings {
    ($($(#[$doc:meta])* $variant:ident $(($parameter:ident: $type:ty))? = $module:ident, { $($names:tt)* })+) => {
        $(mod $module {
            use super::*;
            pub use wire::$module::{Decoder, Encoder};

            pub unsafe fn decoder(at: *mut Decoder, geometry: Geometry $(, $parameter: $type)?) {
                // SAFETY: the caller's promise.
                unsafe { at.write(Decoder::new(geometry $(, $parameter)?)) }
            }

            pub unsafe fn encoder(at: *mut Encoder $(, $parameter: $type)?) {
                // SAFETY: the caller's promise.
                unsafe { at.write(Encoder::new($($parameter)?)) }
            }
        })+

        pub const EXPORTS: &[Export] = &[$(
            export!($module::decoder),
            export!(decode::<$module::Decoder>),
            export!(state::<$module::Decoder>),
            export!($module::encoder),
            export!(trigger::<$module::Encoder>),
            export!(encode::<$module::Encoder>),
            export!(finish::<$module::Encoder>),
        )+];
    };
}

lobula_core::for_each_encoding!(encodings);
