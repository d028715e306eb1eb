//! The one clock of the process: CLOCK_MONOTONIC, in ns, as every stamp in shared memory.
#![allow(unsafe_code)] // std hides the value of CLOCK_MONOTONIC, and of timer slack

/// Now, in ns of CLOCK_MONOTONIC.
pub fn now_ns() -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid timespec to write to; the clock exists on every Linux, so the call cannot fail.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut time) };
    time.tv_sec as u64 * NS_PER_S + time.tv_nsec as u64
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
    fn it_is_the_clock_of_the_standard_library() {
        let (before, from) = (std::time::Instant::now(), now_ns());
        std::thread::sleep(std::time::Duration::from_millis(2));
        let (inner, outer) = (now_ns() - from, before.elapsed().as_nanos() as u64);
        assert!((2_000_000..=outer).contains(&inner), "{inner} of {outer} ns");
    }
}
