//! UART 0 of the MPS2 boards (ARM CMSDK APB UART).

/// Of the core.
pub const CLOCK_HZ: u32 = 25_000_000;

const UART: usize = 0x4000_4000;
const DATA: usize = UART;
const STATE: usize = UART + 0x4;
const STATE_FULL: u32 = 1;
const CONTROL: usize = UART + 0x8;
const CONTROL_SEND: u32 = 1;
const DIVISOR: usize = UART + 0x10;

pub fn start() {
    // SAFETY: registers of the UART.
    unsafe {
        super::write(DIVISOR, 16);
        super::write(CONTROL, CONTROL_SEND);
    }
}

pub fn send(byte: u8) {
    // SAFETY: registers of the UART.
    unsafe {
        while (STATE as *const u32).read_volatile() & STATE_FULL != 0 {}
        super::write(DATA, byte.into());
    }
}
