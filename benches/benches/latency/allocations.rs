//! Counts the allocations of each thread of this process.
#![allow(unsafe_code)] // a global allocator is unsafe by its trait

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Most threads that are told apart; those beyond share the last place.
const THREADS: usize = 64;

static COUNTS: [AtomicU64; THREADS] = [const { AtomicU64::new(0) }; THREADS];
static TASKS: [AtomicU64; THREADS] = [const { AtomicU64::new(0) }; THREADS];
static NEXT: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    static PLACE: Cell<usize> = const { Cell::new(usize::MAX) };
}

/// The system's allocator, counted.
pub struct Counting;

impl Counting {
    fn count() {
        // A thread that is going away has no place any more; what it allocates then is not counted.
        let _ = PLACE.try_with(|place| {
            if place.get() == usize::MAX {
                place.set(NEXT.fetch_add(1, Ordering::Relaxed).min(THREADS - 1));
                // SAFETY: gettid takes nothing and cannot fail.
                let task = unsafe { libc::gettid() };
                TASKS[place.get()].store(task.unsigned_abs().into(), Ordering::Relaxed);
            }
            COUNTS[place.get()].fetch_add(1, Ordering::Relaxed);
        });
    }
}

// SAFETY: every call goes to the system's allocator as it came; counting touches atomics and a const thread-local, and
// does not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        Self::count();
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        Self::count();
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        Self::count();
        // SAFETY: the caller's promise is passed on.
        unsafe { System.realloc(memory, layout, size) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(memory, layout) }
    }
}

/// Allocations of the calling thread so far.
pub fn of_this_thread() -> u64 {
    PLACE
        .try_with(|place| COUNTS.get(place.get()).map_or(0, |count| count.load(Ordering::Relaxed)))
        .unwrap_or(0)
}

/// Allocations so far, by name of thread.
pub fn by_thread() -> BTreeMap<String, u64> {
    let mut sums = BTreeMap::new();
    for (count, task) in COUNTS.iter().zip(&TASKS) {
        let (count, task) = (count.load(Ordering::Relaxed), task.load(Ordering::Relaxed));
        let name = std::fs::read_to_string(format!("/proc/self/task/{task}/comm")).unwrap_or_default();
        if count > 0 {
            *sums.entry(name.trim().to_owned()).or_default() += count;
        }
    }
    sums
}
