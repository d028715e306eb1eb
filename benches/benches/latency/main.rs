//! How long a packet takes from its due time to a client in another process, beside iceoryx2 alone in the same run.
//!
//! `cargo bench -p lobula-benches --bench latency [-- --seconds N --mevs N]` prints Markdown for the README; `--mevs`
//! measures that rate alone. Every number is
//! received - due, where due is the schedule's time and not when the sender got round to it (no coordinated omission).
//! Each process is this program again with another role: a daemon with a synthetic camera of 1 ms packets, its client,
//! and the two ends of the floor.

mod allocations;
mod child;
mod client;
mod daemon;
mod floor;
mod percentiles;
mod run;

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;

/// Rates measured, in events per second.
const RATES_EVS: [u32; 3] = [1_000_000, 10_000_000, 30_000_000];
/// Time between two packets.
const PACKET_US: u64 = 1_000;

/// How the receiving end waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wait {
    Sleep,
    Poll,
}

impl Wait {
    const ALL: [Self; 2] = [Self::Poll, Self::Sleep];

    const fn name(self) -> &'static str {
        match self {
            Self::Sleep => "asleep",
            Self::Poll => "polling",
        }
    }
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).filter(|arg| arg != "--bench").collect();
    let result = match args.first().map(String::as_str) {
        Some("daemon") => daemon::role(&args[1..]),
        Some("client") => client::role(&args[1..]),
        Some("floor-sender") => floor::sender(&args[1..]),
        Some("floor-receiver") => floor::receiver(&args[1..]),
        _ => options(&args).and_then(|(seconds, rates_evs)| run::all(seconds, &rates_evs)),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("latency: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Seconds for each case, and the rates to measure.
fn options(args: &[String]) -> Outcome<(u64, Vec<u32>)> {
    let (mut seconds, mut rates_evs) = (10, RATES_EVS.to_vec());
    for place in (0..args.len()).step_by(2) {
        match args[place].as_str() {
            "--seconds" => seconds = number(args, place + 1)?,
            "--mevs" => rates_evs = vec![number::<u32>(args, place + 1)?.saturating_mul(1_000_000)],
            other => {
                return Err(format!("{other} is no option; usage: latency [--seconds N] [--mevs N]").into());
            }
        }
    }
    Ok((seconds, rates_evs))
}

/// Any error, for a sentence at the end.
type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// The argument at `place`, as a number.
fn number<T: std::str::FromStr>(args: &[String], place: usize) -> Outcome<T> {
    let text = args.get(place).ok_or("an argument is missing")?;
    text.parse().map_err(|_| format!("{text} is no number of this kind").into())
}

/// The argument at `place`, as a way to wait.
fn wait(args: &[String], place: usize) -> Outcome<Wait> {
    let text = args.get(place).ok_or("an argument is missing")?;
    Wait::ALL.into_iter().find(|wait| wait.name() == text).ok_or_else(|| format!("{text} is no wait").into())
}
