//! Every order of the two threads' steps, by loom:
//! `RUSTFLAGS="--cfg loom" cargo test -p lobula-core --release --lib ring`.

use super::*;
use loom::sync::Arc;
use loom::thread;

/// Memory for a ring; loom wants fresh atomics for every order it tries, and threads that borrow nothing.
fn ring(count: usize, slot_len: usize) -> Arc<Ring<'static, usize, usize>> {
    let slots = Box::leak((0..count).map(|_| Slot::new()).collect());
    let elements = Box::leak(vec![0; count * slot_len].into_boxed_slice());
    Arc::new(Ring::new(slots, elements))
}

/// Sends three packets through a ring of `count`; the consumer tries `tries` times meanwhile and the rest after.
fn three_through(count: usize, tries: usize) {
    loom::model(move || {
        let ring = ring(count, 2);
        let ends = (Producer::new(Arc::clone(&ring)), Consumer::new(Arc::clone(&ring)));
        let (mut producer, mut consumer) = ends;
        let thread = thread::spawn(move || {
            let pushed = |n: &usize| producer.try_push(*n, &[*n, *n + 1][..1 + n % 2]).is_ok();
            (1..=3).filter(pushed).collect::<Vec<_>>()
        });
        let mut came = vec![];
        let mut take = |came: &mut Vec<usize>| {
            let Some(packet) = consumer.pop() else { return false };
            let n = packet.header();
            assert_eq!(packet.elements(), &[n, n + 1][..1 + n % 2]);
            came.push(n);
            true
        };
        for _ in 0..tries {
            take(&mut came);
        }
        let pushed = thread.join().unwrap();
        while take(&mut came) {}
        assert_eq!(came, pushed);
        assert_eq!(ring.rejected().packets, 3 - pushed.len());
        assert!(pushed.len() >= count.min(3));
    });
}

#[test]
fn one_slot() {
    three_through(1, 2);
}

#[test]
fn two_slots() {
    three_through(2, 2);
}

#[test]
fn three_slots() {
    three_through(3, 2);
}

#[test]
fn a_packet_kept_or_a_grant_dropped_changes_nothing() {
    loom::model(|| {
        let ring = ring(1, 1);
        let (mut producer, mut consumer) = (Producer::new(Arc::clone(&ring)), Consumer::new(ring));
        let thread = thread::spawn(move || {
            drop(producer.claim());
            let first = producer.try_push(1, &[1]).is_ok();
            (first, producer.try_push(2, &[2]).is_ok())
        });
        let peeked = consumer.peek();
        let popped = consumer.pop().map(|packet| packet.header());
        assert!(peeked.is_none() || popped == Some(1));
        let (first, second) = thread.join().unwrap();
        assert!(first);
        let left = consumer.pop().map(|packet| packet.header());
        assert_eq!(left, if popped.is_none() { Some(1) } else { second.then_some(2) });
    });
}
