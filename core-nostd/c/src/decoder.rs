//! `lobula_<format>_decoder_*`: a decoder each, so that firmware links only its camera's.

use crate::memory::{Opaque, slice, slice_mut};
use crate::{Block, Size};
use lobula_core::wire::{self, WordOrder};
use lobula_core::{Decode, Event, Sink};

/// `lobula_decoder`.
pub type Memory = Opaque<32>;

/// `lobula_counters`.
#[repr(C)]
pub struct Counters {
    bytes_decoded: u64,
    bytes_faulty: u64,
    events: u64,
    off_sensor: u64,
    triggers: u64,
    faults: u64,
}

impl From<&lobula_core::Counters> for Counters {
    fn from(counters: &lobula_core::Counters) -> Self {
        Self {
            bytes_decoded: counters.bytes_decoded,
            bytes_faulty: counters.bytes_faulty,
            events: counters.events,
            off_sensor: counters.off_sensor,
            triggers: counters.triggers,
            faults: counters.faults.total(),
        }
    }
}

fn decode(decoder: &mut impl Decode, bytes: &[u8], events: &mut [Event], block: &mut Block) -> usize {
    let first = events.as_mut_ptr();
    let mut sink = Sink::new(events);
    let taken = decoder.decode(bytes, &mut sink);
    let found = sink.block(decoder.geometry());
    let (t_first, t_last, geometry) = (found.t_first, found.t_last, found.geometry.into());
    *block = Block { t_first, t_last, geometry, events: first, len: found.len() };
    taken
}

macro_rules! decoders {
    ($($format:ident: $type:ty, $make:expr;)*) => {$(
        mod $format {
            use super::*;

            #[unsafe(export_name = concat!("lobula_", stringify!($format), "_decoder_init"))]
            unsafe extern "C" fn init(at: *mut Memory, geometry: Size) {
                let make: fn(lobula_core::Geometry) -> $type = $make;
                // SAFETY: the caller's promise.
                unsafe { Memory::write(at, make(geometry.into())) }
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($format), "_decode"))]
            unsafe extern "C" fn decode(
                decoder: *mut Memory,
                bytes: *const u8,
                len: usize,
                events: *mut Event,
                room: usize,
                block: *mut Block,
            ) -> usize {
                // SAFETY: the caller's promise.
                let (decoder, bytes) = unsafe { (Memory::get::<$type>(decoder), slice(bytes, len)) };
                // SAFETY: the caller's promise.
                unsafe { super::decode(decoder, bytes, slice_mut(events, room), &mut *block) }
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($format), "_decoder_gap"))]
            unsafe extern "C" fn gap(decoder: *mut Memory, near: u64) {
                // SAFETY: the caller's promise.
                unsafe { Memory::get::<$type>(decoder).gap(Some(near)) }
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($format), "_decoder_now"))]
            unsafe extern "C" fn now(decoder: *mut Memory) -> u64 {
                // SAFETY: the caller's promise.
                unsafe { Memory::get::<$type>(decoder).now() }
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($format), "_decoder_counters"))]
            unsafe extern "C" fn counters(decoder: *mut Memory) -> Counters {
                // SAFETY: the caller's promise.
                unsafe { Memory::get::<$type>(decoder) }.counters().into()
            }
        }
    )*};
}

decoders! {
    evt2: wire::evt2::Decoder, wire::evt2::Decoder::new;
    evt21: wire::evt21::Decoder, |geometry| wire::evt21::Decoder::new(geometry, WordOrder::Little);
    evt21_legacy: wire::evt21::Decoder, |geometry| wire::evt21::Decoder::new(geometry, WordOrder::Legacy);
    evt3: wire::evt3::Decoder, wire::evt3::Decoder::new;
    evt4: wire::evt4::Decoder, wire::evt4::Decoder::new;
}
