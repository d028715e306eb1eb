//! The UART of the nRF51822 (nRF51 Series Reference Manual, chapter 29).

/// Of the core.
pub const CLOCK_HZ: u32 = 16_000_000;

const UART: usize = 0x4000_2000;
const START: usize = UART + 0x008;
const READY: usize = UART + 0x11C;
const ENABLE: usize = UART + 0x500;
const ENABLED: u32 = 4;
const DATA: usize = UART + 0x51C;

pub fn start() {
    // SAFETY: registers of the UART.
    unsafe {
        super::write(ENABLE, ENABLED);
        super::write(START, 1);
    }
}

pub fn send(byte: u8) {
    // SAFETY: registers of the UART.
    unsafe {
        super::write(READY, 0);
        super::write(DATA, byte.into());
        while (READY as *const u32).read_volatile() == 0 {}
    }
}
