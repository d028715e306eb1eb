//! CPU time, and one core to spend it on. The bench's clocks live here.
#![allow(unsafe_code)] // two libc calls that std does not offer

use std::io;
use std::time::Duration;

/// CPU time of the whole process so far, user and system, all threads.
///
/// Other jobs on the machine do not enter it, which wall time cannot say.
pub fn cpu_time() -> Duration {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `now` is a valid timespec for the call to write, and the clock's id is one that Linux always has.
    let failed = unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut now) };
    assert_eq!(failed, 0, "CLOCK_PROCESS_CPUTIME_ID: {}", io::Error::last_os_error());
    Duration::new(now.tv_sec.unsigned_abs(), u32::try_from(now.tv_nsec).unwrap_or_default())
}

/// CPU time that `work` took, and what it gave.
pub fn timed<T>(work: impl FnOnce() -> T) -> (Duration, T) {
    let start = cpu_time();
    let result = work();
    (cpu_time().saturating_sub(start), result)
}

/// Pins this process' calling thread, and the threads it starts later, to the last core it may run on; returns that
/// core.
pub fn pin_to_one_core() -> io::Result<usize> {
    let core = *allowed_cores()?.last().ok_or_else(|| io::Error::other("no core is allowed"))?;
    pin_to(core)?;
    Ok(core)
}

/// Pins the calling thread to `core`.
pub fn pin_to(core: usize) -> io::Result<()> {
    // SAFETY: a cpu_set_t is a plain bit field, for which all zeros is the empty set.
    let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
    // SAFETY: `set` is valid and the macro refuses a core beyond its size.
    unsafe { libc::CPU_SET(core, &mut set) };
    // SAFETY: `set` is valid for the size given; 0 is the calling thread.
    let failed = unsafe { libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &raw const set) };
    if failed == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// The cores the calling thread may run on, in ascending order.
pub fn allowed_cores() -> io::Result<Vec<usize>> {
    // SAFETY: a cpu_set_t is a plain bit field, for which all zeros is the empty set.
    let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
    // SAFETY: `set` is valid for the size given; 0 is the calling thread.
    let failed = unsafe { libc::sched_getaffinity(0, size_of::<libc::cpu_set_t>(), &raw mut set) };
    if failed != 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: `set` is valid, and every core asked for is below its size.
    Ok((0..libc::CPU_SETSIZE as usize).filter(|core| unsafe { libc::CPU_ISSET(*core, &set) }).collect())
}

/// The middle of what was measured; of an even number, the lower of the two.
pub fn median(times: &mut [Duration]) -> Duration {
    times.sort_unstable();
    times.get(times.len().saturating_sub(1) / 2).copied().unwrap_or_default()
}

/// Time of all cores at a moment, in the kernel's ticks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stolen {
    stolen: u64,
    all: u64,
}

/// What a hypervisor has kept from this machine's cores so far.
pub fn stolen() -> Stolen {
    let stat = std::fs::read_to_string("/proc/stat").unwrap_or_default();
    let cores = stat.lines().next().unwrap_or_default();
    let ticks: Vec<u64> = cores.split_whitespace().skip(1).take(8).map(|n| n.parse().unwrap_or(0)).collect();
    Stolen { stolen: ticks.get(7).copied().unwrap_or_default(), all: ticks.iter().sum() }
}

impl Stolen {
    /// Share of it since then, in percent.
    pub fn until_now(self) -> f64 {
        let now = stolen();
        100.0 * now.stolen.saturating_sub(self.stolen) as f64 / now.all.saturating_sub(self.all).max(1) as f64
    }
}

/// The processor's name as Linux tells it.
pub fn machine() -> String {
    let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let field = |name: &str| {
        cpuinfo
            .lines()
            .find(|line| line.starts_with(name))
            .and_then(|line| line.split_once(':'))
            .map(|(_, v)| v.trim())
    };
    let cores = cpuinfo.lines().filter(|line| line.starts_with("processor")).count().max(1);
    let model = field("model name").or_else(|| field("Hardware")).unwrap_or(std::env::consts::ARCH);
    let megahertz = field("cpu MHz")
        .and_then(|v| v.parse::<f64>().ok())
        .map_or(String::new(), |v| format!(" at {v:.0} MHz"));
    format!("{cores} cores of {model}{megahertz}")
}

/// The date of today, UTC, as year-month-day.
pub fn today() -> String {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    let (year, month, day) = civil(since.as_secs() / 86_400);
    format!("{year}-{month:02}-{day:02}")
}

/// The date that lies `days` after 1970-01-01.
fn civil(mut days: u64) -> (u64, u64, u64) {
    let leap = |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let mut year = 1970;
    while days >= 365 + u64::from(leap(year)) {
        days -= 365 + u64::from(leap(year));
        year += 1;
    }
    let lengths = [31, 28 + u64::from(leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 0;
    while days >= lengths[month] {
        days -= lengths[month];
        month += 1;
    }
    (year, month as u64 + 1, days + 1)
}

/// Makes the calling thread's sleeps end when they should, and not up to 50 µs later as Linux allows itself.
pub fn wake_punctually() {
    // SAFETY: PR_SET_TIMERSLACK takes one number and touches no memory; failure leaves things as they were.
    unsafe { libc::prctl(libc::PR_SET_TIMERSLACK, 1 as libc::c_ulong) };
}

/// Sleeps until `deadline_ns` of CLOCK_MONOTONIC.
pub fn sleep_until_ns(deadline_ns: u64) {
    const NS_PER_S: u64 = 1_000_000_000;
    let deadline = libc::timespec {
        tv_sec: (deadline_ns / NS_PER_S) as libc::time_t,
        tv_nsec: (deadline_ns % NS_PER_S) as libc::c_long,
    };
    // SAFETY: `deadline` is a valid timespec, and the time left is not asked for.
    unsafe {
        libc::clock_nanosleep(
            libc::CLOCK_MONOTONIC,
            libc::TIMER_ABSTIME,
            &raw const deadline,
            std::ptr::null_mut(),
        )
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_counted_through_leap_years() {
        assert_eq!(civil(0), (1970, 1, 1));
        assert_eq!(civil(11_016), (2000, 2, 29));
        assert_eq!(civil(20_779), (2026, 11, 22));
    }

    #[test]
    fn the_median_is_in_the_middle() {
        let mut times = [3, 1, 2].map(Duration::from_secs);
        assert_eq!(median(&mut times), Duration::from_secs(2));
        assert_eq!(median(&mut []), Duration::ZERO);
    }
}
