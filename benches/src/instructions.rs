//! Instructions an operation takes for an event, counted by callgrind: the same number every time.
//!
//! The program runs itself under valgrind, once with one run of the operation and once with three; the difference
//! leaves the preparation out. valgrind knows no AVX-512: the figure is that of the portable code.

use std::process::Command;

use crate::contest::Protocol;
use crate::input::Scene;
use crate::op::Op;

/// The option under which a program that calls [`per_event`] must call [`child`].
pub const OPTION: &str = "--count-instructions";
/// Events of a run: valgrind is slow.
const EVENTS: usize = 200_000;

/// Instructions per event in protocol `stream`; `None` where there is no valgrind.
pub fn per_event(op: Op) -> Option<f64> {
    let (once, events) = counted(op, 1)?;
    let (thrice, _) = counted(op, 3)?;
    Some((thrice.saturating_sub(once)) as f64 / (2 * events) as f64)
}

/// All instructions of a process with so many runs, and the events of one.
fn counted(op: Op, runs: usize) -> Option<(u64, u64)> {
    let mut valgrind = Command::new("valgrind");
    valgrind.args(["--tool=callgrind", "--callgrind-out-file=/dev/null"]);
    valgrind.arg(std::env::current_exe().ok()?).args([OPTION, op.name(), &runs.to_string()]);
    let output = valgrind.output().ok()?;
    let (told, log) = (String::from_utf8(output.stdout).ok()?, String::from_utf8_lossy(&output.stderr));
    let collected = log.lines().find_map(|line| line.split_once("Collected : "))?.1;
    Some((collected.trim().parse().ok()?, told.trim().parse().ok()?))
}

/// The process under valgrind: runs the operation and tells how many events one run has.
///
/// # Errors
/// A sentence, where it cannot.
pub fn child(op: Op, runs: usize) -> Result<(), String> {
    let scene = Scene::load(EVENTS)?.with_tensor_events(EVENTS);
    let contests = op.contests(&scene, None)?;
    let stream = contests.into_iter().find(|contest| contest.protocol == Protocol::Stream);
    let mut contest = stream.ok_or("it has no streaming form")?;
    for _ in 0..runs {
        (contest.ours)();
    }
    println!("{}", contest.events);
    Ok(())
}
