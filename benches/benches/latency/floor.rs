//! The floor: the same packets at the same pace through iceoryx2 alone, with nothing of ours but the header.

use std::time::Duration;

use lobula_benches::clock;
use lobula_client::transport::{self, Outlet};
use lobula_client::{PACKET_EVENTS_MAX, PacketHeader, Root, ShmEvent, Stamps, Stream};
use lobulad::now_ns;

use crate::client::Times;
use crate::{Outcome, PACKET_US, Wait, allocations, number, wait};

const CAMERA: &str = "floor";

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
    let node = transport::node(&root, "latency-floor")?;
    let stream = Stream::events();
    let outlet = Outlet::create(&node, &root, &stream, CAMERA, PACKET_EVENTS_MAX, None)?;
    let events = vec![ShmEvent::default(); events];
    clock::wake_punctually();
    let start_ns = now_ns();
    let (mut packet, mut loans, mut allocated) = (0, 0u64, 0);
    while packet == 0 || outlet.clients() > 0 {
        packet += 1;
        let due_ns = start_ns + packet * PACKET_US * 1000;
        clock::sleep_until_ns(due_ns);
        let before = allocations::of_this_thread();
        loans += send(&outlet, &events, due_ns)?;
        allocated += allocations::of_this_thread() - before;
    }
    println!("{}", allocated as f64 / loans.max(1) as f64);
    Ok(())
}

/// Sends the events in as few packets as they fit in; returns how many loans that took.
fn send(outlet: &Outlet<ShmEvent, PacketHeader>, events: &[ShmEvent], due_ns: u64) -> Outcome<u64> {
    let mut loans = 0;
    for part in events.chunks(PACKET_EVENTS_MAX) {
        let Some(mut loan) = outlet.loan(part.len())? else { continue };
        loan.payload_mut().copy_from_slice(part);
        let header = loan.user_header_mut();
        *header = PacketHeader::default();
        let now = now_ns();
        header.stamps = Stamps { due_ns, arrived_ns: now, decoded_ns: now, published_ns: now };
        outlet.send(loan)?;
        loans += 1;
    }
    Ok(loans)
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
    let node = transport::node(&root, "latency-floor")?;
    let services = transport::create_services::<ShmEvent, PacketHeader>(&node, &Stream::events(), CAMERA)?;
    let subscriber = services.0.subscriber_builder().create()?;
    let listener = match wait {
        Wait::Sleep => Some(services.1.listener_builder().create()?),
        Wait::Poll => None,
    };
    println!("ready");
    let mut times = Times::for_seconds(number(args, 2)?);
    while times.run() {
        while let Some(sample) = subscriber.receive()? {
            times.push(now_ns(), sample.user_header().stamps);
        }
        match &listener {
            Some(listener) => {
                let _ = listener.timed_wait(|_| {}, Duration::from_millis(50));
            }
            None => std::hint::spin_loop(),
        }
    }
    times.tell(0)
}
