//! What cannot be served is refused in one sentence, before anything is left behind.

use crate::stage::{Stage, recording};
use lobula_client::{Client, ClientOptions, Error, SubscribeOptions};
use lobulad::{Daemon, StartError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

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
    let mut command = Command::new(env!("CARGO_BIN_EXE_lobulad"));
    command.arg("--root").arg(shm.join("r")).arg("--config").arg(&config);
    let Some(output) = in_small_shm(&shm, "16m", &command) else { return };
    one_sentence(&output, 1, &["MiB free", "needed", "enlarge"]);
}

/// Runs a command where `shm` is a file system of its own, of this size. None: nothing may be mounted here.
fn in_small_shm(shm: &Path, size: &str, command: &Command) -> Option<Output> {
    let mount = format!("mount -t tmpfs -o size={size},mode=700 none \"$0\" && exec \"$@\"");
    let mut unshare = Command::new("unshare");
    unshare
        .args(["--mount", "sh", "-c", &mount])
        .arg(shm)
        .arg(command.get_program())
        .args(command.get_args());
    for (name, value) in command.get_envs() {
        unshare.env(name, value.unwrap());
    }
    let Ok(output) = unshare.output() else {
        eprintln!("skipped: there is no unshare");
        return None;
    };
    let text = String::from_utf8_lossy(&output.stderr);
    if text.contains("unshare:") || text.contains("mount:") {
        eprintln!("skipped: no file system may be mounted here ({})", text.trim());
        return None;
    }
    Some(output)
}

#[test]
fn a_shm_that_fills_up_later_costs_no_view() {
    let stage = Stage::new();
    let shm = stage.path("shm");
    std::fs::create_dir(&shm).unwrap();
    recording(&stage.path("scene.raw"), 100_000);
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "refuse::in_a_shm_that_fills_up", "--nocapture"]).env("LOBULA_TEST_SHM", &shm);
    let Some(output) = in_small_shm(&shm, "32m", &command) else { return };
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && text.contains("all windows came"), "{:?} {text}", output.status);
}

/// Not a test but a part of the one above, in a process that alone sees the small file system.
#[test]
fn in_a_shm_that_fills_up() {
    let Some(shm) = std::env::var_os("LOBULA_TEST_SHM").map(PathBuf::from) else { return };
    let recording = shm.with_file_name("scene.raw");
    let source = format!("[camera]\nsource = {{ kind = \"file\", path = {recording:?}, lossless = true }}\n");
    let view = "[[view]]\nname = \"v\"\nkind = \"time_surface\"\nperiod_us = 5000\n";
    let mut config = lobulad::config::parse(&(source + view)).unwrap();
    config.instance.root = Some(shm.join("r"));
    let daemon = Daemon::start(&config).unwrap();
    let options = ClientOptions::default().root(daemon.root().clone()).name("test");
    let client = Client::connect(options.clone()).unwrap();
    let mut events = client.events(SubscribeOptions::default().lossless()).unwrap();
    let mut view = client.view("v", SubscribeOptions::default().lossless()).unwrap();

    let mut filler = std::fs::File::create(shm.join("filler")).unwrap();
    while filler.write(&[1; 4096]).is_ok_and(|n| n > 0) {}
    let late = Client::connect(options).unwrap().events(SubscribeOptions::default().lossless());
    assert!(matches!(late, Err(Error::NoSpace { .. })), "{late:?}");

    client.play(1).unwrap();
    let (mut windows, mut held) = (0, Vec::new());
    loop {
        while events.try_recv().unwrap().is_some() {}
        let Ok(tensor) = view.recv(Duration::from_millis(1)) else { continue };
        assert_eq!(tensor.header().sequence, windows);
        windows += 1;
        if tensor.is_end() {
            break;
        }
        // What is held makes the daemon go through its memory.
        held.push(tensor);
        held.drain(..held.len() - 1);
    }
    assert!(windows >= 20, "{windows}");
    println!("all windows came");
    daemon.stop();
    daemon.join();
}
