//! The boards, as QEMU has them. Each gives the same: `start_ticks`, `stop_ticks` (a timer's interrupt, which calls
//! [`feed::tick`](crate::feed::tick)), `wait` for it, `send` over a UART, and `ticks`, `ticks_since`, `instructions` (of
//! a counter that runs with the instructions).

#[cfg(target_arch = "arm")]
mod cortex_m;
#[cfg(target_arch = "arm")]
pub use cortex_m::*;

#[cfg(board = "mps2")]
#[path = "mps2.rs"]
mod uart;
#[cfg(board = "microbit")]
#[path = "microbit.rs"]
mod uart;
#[cfg(board = "virt")]
mod virt;
pub use uart::send;
#[cfg(board = "virt")]
use virt::uart;
#[cfg(board = "virt")]
pub use virt::*;

/// Writes a register.
///
/// # Safety
/// It is one.
unsafe fn write(register: usize, value: u32) {
    // SAFETY: the caller's promise.
    unsafe { (register as *mut u32).write_volatile(value) }
}
