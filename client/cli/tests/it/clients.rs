//! `serve`, and the subcommands that ask it.

use crate::tool::{failure, lobula};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Output, Stdio};

/// `lobula serve` in an instance of its own.
struct Served {
    daemon: Child,
    folder: tempfile::TempDir,
    hello: Value,
}

impl Served {
    fn start(config: &str) -> Self {
        let folder = tempfile::Builder::new().prefix("lobula-cli-").tempdir_in("/dev/shm").unwrap();
        let path = folder.path().join("lobulad.toml");
        std::fs::write(&path, config).unwrap();
        let mut daemon = lobula()
            .args(["serve", "--json", "--die-with-parent", "--config"])
            .arg(path)
            .arg("--root")
            .arg(folder.path().join("r"))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(daemon.stdout.take().unwrap()).read_line(&mut line).unwrap();
        Self { daemon, folder, hello: serde_json::from_str(&line).unwrap() }
    }

    fn ask(&self, args: &[&str]) -> Output {
        lobula().args(args).env("LOBULA_ROOT", self.folder.path().join("r")).output().unwrap()
    }

    fn lines(&self, args: &[&str]) -> Vec<String> {
        let output = self.ask(args);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
    }

    fn json(&self, args: &[&str]) -> Vec<Value> {
        self.lines(args).iter().map(|line| serde_json::from_str(line).unwrap()).collect()
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.daemon.kill();
        let _ = self.daemon.wait();
    }
}

const CAMERA: &str = r#"
    [camera]
    source = { kind = "synthetic", rate_evs = 200000, geometry = { width = 160, height = 120 } }

    [[view]]
    name = "histogram"
    kind = "polarity_histogram"
    period_us = 10000
"#;

#[test]
fn a_daemon_can_be_asked_and_listened_to() {
    let served = Served::start(CAMERA);
    assert_eq!(served.hello["width"], 160);
    assert_eq!(served.hello["pid"], served.daemon.id());

    let status = &served.json(&["status", "--json"])[0];
    let events = &status["events"];
    let sum = ["published", "filtered", "off_sensor", "overload", "no_memory"]
        .map(|key| events[key].as_u64().unwrap());
    assert_eq!(events["decoded"], sum.iter().sum::<u64>());
    assert!(served.lines(&["status"]).iter().any(|line| line.contains("synthetic")));

    let tops = served.json(&["top", "--json", "-n", "2", "--interval", "0.05"]);
    assert!(tops[0]["uptime_s"].as_f64() < tops[1]["uptime_s"].as_f64());

    assert_eq!(served.lines(&["echo", "events", "-n", "7"]).len(), 7);
    let events = served.json(&["echo", "events", "-n", "100", "--json"]);
    assert!(events.iter().all(|event| event["x"].as_u64() < Some(160) && event["y"].as_u64() < Some(120)));

    let windows = served.json(&["echo", "histogram", "-n", "2", "--json"]);
    for window in &windows {
        assert_eq!(window["t1"].as_u64(), window["t0"].as_u64().map(|t0| t0 + 10_000), "{window}");
        assert_eq!(window["shape"], serde_json::json!([2, 120, 160]));
    }

    let (code, said) = failure(&served.ask(&["echo", "no-such-view"]));
    assert_eq!(code, 3, "{said}");
    assert!(said.contains("histogram"), "{said}");
}

#[test]
fn a_bad_configuration_is_exit_code_78() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.toml");
    std::fs::write(&path, "[camera]\nnane = 1\n").unwrap();
    let (code, said) = failure(&lobula().args(["serve", "--config"]).arg(&path).output().unwrap());
    assert_eq!(code, 78, "{said}");
    assert!(said.contains("bad.toml") && said.contains("`name`"), "{said}");
}
