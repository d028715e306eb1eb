//! QEMU's virt board, RISC-V: the timer of its CLINT, its 16550 UART, and the count of retired instructions.

use riscv::register::{mie, minstret, mstatus};
use riscv_rt::{core_interrupt, entry};

/// Of the timer.
const CLOCK_HZ: u64 = 10_000_000;
/// Ticks of the job: longer than the longest packet takes.
const PERIOD: u64 = CLOCK_HZ / 2;

const CLINT_COMPARE: usize = 0x0200_4000;
const CLINT_TIME: usize = 0x0200_BFF8;

#[entry]
fn main() -> ! {
    crate::run()
}

#[core_interrupt(riscv::interrupt::Interrupt::MachineTimer)]
fn timer() {
    next_tick();
    crate::feed::tick();
}

fn next_tick() {
    // SAFETY: registers of the timer. The lower half carries once in 7 minutes, and then a tick comes early.
    unsafe {
        let low = (CLINT_TIME as *const u32).read_volatile();
        let high = ((CLINT_TIME + 4) as *const u32).read_volatile();
        let next = (u64::from(high) << 32 | u64::from(low)) + PERIOD;
        super::write(CLINT_COMPARE + 4, u32::MAX);
        super::write(CLINT_COMPARE, next as u32);
        super::write(CLINT_COMPARE + 4, (next >> 32) as u32);
    }
}

pub fn start_ticks() {
    next_tick();
    // SAFETY: the handler is in place.
    unsafe {
        mie::set_mtimer();
        mstatus::set_mie();
    }
}

pub fn stop_ticks() {
    // SAFETY: nothing is left waiting for an interrupt.
    unsafe { mie::clear_mtimer() }
}

pub fn wait() {
    riscv::asm::wfi();
}

pub fn ticks() -> u32 {
    minstret::read() as u32
}

pub fn ticks_since(before: u32) -> u32 {
    ticks().wrapping_sub(before)
}

pub fn instructions(ticks: u32) -> u64 {
    ticks.into()
}

pub mod uart {
    //! The 16550.

    const DATA: usize = 0x1000_0000;
    const STATE: usize = DATA + 5;
    const STATE_EMPTY: u8 = 0x20;

    pub fn send(byte: u8) {
        // SAFETY: registers of the UART.
        unsafe {
            while (STATE as *const u8).read_volatile() & STATE_EMPTY == 0 {}
            (DATA as *mut u8).write_volatile(byte);
        }
    }
}
