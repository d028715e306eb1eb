//! Signals: SIGTERM and SIGINT ask for a clean end; a parent's death does too, where that is wanted.
#![allow(unsafe_code)] // std knows no signals

use core::sync::atomic::{AtomicBool, Ordering};

static ASKED: AtomicBool = AtomicBool::new(false);

/// Catches SIGTERM and SIGINT from here on, and lets a broken pipe be an error and not an end.
pub fn catch() {
    let handler = on_signal as extern "C" fn(libc::c_int) as libc::sighandler_t;
    // SAFETY: the handler only stores to an atomic, which a signal may interrupt anything with.
    unsafe {
        libc::signal(libc::SIGTERM, handler);
        libc::signal(libc::SIGINT, handler);
        libc::signal(libc::SIGPIPE, libc::SIG_IGN);
    }
}

/// Whether a signal asked for the end since [`catch`].
pub fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}

/// Makes the death of the parent process ask for the end.
pub fn die_with_parent() {
    // SAFETY: PR_SET_PDEATHSIG takes a signal's number and touches no memory.
    unsafe { libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGTERM as libc::c_ulong) };
}

extern "C" fn on_signal(_: libc::c_int) {
    ASKED.store(true, Ordering::Relaxed);
}
