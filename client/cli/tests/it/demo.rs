//! `lobula demo`: its sums, its digests, and that it leaves nothing behind.

use crate::tool::{failure, lobula, run};
use lobula_tests::data;
use serde_json::Value;
use std::path::Path;

fn demo(args: &[&str]) -> Value {
    let output = run(&[&["demo", "--json"], args].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.lines().count(), 1, "one line: {text}");
    serde_json::from_str(&text).unwrap()
}

#[track_caller]
fn holds(summary: &Value) {
    let number = |key: &str| summary[key].as_u64().unwrap_or_else(|| panic!("{key} of {summary}"));
    let lost: u64 = summary["lost"].as_object().unwrap().values().map(|n| n.as_u64().unwrap()).sum();
    assert!(number("in") > 0 && number("delivered") > 0 && number("filtered") > 0, "{summary}");
    assert_eq!(number("in"), number("delivered") + number("filtered") + lost, "{summary}");
    for times in ["latency_ns", "floor_ns"] {
        let [p50, p99, p999] = ["p50", "p99", "p999"].map(|key| summary[times][key].as_u64().unwrap());
        assert!(0 < p50 && p50 <= p99 && p99 <= p999, "{times} of {summary}");
    }
    assert_eq!(summary["sha256_live"], summary["sha256_offline"]);
    assert_eq!(summary["sha256_live"].as_str().unwrap().len(), 64);
    let png = Path::new(summary["png"].as_str().unwrap());
    assert!(std::fs::read(png).unwrap().starts_with(b"\x89PNG\r\n"), "{}", png.display());
    std::fs::remove_file(png).unwrap();
    for (name, pid) in summary["pids"].as_object().unwrap() {
        let process = Path::new("/proc").join(pid.to_string());
        assert!(!process.exists(), "{name} still runs");
    }
    let root = format!("/dev/shm/lobula-demo-{}", summary["pids"]["demo"]);
    for root in [root.clone(), format!("{root}-floor"), format!("{root}-replay")] {
        assert!(!Path::new(&root).exists(), "{root} is left");
    }
}

#[test]
fn the_demo_adds_up_and_leaves_nothing_behind() {
    let summary = demo(&["--seconds", "2", "--rate", "0.5"]);
    holds(&summary);
    let mut pids: Vec<_> = summary["pids"].as_object().unwrap().values().collect();
    pids.sort_by_key(|pid| pid.as_u64());
    pids.dedup();
    assert_eq!(pids.len(), 4, "processes of their own: {summary}");
}

#[test]
fn a_recording_can_be_the_camera() {
    let Some(path) = data("evt3_gen41_1280x720.raw") else { return };
    holds(&demo(&["--seconds", "2", "--input", path.to_str().unwrap()]));
}

#[test]
fn without_a_terminal_it_prints_plain_lines() {
    let output = lobula().args(["demo", "--seconds", "1", "--rate", "0.3"]).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && !text.contains('\x1b'), "{text}");
    let wanted =
        ["noise removed", "generation 2: ", "sha256 live = offline: yes", "lobula top", "SIGSTOP", "SIGKILL"];
    for part in wanted {
        assert!(text.contains(part), "{part} in {text}");
    }
    let png = text.lines().find_map(|line| line.strip_prefix("picture, raw beside filtered: ")).unwrap();
    std::fs::remove_file(png).unwrap();
}

#[test]
fn bad_input_is_told_in_one_sentence() {
    let (code, said) = failure(&run(&["demo", "--json", "--input", "/nowhere/missing.raw"]));
    assert_eq!((code, said.trim_end().lines().count()), (2, 1), "{said}");
    assert!(said.contains("/nowhere/missing.raw"), "{said}");
}

/// A signal ends the demo, its processes and its memory.
#[test]
fn a_signal_leaves_nothing_behind() {
    use std::io::{BufRead, BufReader};
    let mut demo = lobula()
        .args(["demo", "--seconds", "60", "--rate", "0.3"])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(demo.stdout.take().unwrap()).lines();
    let live = lines.find(|line| line.as_ref().is_ok_and(|line| line.contains("both clients read")));
    assert!(live.is_some());
    let pid = demo.id().to_string();
    assert!(std::process::Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
    assert_eq!(demo.wait().unwrap().code(), Some(130));
    let name = format!("lobula-demo-{pid}");
    for place in [Path::new("/dev/shm").join(&name), std::env::temp_dir().join(&name)] {
        assert!(!place.exists(), "{} is left", place.display());
    }
}
