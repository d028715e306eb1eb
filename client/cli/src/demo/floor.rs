//! The floor: how long a packet takes through iceoryx2 alone, between two processes, with nothing of ours but the
//! packet's size and pace. Due time to received, as the readers measure.

use super::child::Child;
use super::percentiles::Percentiles;
use super::plan::Plan;
use crate::args::FloorArgs;
use crate::{Failure, output};
use lobula_client::{Flags, Root, ShmEvent};
use lobulad::{floor, now_ns};
use std::io::{BufRead, BufReader};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Time between two packets.
const PACKET: Duration = Duration::from_millis(1);
/// How long one end waits for the other.
const PATIENCE: Duration = Duration::from_secs(60);

/// Measures with two processes.
pub fn measure(plan: &Plan) -> Result<Percentiles, Failure> {
    let root = plan.root_of("floor")?;
    make_gate(&root)?;
    let result = between(plan, &root);
    // Memory of processes that have ended.
    let _ = std::fs::remove_dir_all(root.path());
    result
}

fn between(plan: &Plan, root: &Root) -> Result<Percentiles, Failure> {
    let path = root.to_string();
    let mut receiver = Child::start("floor-receiver", plan.folder(), ["demo-floor", "--root", &path])?;
    let mut lines =
        BufReader::new(receiver.stdout().ok_or_else(|| receiver.failure("has no output"))?).lines();
    let mut line = || lines.next().and_then(Result::ok);
    line().ok_or_else(|| receiver.failure("did not get ready"))?;
    let packets = plan.floor_packets.to_string();
    // Of a rate that is not known: a packet of a usual scene.
    let events = (plan.rate_evs.unwrap_or(1_000_000) as usize / 1000).min(lobula_client::PACKET_EVENTS_MAX);
    let events = events.to_string();
    let args = ["demo-floor", "--root", &path, "--publish", &packets, "--events", &events];
    let mut publisher = Child::start("floor-publisher", plan.folder(), args)?;
    let text = line().ok_or_else(|| receiver.failure("received nothing"))?;
    publisher.wait(PATIENCE)?;
    receiver.wait(PATIENCE)?;
    serde_json::from_str(&text).map_err(Failure::general)
}

fn make_gate(root: &Root) -> Result<(), Failure> {
    use std::os::unix::fs::DirBuilderExt;
    let made = std::fs::DirBuilder::new().recursive(true).mode(0o700).create(root.path());
    made.map_err(|error| Failure::general(format!("{root}: {error}")))
}

/// One end, in a process of its own.
pub fn run(args: &FloorArgs) -> Result<(), Failure> {
    lobulad::die_with_parent();
    let root = Root::new(&args.root)?;
    match args.publish {
        Some(packets) => publish(&root, packets, args.events),
        None => receive(&root),
    }
}

fn publish(root: &Root, packets: u64, events: usize) -> Result<(), Failure> {
    let sender = floor::Sender::new(root, events)?;
    let template = vec![ShmEvent::default(); events];
    let start = Instant::now() + PACKET;
    let start_ns = now_ns() + PACKET.as_nanos() as u64;
    for packet in 0..=packets {
        let after = PACKET * packet as u32;
        sleep((start + after).saturating_duration_since(Instant::now()));
        let flags = if packet == packets { Flags::END } else { Flags::default() };
        sender.send(&template, start_ns + after.as_nanos() as u64, flags)?;
    }
    // The last packet lies in this process's memory: the other end says that it was read by going.
    let deadline = Instant::now() + PATIENCE;
    while sender.receivers() > 0 && Instant::now() < deadline {
        sleep(PACKET);
    }
    Ok(())
}

fn receive(root: &Root) -> Result<(), Failure> {
    let receiver = floor::Receiver::new(root, true).map_err(Failure::general)?;
    output::line("ready")?;
    let mut times_ns = Vec::with_capacity(4096);
    let deadline = Instant::now() + PATIENCE;
    while Instant::now() < deadline {
        receiver.wait(PACKET * 50).map_err(Failure::general)?;
        while let Some((now, header)) = receiver.take().map_err(Failure::general)? {
            if header.flags().contains(Flags::END) {
                return output::json(&Percentiles::of(&mut times_ns));
            }
            times_ns.push(now.saturating_sub(header.stamps.due_ns));
        }
    }
    Err(Failure::general("the other end never came"))
}
