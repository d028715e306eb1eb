use super::*;
use proptest::prelude::*;
use std::collections::VecDeque;

/// What a test does with a ring.
#[derive(Clone, Debug)]
enum Step {
    Push(u8),
    Claim(u8),
    Abandon,
    Pop,
    Peek,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        4 => (0u8..8).prop_map(Step::Push),
        2 => (0u8..8).prop_map(Step::Claim),
        1 => Just(Step::Abandon),
        5 => Just(Step::Pop),
        1 => Just(Step::Peek),
    ];
    prop::collection::vec(step, 0..200)
}

fn packet(n: u32, len: u8) -> Vec<u16> {
    (0..u16::from(len)).map(|i| n as u16 * 10 + i).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    /// Against the naive oracle: a queue with a bound.
    #[test]
    fn is_a_bounded_queue(count in 0usize..6, slot_len in 0usize..6, steps in steps()) {
        let mut slots: Vec<Slot<u32>> = (0..count).map(|_| Slot::new()).collect();
        let mut elements = vec![0u16; count * slot_len];
        let mut ring = Ring::new(&mut slots, &mut elements);
        let (mut producer, mut consumer) = ring.split();
        let mut oracle: VecDeque<(u32, Vec<u16>)> = VecDeque::new();
        let mut rejected = Rejected::default();
        let slot_len = if count == 0 { 0 } else { slot_len };
        for (n, step) in (0u32..).zip(steps) {
            match step {
                Step::Push(len) => {
                    let elements = packet(n, len);
                    let expected = if elements.len() > slot_len {
                        Err(PushError::TooLong { len: elements.len(), slot_len })
                    } else if oracle.len() == count {
                        Err(PushError::Full)
                    } else {
                        Ok(())
                    };
                    prop_assert_eq!(producer.try_push(n, &elements), expected);
                    if expected.is_ok() {
                        oracle.push_back((n, elements));
                    } else {
                        rejected.packets += 1;
                        rejected.elements += elements.len();
                    }
                }
                Step::Claim(len) => {
                    let grant = producer.claim();
                    prop_assert_eq!(grant.is_some(), oracle.len() < count);
                    let Some(mut grant) = grant else { continue };
                    let mut elements = packet(n, len);
                    elements.truncate(slot_len);
                    prop_assert_eq!(grant.elements_mut().len(), slot_len);
                    grant.elements_mut()[..elements.len()].copy_from_slice(&elements);
                    grant.commit(n, elements.len());
                    oracle.push_back((n, elements));
                }
                Step::Abandon => drop(producer.claim()),
                Step::Pop => {
                    let packet = consumer.pop().map(|packet| (packet.header(), packet.elements().to_vec()));
                    prop_assert_eq!(packet, oracle.pop_front());
                }
                Step::Peek => {
                    prop_assert_eq!(consumer.peek(), oracle.front().map(|(header, it)| (*header, it.len())));
                }
            }
            prop_assert_eq!(consumer.ring().len(), oracle.len());
            prop_assert_eq!(consumer.ring().rejected(), rejected);
        }
    }
}

/// What a packet of this number holds.
fn numbered(n: u64, slot_len: usize) -> impl Iterator<Item = u64> {
    (0..(n as usize * 7) % (slot_len + 1)).map(move |i| n * 1000 + i as u64)
}

/// Pushes `packets` of them, now by copy, now in place; gives up on every 16th when full, so that both ways are used.
fn produce<'m, R: Deref<Target = Ring<'m, u64, u64>>>(mut producer: Producer<R>, packets: u64) -> u64 {
    let slot_len = producer.ring().slot_len();
    let mut given_up = 0;
    for n in 0..packets {
        let elements: Vec<u64> = numbered(n, slot_len).collect();
        if n % 16 == 0 {
            given_up += u64::from(producer.try_push(n, &elements).is_err());
            continue;
        }
        let mut grant = loop {
            match producer.claim() {
                Some(grant) => break grant,
                None => std::thread::yield_now(),
            }
        };
        grant.elements_mut()[..elements.len()].copy_from_slice(&elements);
        grant.commit(n, elements.len());
    }
    given_up
}

/// Takes packets up to the last; checks each, and returns how many came.
fn consume<'m, R: Deref<Target = Ring<'m, u64, u64>>>(mut consumer: Consumer<R>, packets: u64) -> u64 {
    let slot_len = consumer.ring().slot_len();
    let (mut came, mut last) = (0, None);
    while last != Some(packets - 1) {
        let Some(packet) = consumer.pop() else {
            std::thread::yield_now();
            continue;
        };
        assert!(last < Some(packet.header()), "in order");
        assert!(packet.elements().iter().copied().eq(numbered(packet.header(), slot_len)), "untorn");
        last = Some(packet.header());
        came += 1;
    }
    came
}

/// Not a multiple of 16, less one: the last packet is one that is not given up.
const PACKETS: u64 = 20_000 - 1;

#[test]
fn two_threads_lose_nothing_but_what_is_counted() {
    for (count, slot_len) in [(1, 4), (2, 3), (3, 16), (7, 1), (64, 33)] {
        let mut slots: Vec<Slot<u64>> = (0..count).map(|_| Slot::new()).collect();
        let mut elements = vec![0u64; count * slot_len];
        let mut ring = Ring::new(&mut slots, &mut elements);
        let (producer, consumer) = ring.split();
        let (given_up, came) = std::thread::scope(|scope| {
            let given_up = scope.spawn(move || produce(producer, PACKETS));
            (scope.spawn(move || consume(consumer, PACKETS)).join(), given_up.join())
        });
        let (came, given_up) = (given_up.unwrap(), came.unwrap());
        assert_eq!(came + given_up, PACKETS);
        assert_eq!(ring.rejected().packets as u64, given_up);
        assert!(ring.is_empty());
    }
}

#[cfg(feature = "alloc")]
#[test]
fn a_ring_on_the_heap_outlives_the_thread_that_made_it() {
    let (producer, consumer) = Shared::new(5, 9);
    let producer = std::thread::spawn(move || produce(producer, PACKETS));
    let consumer = std::thread::spawn(move || consume(consumer, PACKETS));
    assert_eq!(producer.join().unwrap() + consumer.join().unwrap(), PACKETS);
}

#[test]
fn ends_go_to_other_threads() {
    fn is_send<T: Send>() {}
    is_send::<Producer<&Ring<'static, u64, u8>>>();
    is_send::<Consumer<&Ring<'static, u64, u8>>>();
}
