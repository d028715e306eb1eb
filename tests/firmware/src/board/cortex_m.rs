//! What all Cortex-M have: SysTick, as the timer of the job and as the counter of the measurements.

use super::uart::CLOCK_HZ;
use cortex_m::Peripherals;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::{entry, exception};

/// Ticks of the job: longer than the longest packet takes.
const PERIOD: u32 = CLOCK_HZ / 2;
/// SysTick counts down from this.
const RELOAD: u32 = 0xFF_FFFF;

#[entry]
fn main() -> ! {
    super::uart::start();
    crate::run()
}

#[exception]
fn SysTick() {
    crate::feed::tick();
}

fn syst() -> SYST {
    // SAFETY: nobody else has it, and each use sets it up anew.
    unsafe { Peripherals::steal() }.SYST
}

pub fn start_ticks() {
    let mut syst = syst();
    syst.set_clock_source(SystClkSource::Core);
    syst.set_reload(PERIOD.min(RELOAD));
    syst.clear_current();
    syst.enable_interrupt();
    syst.enable_counter();
}

/// From here on it counts instructions.
pub fn stop_ticks() {
    let mut syst = syst();
    syst.disable_interrupt();
    syst.set_reload(RELOAD);
    syst.clear_current();
}

pub fn wait() {
    cortex_m::asm::wfi();
}

pub fn ticks() -> u32 {
    SYST::get_current()
}

pub fn ticks_since(before: u32) -> u32 {
    before.wrapping_sub(ticks()) & RELOAD
}

/// With `-icount shift=0` an instruction takes 1 ns.
pub fn instructions(ticks: u32) -> u64 {
    u64::from(ticks) * 1_000_000_000 / u64::from(CLOCK_HZ)
}
