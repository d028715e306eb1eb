//! `lobula info`: what is in a recording.

use crate::Failure;
use crate::args::InfoArgs;
use crate::output::{json, line, thousands};
use lobula_formats::{Summary, WithDigest};

/// Reads the whole file and tells; every failure is of the input.
pub fn run(args: &InfoArgs) -> Result<(), Failure> {
    let recording = args.input.open(&args.file)?;
    let with_digest = if args.digest { WithDigest::Yes } else { WithDigest::No };
    let summary = Summary::of(&recording, with_digest)?;
    if args.json {
        return json(&summary);
    }
    for (name, value) in lines(&summary) {
        line(format!("{name:<12} {value}"))?;
    }
    Ok(())
}

fn lines(summary: &Summary) -> Vec<(&'static str, String)> {
    let unknown = || "unknown".to_string();
    let sensor = summary.width.zip(summary.height).map(|(width, height)| format!("{width}x{height}"));
    let mut lines = vec![
        (
            "format",
            [Some(summary.format), summary.encoding].into_iter().flatten().collect::<Vec<_>>().join(", "),
        ),
        ("bytes", thousands(summary.bytes)),
        ("sensor", sensor.unwrap_or_else(unknown)),
        (
            "events",
            format!(
                "{} ({} on, {} off)",
                thousands(summary.events),
                thousands(summary.on),
                thousands(summary.off)
            ),
        ),
    ];
    if let (Some(first), Some(last)) = (summary.t_first_us, summary.t_last_us) {
        let duration_us = last.saturating_sub(first);
        let mevs = summary.events as f64 / (duration_us as f64).max(1.0);
        lines.push(("time", format!("{first} to {last} µs, {:.6} s", duration_us as f64 / 1e6)));
        lines.push(("rate", format!("{mevs:.3} Mev/s")));
    }
    lines.push(("triggers", thousands(summary.triggers)));
    let others = [("IMU samples", summary.imu), ("frames", summary.frames)];
    lines.extend(others.into_iter().filter(|(_, n)| *n > 0).map(|(name, n)| (name, thousands(n))));
    let streams = summary.streams.iter().filter(|stream| !stream.name.is_empty());
    lines.extend(streams.map(|stream| ("stream", format!("{} ({})", stream.name, stream.kind.name()))));
    lines.push(("off sensor", thousands(summary.off_sensor)));
    let faults: Vec<_> =
        summary.faults.iter().filter(|(_, n)| **n > 0).map(|(kind, n)| format!("{n} {kind}")).collect();
    lines.push(("faults", if faults.is_empty() { "none".into() } else { faults.join(", ") }));
    lines.extend(summary.warnings.iter().map(|warning| ("warning", warning.clone())));
    lines.extend(summary.sha256.clone().map(|sha256| ("sha256", sha256)));
    lines
}
