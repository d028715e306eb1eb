//! `report [--json] [--only OP]... [--rounds N] [--events N] [--tensor-events N]`: each operation, or those named, and the
//! same one of a peer, in turn on one core.
//!
//! With feature `peers` beside eventcv-core 1.0.11, else alone. Figures are medians of CPU time; a side that gives a
//! wrong answer ends the report with exit code 1.

use std::process::ExitCode;

use lobula_benches::contest::{Line, Protocol};
use lobula_benches::input::{EVENTS, Scene, TENSOR_EVENTS};
use lobula_benches::op::Op;
use lobula_benches::{clock, instructions, peers};

const USAGE: &str = "usage: report [--json] [--only OP]... [--rounds N] [--events N] [--tensor-events N]";

struct Options {
    json: bool,
    only: Vec<Op>,
    rounds: usize,
    events: usize,
    tensor_events: usize,
}

impl Options {
    fn parse(mut args: impl Iterator<Item = String>) -> Result<Self, String> {
        let mut options =
            Self { json: false, only: Vec::new(), rounds: 5, events: EVENTS, tensor_events: TENSOR_EVENTS };
        while let Some(arg) = args.next() {
            match arg.as_str() {
                "--json" => options.json = true,
                "--only" => options.only.push(op(&args.next().ok_or(USAGE)?)?),
                "--rounds" => options.rounds = number(&args.next().ok_or(USAGE)?)?,
                "--events" => options.events = number(&args.next().ok_or(USAGE)?)?,
                "--tensor-events" => options.tensor_events = number(&args.next().ok_or(USAGE)?)?,
                _ => return Err(format!("{arg} is no option; {USAGE}")),
            }
        }
        Ok(options)
    }
}

fn op(name: &str) -> Result<Op, String> {
    let names = Op::ALL.iter().map(|op| op.name()).collect::<Vec<_>>().join(", ");
    Op::ALL
        .iter()
        .copied()
        .find(|op| op.name() == name)
        .ok_or(format!("{name} is no operation; there are {names}"))
}

fn number(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n > 0).ok_or(format!("{text} is no number; at least 1"))
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().collect();
    if let [_, option, name, runs] = &args[..]
        && option == instructions::OPTION
    {
        return done(op(name).and_then(|op| instructions::child(op, number(runs)?)));
    }
    done(Options::parse(std::env::args().skip(1)).and_then(|options| report(&options)))
}

fn done(result: Result<(), String>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(sentence) => {
            eprintln!("report: {sentence}");
            ExitCode::FAILURE
        }
    }
}

fn report(options: &Options) -> Result<(), String> {
    let core = clock::pin_to_one_core().map_err(|e| e.to_string())?;
    let scene =
        Scene::load(options.events.max(options.tensor_events))?.with_tensor_events(options.tensor_events);
    let peer = peers::load(&scene)?;
    eprintln!("{}, pinned to core {core}; {}", clock::machine(), scene.source);
    if !options.json {
        println!("{}", heading());
    }
    for op in Op::ALL.iter().filter(|op| options.only.is_empty() || options.only.contains(op)) {
        for contest in op.contests(&scene, peer.as_deref())? {
            let alone = cfg!(feature = "peers") && contest.peers.is_empty();
            let mut line = contest.run(options.rounds)?;
            if alone && line.kernel == "portable" && line.protocol == Protocol::Stream {
                line.instructions = instructions::per_event(*op);
            }
            println!("{}", if options.json { json(&line)? } else { row(&line) });
        }
    }
    Ok(())
}

fn json(line: &Line) -> Result<String, String> {
    serde_json::to_string(line).map_err(|e| e.to_string())
}

fn heading() -> String {
    format!(
        "{:<20} {:<9} {:<7} {:>9} {:>9} {:<6} {:>6}  {:<10} {}",
        "operation", "kernel", "proto", "ours", "peer", "unit", "ratio", "bar", "peer's way; differences"
    )
}

fn row(line: &Line) -> String {
    let figure = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.2}"));
    let verdict = match (line.ratio, line.bar) {
        (Some(ratio), Some(bar)) => format!("{bar}x {}", if ratio >= bar { "ok" } else { "below" }),
        _ => "-".into(),
    };
    let counted = line.instructions.map(|n| format!("no peer; {n:.1} instructions an event"));
    let way = counted.as_deref().or(line.peer_name.as_deref()).unwrap_or(match cfg!(feature = "peers") {
        true => "no peer",
        false => "no peer: built without feature `peers`",
    });
    format!(
        "{:<20} {:<9} {:<7} {:>9.2} {:>9} {:<6} {:>6}  {verdict:<10} {way}; {}",
        line.op,
        line.kernel,
        line.protocol.name(),
        line.ours,
        figure(line.peer),
        line.unit.name(),
        figure(line.ratio),
        line.note
    )
}
