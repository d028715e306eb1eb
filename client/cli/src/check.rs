//! `lobula check`: whether a recording is whole and in order, and what of it can be read.

use crate::Failure;
use crate::args::CheckArgs;
use crate::output::{json, line, thousands};
use crate::progress::Progress;
use lobula_formats::Check;
use std::process::ExitCode;

/// Reads the whole file and tells; exit code 1 where it is not sound.
pub fn run(args: &CheckArgs) -> Result<ExitCode, Failure> {
    let recording = args.input.open(&args.file)?;
    let mut progress = Progress::start(recording.bytes());
    let check = Check::of(&recording, |position| progress.at(position));
    progress.end();
    if args.json {
        json(&check)?;
    } else {
        lines(&check).iter().try_for_each(line)?;
    }
    Ok(if check.sound { ExitCode::SUCCESS } else { ExitCode::from(Failure::GENERAL) })
}

fn lines(check: &Check) -> Vec<String> {
    let mut lines = vec![format!("{:<12} {}", "events", thousands(check.events))];
    if let (Some(first), Some(last)) = (check.t_first_us, check.t_last_us) {
        lines.push(format!("{:<12} {first} to {last} µs", "time"));
    }
    let others = [("triggers", check.triggers), ("IMU samples", check.imu), ("frames", check.frames)];
    lines.extend(
        others.iter().filter(|(_, n)| *n > 0).map(|(name, n)| format!("{name:<12} {}", thousands(*n))),
    );
    lines.push(match check.steps_back {
        0 => format!("{:<12} never steps back", "order"),
        n => format!(
            "{:<12} steps back {} times, by up to {} µs",
            "order",
            thousands(n),
            thousands(check.step_back_max_us)
        ),
    });
    if check.off_sensor > 0 {
        lines.push(format!(
            "{:<12} {} events, which readers drop",
            "off sensor",
            thousands(check.off_sensor)
        ));
    }
    if check.bytes_faulty > 0 {
        let kinds = check.faults.iter().filter(|(_, n)| **n > 0).map(|(kind, n)| format!("{n} {kind}"));
        let kinds: Vec<_> = kinds.collect();
        lines.push(format!(
            "{:<12} {} bytes ({})",
            "damage",
            thousands(check.bytes_faulty),
            kinds.join(", ")
        ));
    }
    lines.extend(check.errors.iter().map(|error| format!("{:<12} {error}", "error")));
    lines.extend(check.warnings.iter().map(|warning| format!("{:<12} {warning}", "warning")));
    lines.push(match (check.sound, check.errors.is_empty()) {
        (true, _) => "sound".into(),
        (false, true) => "not sound: all but the above can be read; lobula convert keeps it".into(),
        (false, false) => {
            "not sound: what comes before the error can be kept with lobula convert --recover".into()
        }
    });
    lines
}
