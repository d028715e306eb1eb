//! The one clock of the process: CLOCK_MONOTONIC, in ns, as every stamp in shared memory.
#![allow(unsafe_code)] // std hides the value of CLOCK_MONOTONIC, and has no sleep until a point of it

/// Now, in ns of CLOCK_MONOTONIC.
pub fn now_ns() -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid timespec to write to; the clock exists on every Linux, so the call cannot fail.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut time) };
    time.tv_sec as u64 * NS_PER_S + time.tv_nsec as u64
}

/// Sleeps until `deadline_ns` of CLOCK_MONOTONIC; returns at once if it has passed, and early if a signal comes.
pub fn sleep_until_ns(deadline_ns: u64) {
    let deadline = libc::timespec {
        tv_sec: (deadline_ns / NS_PER_S) as libc::time_t,
        tv_nsec: (deadline_ns % NS_PER_S) as libc::c_long,
    };
    // SAFETY: `deadline` is a valid timespec, and the remaining time is not asked for.
    unsafe {
        libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &deadline, core::ptr::null_mut())
    };
}

/// Makes this thread's sleeps end when they should and not up to 50 µs later, as Linux allows itself by default.
pub fn wake_punctually() {
    // SAFETY: PR_SET_TIMERSLACK takes one number and touches no memory; failure leaves things as they were.
    unsafe { libc::prctl(libc::PR_SET_TIMERSLACK, 1 as libc::c_ulong) };
}

const NS_PER_S: u64 = 1_000_000_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sleeping_takes_at_least_as_long_as_told() {
        let deadline = now_ns() + 2_000_000;
        sleep_until_ns(deadline);
        assert!(now_ns() >= deadline);
        sleep_until_ns(0);
    }
}
