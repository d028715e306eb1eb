//! What cannot be served is refused in one sentence, before anything is left behind.

use crate::stage::Stage;
use lobula_client::{Client, Error};
use lobulad::{Daemon, StartError};
use std::process::{Command, Output};

fn lobulad(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lobulad")).args(arguments).output().unwrap()
}

const SMALL: &str =
    "[camera]\nsource = { kind = \"synthetic\", rate_evs = 10000, geometry = { width = 64, height = 48 } }\n";

#[track_caller]
fn one_sentence(output: &Output, code: i32, parts: &[&str]) {
    let text = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(output.status.code(), Some(code), "{text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
}

#[test]
fn bad_configurations_end_with_78() {
    let stage = Stage::new();
    let path = stage.path("bad.toml");
    let path = path.to_str().unwrap();
    for (text, parts) in [
        ("[camera]\nnane = \"x\"", &["bad.toml", "did you mean `name`?"][..]),
        ("[camera]\nsource = { kind = \"file\", path = \"/not/there.raw\" }", &["/not/there.raw"]),
        ("[camera]\nsource = { kind = \"file\", path = \"/tmp\" }", &["/tmp"]),
        ("[instance]\nroot = \"relative\"", &["relative", "absolute"]),
        ("[[view]]\nname = \"v\"\nkind = \"voxel_grid\"\nperiod_us = 0", &["period_us"]),
    ] {
        std::fs::write(path, text).unwrap();
        one_sentence(&lobulad(&["--check", path]), 78, parts);
        one_sentence(&lobulad(&["--config", path]), 78, parts);
    }
    one_sentence(&lobulad(&["--config", "/not/there.toml"]), 78, &["/not/there.toml"]);
    std::fs::write(path, SMALL).unwrap();
    let output = lobulad(&["--check", path]);
    assert!(output.status.success() && String::from_utf8(output.stdout).unwrap().contains("ok"));
}

#[test]
fn an_instance_in_use_and_one_without_a_daemon_are_told() {
    let stage = Stage::new();
    let error = Client::connect(stage.options()).unwrap_err();
    assert_eq!(error, Error::NoDaemon { root: stage.root() });
    assert!(!stage.root().path().exists(), "a client makes no directory");
    let daemon = stage.daemon(SMALL);
    let error = Daemon::start(&stage.config(SMALL)).unwrap_err();
    assert_eq!(error, StartError::System(Error::InUse { root: stage.root() }));
    stage.client().status().unwrap();
    daemon.stop();
    daemon.join();
    assert!(!stage.root().path().exists());
}

#[test]
fn a_small_shm_is_one_sentence_and_never_a_sigbus() {
    let stage = Stage::new();
    let shm = stage.path("shm");
    std::fs::create_dir(&shm).unwrap();
    let config = stage.path("big.toml");
    let camera = "[camera]\nsource = { kind = \"synthetic\", rate_evs = 10000 }\n";
    let view = "[[view]]\nname = \"v\"\nkind = \"voxel_grid\"\nperiod_us = 10000\n";
    std::fs::write(&config, format!("{camera}{view}")).unwrap();
    let mounted = Command::new("unshare")
        .args(["--mount", "sh", "-c", "mount -t tmpfs -o size=16m,mode=700 none \"$0\" && exec \"$@\""])
        .arg(&shm)
        .arg(env!("CARGO_BIN_EXE_lobulad"))
        .args(["--root", shm.join("r").to_str().unwrap(), "--config", config.to_str().unwrap()])
        .output();
    let Ok(output) = mounted else { return eprintln!("skipped: there is no unshare") };
    let text = String::from_utf8_lossy(&output.stderr);
    if text.contains("unshare:") || text.contains("mount:") {
        return eprintln!("skipped: no file system may be mounted here ({})", text.trim());
    }
    one_sentence(&output, 1, &["MiB free", "needed", "enlarge"]);
}
