//! The process's memory: kept from being swapped out, where the system allows it.
#![allow(unsafe_code)] // std knows no memory locks

/// Locks what is touched, now and later, so that no packet waits for a disk. Untouched memory costs nothing.
///
/// Only where the limit is unlimited: under a finite one a later allocation would fail. Returns whether it is locked.
pub fn lock() -> bool {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is a valid structure to write to.
    let known = unsafe { libc::getrlimit(libc::RLIMIT_MEMLOCK, &mut limit) } == 0;
    if !known || limit.rlim_cur != libc::RLIM_INFINITY {
        return false;
    }
    // SAFETY: mlockall changes no memory, only whether it may be swapped.
    unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE | libc::MCL_ONFAULT) == 0 }
}
