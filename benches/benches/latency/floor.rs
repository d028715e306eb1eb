//! The floor: the same packets at the same pace through iceoryx2 alone, with nothing of ours but the header.

use std::time::Duration;

use lobula_benches::clock;
use lobula_client::{Flags, PACKET_EVENTS_MAX, Root, ShmEvent};
use lobulad::{floor, now_ns};

use crate::client::Times;
use crate::{Outcome, PACKET_US, Wait, allocations, number, wait};

/// Arguments of the sender.
pub fn sender_args(root: &Root, rate_evs: u32) -> Vec<String> {
    vec![root.to_string(), rate_evs.to_string()]
}

/// Sends a millisecond's events at each millisecond until the receiver has gone; then says how many allocations a
/// loan took.
pub fn sender(args: &[String]) -> Outcome<()> {
    lobulad::die_with_parent();
    let root = Root::new(args.first().ok_or("no root")?)?;
    let events = number::<usize>(args, 1)? * PACKET_US as usize / 1_000_000;
    let sender = floor::Sender::new(&root, PACKET_EVENTS_MAX)?;
    let events = vec![ShmEvent::default(); events];
    clock::wake_punctually();
    let start_ns = now_ns();
    let (mut packet, mut loans, mut allocated) = (0, 0u64, 0);
    while packet == 0 || sender.receivers() > 0 {
        packet += 1;
        let due_ns = start_ns + packet * PACKET_US * 1000;
        clock::sleep_until_ns(due_ns);
        let before = allocations::of_this_thread();
        // In as few packets as they fit in.
        for part in events.chunks(PACKET_EVENTS_MAX) {
            loans += u64::from(sender.send(part, due_ns, Flags::default())?);
        }
        allocated += allocations::of_this_thread() - before;
    }
    println!("{}", allocated as f64 / loans.max(1) as f64);
    Ok(())
}

/// Arguments of the receiver.
pub fn receiver_args(root: &Root, wait: Wait, seconds: u64) -> Vec<String> {
    vec![root.to_string(), wait.name().to_owned(), seconds.to_string()]
}

/// Receives for some seconds; says a line when its ports are open, one when warm, and then what it saw.
pub fn receiver(args: &[String]) -> Outcome<()> {
    lobulad::die_with_parent();
    let root = Root::new(args.first().ok_or("no root")?)?;
    let wait = wait(args, 1)?;
    let receiver = floor::Receiver::new(&root, wait == Wait::Sleep)?;
    println!("ready");
    let mut times = Times::for_seconds(number(args, 2)?);
    while times.run() {
        while let Some((now, header)) = receiver.take()? {
            times.push(now, header.stamps);
        }
        receiver.wait(Duration::from_millis(50))?;
    }
    times.tell(0)
}
