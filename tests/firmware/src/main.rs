//! The core on a microcontroller: a camera's bytes arrive in a timer's interrupt, go through the core's ring, and leave
//! over a UART as frames of the link.
//!
//! Half way the main loop stops for a while, so that the ring overflows and the loss is told. After the job come
//! measurements: instructions per event of its parts, by the clock of `qemu -icount shift=0`.
//!
//! Prints lines of `key=value` for the test, tests/it/firmware.rs.
#![no_std]
#![no_main]

#[cfg(not(board = "microbit"))]
#[path = "../../bits/src/bits.rs"]
mod bits;
mod board;
mod feed;
#[allow(dead_code, reason = "a board is large or small")]
mod job;
mod measure;
mod sent;

#[cfg(board = "microbit")]
#[path = "small.rs"]
mod size;
#[cfg(not(board = "microbit"))]
#[path = "large.rs"]
mod size;

use semihosting::{println, process};

/// What the board is for.
fn run() -> ! {
    let ok = size::run();
    println!("ok={ok}");
    if ok { process::exit(0) } else { process::abort() }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    println!("{info}");
    process::abort()
}
