//! What a packet costs the heap after start-up: iceoryx2's one allocation for a loan, and none of ours.
#![allow(unsafe_code)] // a global allocator

use lobula_client::{Client, ClientOptions, Root, SubscribeOptions};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Counts what the threads of the path from bytes to publish allocate.
struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

fn count() {
    let mut name = [0u8; 16];
    // SAFETY: PR_GET_NAME writes at most 16 bytes.
    unsafe { libc::prctl(libc::PR_GET_NAME, name.as_mut_ptr()) };
    if name.starts_with(b"pipeline\0") || name.starts_with(b"source\0") {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
    }
}

// SAFETY: every call goes on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, len: usize) -> *mut u8 {
        count();
        // SAFETY: the caller's promise is passed on.
        unsafe { System.realloc(block, layout, len) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_packet_costs_one_allocation_and_it_is_not_ours() {
    let folder = tempfile::Builder::new().prefix("lobula-t").tempdir_in("/dev/shm").expect("a folder");
    let root = Root::new(folder.path().join("root")).expect("a root");
    let mut config = lobulad::config::parse(
        "[camera]\nsource = { kind = \"synthetic\", rate_evs = 500000, geometry = { width = 320, height = 240 } }\n\
         [[filter]]\nkind = \"refractory\"\ndt_us = 500\n\
         [[filter]]\nkind = \"background_activity\"\ndt_us = 5000\nneighbours = \"eight\"\n\
         [[view]]\nname = \"count\"\nkind = \"count\"\nperiod_us = 5000\n",
    )
    .expect("a configuration");
    config.instance.root = Some(root.path().to_owned());
    let daemon = lobulad::Daemon::start(&config).expect("a daemon");
    let client = Client::connect(ClientOptions::default().root(root)).expect("a client");
    let mut events = client.events(SubscribeOptions::default()).expect("the events");
    let mut sequence = |packets: u64| {
        let first = events.recv(Duration::from_secs(60)).expect("a packet").header().sequence;
        loop {
            let packet = events.recv(Duration::from_secs(60)).expect("a packet");
            if packet.header().sequence >= first + packets {
                return packet.header().sequence;
            }
        }
    };
    let (start, before) = (sequence(100), ALLOCATIONS.load(Ordering::Relaxed));
    let (end, after) = (sequence(1000), ALLOCATIONS.load(Ordering::Relaxed));
    let (packets, allocations) = (end - start, after - before);
    println!("{allocations} allocations for {packets} packets");
    // Packets that are sent while this thread reads the counters fall on one side or the other.
    assert!(allocations > 100, "the counter does not count");
    assert!(allocations < packets + packets / 10, "{allocations} allocations for {packets} packets");
    daemon.stop();
    daemon.join();
}
