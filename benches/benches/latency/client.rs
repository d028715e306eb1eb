//! A client that notes when each packet came.

use std::time::Duration;

use lobula_client::{Client, ClientOptions, Root, Stamps, SubscribeOptions};
use lobulad::now_ns;

use crate::percentiles::{Percentiles, Stages};
use crate::{Outcome, Wait, number, wait};

/// Time at the start that is not counted: caches, pages and connections warm up.
const WARM_UP_NS: u64 = 500_000_000;
/// Longest wait for the daemon and for a packet.
const PATIENCE: Duration = Duration::from_secs(30);

/// Arguments of the role.
pub fn args(root: &Root, wait: Wait, seconds: u64) -> Vec<String> {
    vec![root.to_string(), wait.name().to_owned(), seconds.to_string()]
}

/// Receives for some seconds; says a line when warm, and then what it saw.
pub fn role(args: &[String]) -> Outcome<()> {
    lobulad::die_with_parent();
    let root = Root::new(args.first().ok_or("no root")?)?;
    let client = Client::connect_within(ClientOptions::default().root(root).name("latency"), PATIENCE)?;
    let options = SubscribeOptions::default();
    let options = if wait(args, 1)? == Wait::Poll { options.poll() } else { options };
    let mut events = client.events(options)?;
    let mut times = Times::for_seconds(number(args, 2)?);
    while times.run() {
        let packet = events.recv(PATIENCE)?;
        let now = now_ns();
        let stamps = packet.header().stamps;
        if stamps.due_ns > 0 && !packet.is_empty() {
            times.push(now, stamps);
        }
    }
    times.tell(events.lost())?;
    // The daemon is looked at once more before this client goes.
    std::io::stdin().lines().for_each(drop);
    Ok(())
}

/// The times of packets, once warm.
pub struct Times {
    times_ns: Vec<u64>,
    stages_ns: Vec<Stages>,
    seconds: u64,
    /// Set by the first packet, before which nothing ends but [`PATIENCE`].
    warm_at_ns: Option<u64>,
    given_up_at_ns: u64,
}

impl Times {
    /// Counts for this long after the warm-up.
    pub fn for_seconds(seconds: u64) -> Self {
        let given_up_at_ns = now_ns() + PATIENCE.as_nanos() as u64;
        let (times_ns, stages_ns) = (Vec::with_capacity(1 << 18), Vec::with_capacity(1 << 18));
        Self { times_ns, stages_ns, seconds, warm_at_ns: None, given_up_at_ns }
    }

    /// Whether there is time left.
    pub fn run(&self) -> bool {
        let end_at_ns = self.warm_at_ns.map(|warm| warm + self.seconds * 1_000_000_000);
        now_ns() < end_at_ns.unwrap_or(self.given_up_at_ns)
    }

    /// Notes a packet with these stamps that came at `now_ns`.
    pub fn push(&mut self, now_ns: u64, stamps: Stamps) {
        if now_ns < *self.warm_at_ns.get_or_insert(now_ns + WARM_UP_NS) {
            return;
        }
        if self.times_ns.is_empty() {
            println!("warm");
        }
        let Stamps { due_ns, arrived_ns, decoded_ns, published_ns } = stamps;
        self.times_ns.push(now_ns.saturating_sub(due_ns));
        let moments = [due_ns, arrived_ns, decoded_ns, published_ns, now_ns];
        self.stages_ns.push(std::array::from_fn(|i| moments[i + 1].saturating_sub(moments[i])));
    }

    /// Says what was noted.
    pub fn tell(mut self, lost: u64) -> Outcome<()> {
        println!("{}", serde_json::to_string(&Percentiles::of(&mut self.times_ns, &self.stages_ns, lost))?);
        Ok(())
    }
}
