//! Every case in turn, each between processes of its own, and the tables for the README.

use std::os::unix::fs::DirBuilderExt;

use lobula_benches::clock;
use lobula_client::Root;

use crate::child::Role;
use crate::daemon::{Mark, Work};
use crate::percentiles::Percentiles;
use crate::{Outcome, RATES_EVS, Wait, client, daemon, floor};

/// The rate at which the issue sets its bars.
const BAR_RATE_EVS: u32 = RATES_EVS[0];

/// One line of the table.
struct Row {
    rate_evs: u32,
    wait: Wait,
    what: &'static str,
    seen: Percentiles,
}

/// What the daemon allocated while it was measured.
struct Allocated {
    rate_evs: u32,
    wait: Wait,
    work: Work,
    from: Mark,
    to: Mark,
}

/// Measures every case of these rates for so many seconds and prints the tables.
pub fn all(seconds: u64, rates_evs: &[u32]) -> Outcome<()> {
    println!("{}, {}; {seconds} s a case, 1 ms packets, {}\n", clock::machine(), clock::today(), load());
    let mut rows = Vec::new();
    let before = clock::stolen();
    let mut allocated = Vec::new();
    let mut per_loan = 0.0f64;
    for &rate_evs in rates_evs {
        for wait in Wait::ALL {
            let (seen, of_loan) = measure_floor(rate_evs, wait, seconds)?;
            per_loan = per_loan.max(of_loan);
            rows.push(Row { rate_evs, wait, what: "iceoryx2 alone", seen });
            for work in Work::ALL {
                let (seen, from, to) = measure(rate_evs, wait, work, seconds)?;
                rows.push(Row { rate_evs, wait, what: work.name(), seen });
                allocated.push(Allocated { rate_evs, wait, work, from, to });
            }
        }
    }
    print_latency(&rows);
    println!(
        "The hypervisor took {:.1} % of the cores' time from this machine meanwhile.\n",
        before.until_now()
    );
    print_stages(&rows);
    print_kept_up(&allocated);
    print_allocations(&allocated, per_loan);
    if rates_evs.contains(&BAR_RATE_EVS) {
        print_bars(&rows);
    }
    Ok(())
}

fn measure(rate_evs: u32, wait: Wait, work: Work, seconds: u64) -> Outcome<(Percentiles, Mark, Mark)> {
    let root = Root::new(format!("/dev/shm/lobula-latency-{}", std::process::id()))?;
    let mut server = Role::start("daemon", &daemon::args(&root, rate_evs, work))?;
    server.line()?;
    let mut client = Role::start("client", &client::args(&root, wait, seconds))?;
    client.line()?;
    let from = serde_json::from_str(&server.ask("mark")?)?;
    let seen = serde_json::from_str(&client.line()?)?;
    let to = serde_json::from_str(&server.ask("mark")?)?;
    client.end()?;
    server.end()?;
    Ok((seen, from, to))
}

fn measure_floor(rate_evs: u32, wait: Wait, seconds: u64) -> Outcome<(Percentiles, f64)> {
    let root = Root::new(format!("/dev/shm/lobula-floor-{}", std::process::id()))?;
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(root.path())?;
    let result = between(&root, rate_evs, wait, seconds);
    let _ = std::fs::remove_dir_all(root.path());
    result
}

fn between(root: &Root, rate_evs: u32, wait: Wait, seconds: u64) -> Outcome<(Percentiles, f64)> {
    let mut receiver = Role::start("floor-receiver", &floor::receiver_args(root, wait, seconds))?;
    receiver.line()?;
    let mut sender = Role::start("floor-sender", &floor::sender_args(root, rate_evs))?;
    receiver.line()?;
    let seen = serde_json::from_str(&receiver.line()?)?;
    receiver.end()?;
    let per_loan = sender.line()?.parse()?;
    sender.end()?;
    Ok((seen, per_loan))
}

fn load() -> String {
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    format!("load before {}", load.split(' ').next().unwrap_or("unknown"))
}

fn mevs(rate_evs: u32) -> u32 {
    rate_evs / 1_000_000
}

fn print_latency(rows: &[Row]) {
    println!("Due time to received, µs:\n");
    println!("| Mev/s | client | daemon | p50 | p99 | p99.9 | max | packets | events lost |");
    println!("|---:|---|---|---:|---:|---:|---:|---:|---:|");
    for Row { rate_evs, wait, what, seen } in rows {
        let us = |ns: u64| format!("{:.1}", ns as f64 / 1000.0);
        println!(
            "| {} | {} | {what} | {} | {} | {} | {} | {} | {} |",
            mevs(*rate_evs),
            wait.name(),
            us(seen.p50),
            us(seen.p99),
            us(seen.p999),
            us(seen.max),
            seen.packets,
            seen.lost
        );
    }
    println!();
}

fn print_stages(rows: &[Row]) {
    println!("Medians of the stages, µs:\n");
    println!(
        "| Mev/s | client | daemon | due, arrived | arrived, decoded | decoded, published | published, received |"
    );
    println!("|---:|---|---|---:|---:|---:|---:|");
    for Row { rate_evs, wait, what, seen } in rows {
        let [arrived, decoded, published, received] = seen.stages.map(|ns| ns as f64 / 1000.0);
        let (mevs, wait) = (mevs(*rate_evs), wait.name());
        println!(
            "| {mevs} | {wait} | {what} | {arrived:.1} | {decoded:.1} | {published:.1} | {received:.1} |"
        );
    }
    println!();
}

/// Whether the daemon was quick enough.
fn print_kept_up(allocated: &[Allocated]) {
    println!("What the daemon did meanwhile:\n");
    println!(
        "| Mev/s | client | daemon | packets | of the source's, over 10 ms late | windows | packets missed by views |"
    );
    println!("|---:|---|---|---:|---:|---:|---:|");
    for Allocated { rate_evs, wait, work, from, to } in allocated {
        println!(
            "| {} | {} | {} | {} | {} | {} | {} |",
            mevs(*rate_evs),
            wait.name(),
            work.name(),
            to.packets - from.packets,
            to.behind - from.behind,
            to.windows - from.windows,
            to.views_missed - from.views_missed,
        );
    }
    println!();
}

/// Allocations of the threads that a packet goes through; iceoryx2 allocates for each loan, and the floor says how often.
fn print_allocations(allocated: &[Allocated], per_loan: f64) {
    println!("Allocations for a packet after start-up (iceoryx2 by itself: {per_loan:.2} a loan):\n");
    println!(
        "| Mev/s | daemon | source | pipeline, for a packet | ours of it | views, for a window | ours of it |"
    );
    println!("|---:|---|---:|---:|---:|---:|---:|");
    for Allocated { rate_evs, work, from, to, .. } in allocated {
        let grown = |name: &str| {
            let of = |mark: &Mark| mark.allocations.get(name).copied().unwrap_or_default();
            of(to).saturating_sub(of(from)) as f64
        };
        let packets = (to.packets - from.packets).max(1) as f64;
        let windows = (to.windows - from.windows).max(1) as f64;
        let (pipeline, views) = (grown("pipeline") / packets, grown("views") / windows);
        let ours = |all: f64| (all - per_loan).max(0.0);
        println!(
            "| {} | {} | {:.3} | {pipeline:.3} | {:.3} | {views:.3} | {:.3} |",
            mevs(*rate_evs),
            work.name(),
            grown("source") / packets,
            ours(pipeline),
            ours(views),
        );
    }
    println!();
}

/// The bars: ours minus the floor at 1 Mev/s without filters.
fn print_bars(rows: &[Row]) {
    for wait in Wait::ALL {
        let seen = |what: &str| {
            let at = |row: &&Row| row.rate_evs == BAR_RATE_EVS && row.wait == wait && row.what == what;
            rows.iter().find(at).map(|row| row.seen).unwrap_or_default()
        };
        let (ours, floor) = (seen(Work::Bare.name()), seen("iceoryx2 alone"));
        let p50_us_max = if wait == Wait::Poll { 10.0 } else { 30.0 };
        for (name, ours, floor, us_max) in
            [("p50", ours.p50, floor.p50, p50_us_max), ("p99", ours.p99, floor.p99, 250.0)]
        {
            let us = (ours as f64 - floor as f64) / 1000.0;
            let verdict = if us <= us_max { "ok" } else { "above" };
            println!("{}: {name} {us:.1} µs over the floor, at most {us_max} µs: {verdict}", wait.name());
        }
    }
}
