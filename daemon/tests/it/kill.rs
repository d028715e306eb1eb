//! Who dies harms nobody else, and the books stay exact.

use crate::stage::{Books, PATIENCE, Stage, recording, wait_until};
use lobula_client::{Client, ClientOptions, Error, Root, SubscribeOptions};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

const LIVE: &str = "[camera]\nsource = { kind = \"synthetic\", rate_evs = 1000000, \
    geometry = { width = 320, height = 240 } }\n";

/// Not a test but the victim: a client in a process of its own, which this binary starts again with a root given.
#[test]
fn victim() {
    let Some(root) = std::env::var_os("LOBULA_TEST_VICTIM") else { return };
    let options =
        ClientOptions::default().root(Root::new(std::path::PathBuf::from(root)).unwrap()).name("victim");
    let client = Client::connect_within(options, PATIENCE).unwrap();
    let mut events = client.events(SubscribeOptions::default()).unwrap();
    let mut books = Books::default();
    loop {
        books.enter(&events.recv(PATIENCE).unwrap());
        if books.packets == 3 {
            println!("victim reads");
        }
        if books.lost > 0 {
            println!("victim lost and counted");
            return;
        }
    }
}

struct Victim {
    child: Child,
    lines: BufReader<std::process::ChildStdout>,
}

impl Victim {
    fn start(stage: &Stage) -> Self {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "kill::victim", "--nocapture"])
            .env("LOBULA_TEST_VICTIM", stage.root().path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        let mut this = Self { child, lines };
        this.wait_for("victim reads");
        this
    }

    fn wait_for(&mut self, text: &str) {
        let mut line = String::new();
        while !line.contains(text) {
            line.clear();
            assert!(self.lines.read_line(&mut line).unwrap() > 0, "the victim ended before `{text}`");
        }
    }

    fn signal(&self, signal: libc::c_int) {
        crate::stage::signal(&self.child, signal);
    }
}

impl Drop for Victim {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Number of victims the daemon lists.
fn victims(client: &Client) -> usize {
    client.status().unwrap().clients.iter().filter(|client| client.name == "victim").count()
}

/// A packet every 20 ms: a queue lasts for 2.5 s, so that only a client that stands still loses, and not one of a loaded
/// machine.
fn slow(stage: &Stage) -> String {
    let path = stage.path("scene.raw");
    recording(&path, 100_000);
    let source = format!("{{ kind = \"file\", path = \"{}\", speed = 0.05, loop = true }}", path.display());
    format!("[camera]\npacket_us = 100000\nsource = {source}\n")
}

#[test]
fn a_client_stopped_or_killed_costs_the_other_nothing() {
    let stage = Stage::new();
    let _daemon = stage.process(&slow(&stage));
    let client = stage.client();
    let mut events = client.events(SubscribeOptions::default()).unwrap();
    let mut books = Books::default();
    let mut read_packets = |n: u64| {
        let goal = books.packets + n;
        while books.packets < goal {
            books.enter(&events.recv(PATIENCE).unwrap());
        }
        books
    };
    let mut stopped = Victim::start(&stage);
    let mut killed = Victim::start(&stage);
    read_packets(10);
    stopped.signal(libc::SIGSTOP);
    killed.signal(libc::SIGKILL);
    let _ = killed.child.wait();
    // More packets than the depth of a queue: the stopped one's is overwritten.
    assert_eq!(read_packets(150).lost, 0);
    stopped.signal(libc::SIGCONT);
    stopped.wait_for("victim lost and counted");
    assert_eq!(read_packets(10).lost, 0);
    wait_until(|| victims(&client) == 0);
}

#[test]
fn victims_by_the_dozen_leave_room_for_the_next() {
    let stage = Stage::new();
    let _daemon = stage.process(LIVE);
    let client = stage.client();
    // More than the 8 a service has room for: the dead are cleaned away.
    for _ in 0..10 {
        let victim = Victim::start(&stage);
        victim.signal(libc::SIGKILL);
    }
    wait_until(|| victims(&client) == 0);
    let mut events = client.events(SubscribeOptions::default()).unwrap();
    events.recv(PATIENCE).unwrap();
}

#[test]
fn a_killed_daemon_comes_back_to_its_clients() {
    let stage = Stage::new();
    let mut daemon = stage.process(LIVE);
    let client = stage.client();
    let mut events = client.events(SubscribeOptions::default()).unwrap();
    let mut poll = client.events(SubscribeOptions::default().poll()).unwrap();
    let mut books = Books::default();
    for round in 0..3 {
        let first = client.hello().generation;
        let (mut polled, goal) = (0, 50);
        let mut changes = 0;
        while books.generation != first || books.packets < goal {
            let packet = events.recv(PATIENCE).unwrap();
            changes += u32::from(packet.generation_changed());
            books.enter(&packet);
        }
        assert_eq!(changes, u32::from(round > 0));
        assert!(books.delivered > 0, "{books:?}");
        while polled < 5 {
            polled += u32::from(poll.recv(PATIENCE).unwrap().header().generation == first);
        }
        daemon.kill();
        // What was sent before is still there; then the client says who is missing.
        let error = loop {
            match events.recv(std::time::Duration::from_millis(200)) {
                Ok(packet) => books.enter(&packet),
                Err(error) => break error,
            }
        };
        assert!(matches!(error, Error::NoDaemon { .. }), "{error}");
        daemon = stage.process(LIVE);
        wait_until(|| client.is_connected() && client.hello().generation != first);
    }
    // A clean end under clients that stay, and a start after it.
    daemon.signal(libc::SIGTERM);
    assert!(daemon.child.wait().unwrap().success());
    let daemon = stage.process(LIVE);
    let pid = daemon.child.id();
    wait_until(|| client.is_connected() && client.hello().pid == pid);
    let generation = client.hello().generation;
    while books.generation != generation || books.packets < 50 {
        books.enter(&events.recv(PATIENCE).unwrap());
    }
}

#[test]
fn nothing_is_left_after_both_were_killed() {
    let stage = Stage::new();
    let mut daemon = stage.process(LIVE);
    let victim = Victim::start(&stage);
    victim.signal(libc::SIGKILL);
    daemon.kill();
    drop(victim);
    let mut daemon = stage.process(LIVE);
    stage.events().recv(PATIENCE).unwrap();
    daemon.signal(libc::SIGTERM);
    assert!(daemon.child.wait().unwrap().success());
    wait_until(|| !stage.root().path().exists());
}
