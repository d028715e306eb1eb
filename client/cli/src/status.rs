//! `lobula status`: how the daemon is, once.

use crate::Failure;
use crate::args::StatusArgs;
use crate::output::{duration, json, line, thousands};
use lobula_client::control::Status;

/// Asks the daemon and prints its answer.
pub fn run(args: &StatusArgs) -> Result<(), Failure> {
    let status = crate::connect(args.root.as_deref(), "status")?.status()?;
    if args.json {
        return json(&status);
    }
    lines(&status).iter().try_for_each(line)
}

/// The answer for people.
pub fn lines(status: &Status) -> Vec<String> {
    let (bytes, events) = (&status.bytes, &status.events);
    let row = |name: &str, text: String| format!("{name:<10} {text}");
    let mut lines = vec![
        row(
            "daemon",
            format!(
                "{}, pid {}, generation {}, up {:.0} s",
                status.version, status.pid, status.generation, status.uptime_s
            ),
        ),
        row("camera", format!("{}, {}x{}: {}", status.camera, status.width, status.height, status.source)),
        row("state", state(status)),
        row(
            "rate",
            format!(
                "{:.2} MB/s, {:.3} Mev/s in, {:.3} Mev/s out",
                status.bytes_per_s / 1e6,
                status.events_in_per_s / 1e6,
                status.events_out_per_s / 1e6
            ),
        ),
        row(
            "latency",
            format!(
                "{} mean, {} longest over the last second, from arrived to published",
                duration(status.latency_ns_mean),
                duration(status.latency_ns_max)
            ),
        ),
        row(
            "bytes",
            format!(
                "{} in = {} decoded + {} faulty + {} lost",
                thousands(bytes.input),
                thousands(bytes.decoded),
                thousands(bytes.faulty),
                thousands(bytes.lost)
            ),
        ),
        row(
            "events",
            format!(
                "{} decoded = {} published + {} filtered + {} dropped",
                thousands(events.decoded),
                thousands(events.published),
                thousands(events.filtered),
                thousands(events.dropped())
            ),
        ),
    ];
    for client in &status.clients {
        lines.push(row(
            "client",
            format!("{} (pid {}): {}", client.name, client.pid, client.streams.join(", ")),
        ));
    }
    for view in &status.views {
        let counts = format!(
            "{} published, {} skipped, {} late{}",
            view.published,
            view.skipped,
            view.late,
            if view.overflowed > 0 { format!(", {} without room", view.overflowed) } else { String::new() }
        );
        lines.push(row("view", format!("{}: {counts}", view.name)));
    }
    lines
}

fn state(status: &Status) -> String {
    // The name in JSON is the name for people.
    let state = serde_json::to_value(status.state).ok().and_then(|name| name.as_str().map(str::to_owned));
    let state = state.unwrap_or_default();
    if status.degraded.is_empty() { state } else { format!("{state}; {}", status.degraded.join("; ")) }
}
