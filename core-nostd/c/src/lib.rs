//! The core for C: see include/lobula_core.h, which says what each function does.
//!
//! Objects lie in memory of the caller's, of a size that the header fixes and this crate checks when it is compiled.
//! They hold pointers to the memory that filters and surfaces are given, and nothing that need be freed.
//!
//! A filter or representation comes to C by a line in `filter.rs` or `representation.rs` and its lines in the header.
#![no_std]

mod decoder;
mod filter;
mod memory;
mod representation;

use lobula_core::{Event, Geometry};

/// What became of a call: `lobula_status` in the header.
#[derive(Clone, Copy)]
#[repr(C)]
pub enum Status {
    Ok = 0,
    BadParameter = 1,
    MemoryTooShort = 2,
    WrongGeometry = 3,
}

/// `lobula_geometry`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Size {
    width: u16,
    height: u16,
}

impl From<Size> for Geometry {
    fn from(Size { width, height }: Size) -> Self {
        Self::new(width, height)
    }
}

impl From<Geometry> for Size {
    fn from(Geometry { width, height, .. }: Geometry) -> Self {
        Self { width, height }
    }
}

/// `lobula_block`.
#[repr(C)]
pub struct Block {
    t_first: u64,
    t_last: u64,
    geometry: Size,
    events: *mut Event,
    len: usize,
}

/// Never called: nothing that streams can panic, which `tests/proof` proves and the test of this crate checks.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}
