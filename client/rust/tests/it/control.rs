//! What a client makes of what it hears on the control socket.

use lobula_client::control::{Banner, Hello, Reply, SourceState, Status};
use lobula_client::{Client, ClientOptions, Error, Root};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixListener;
use tempfile::TempDir;

/// A directory with a socket that answers the first connection with these lines, one for the greeting and one for each
/// request, and then hangs up.
fn daemon(lines: Vec<String>) -> (TempDir, ClientOptions) {
    let folder = tempfile::Builder::new().prefix("lobula-t").tempdir_in("/dev/shm").unwrap();
    let root = Root::new(folder.path()).unwrap();
    let listener = UnixListener::bind(root.control_socket()).unwrap();
    std::thread::spawn(move || {
        let (mut socket, _) = listener.accept().unwrap();
        let mut requests = BufReader::new(socket.try_clone().unwrap()).lines();
        for line in lines {
            if writeln!(socket, "{line}").is_err() || requests.next().is_none() {
                break;
            }
        }
    });
    (folder, ClientOptions::default().root(root).name("test"))
}

fn json(message: &impl serde::Serialize) -> String {
    serde_json::to_string(message).unwrap()
}

fn hello() -> Reply {
    let streams = vec!["events".into()];
    Reply::Hello(Hello { generation: 7, pid: 1, camera: "cam0".into(), width: 4, height: 3, streams })
}

fn status(state: SourceState, degraded: &[&str]) -> Reply {
    Reply::Status(Box::new(Status {
        version: "0".into(),
        pid: 1,
        generation: 7,
        uptime_s: 1.0,
        camera: "cam0".into(),
        width: 4,
        height: 3,
        source: "a test".into(),
        state,
        degraded: degraded.iter().map(|reason| (*reason).into()).collect(),
        bytes: Default::default(),
        events: Default::default(),
        faults: Default::default(),
        triggers: 0,
        packets: 0,
        behind: 0,
        views_missed: 0,
        stream_time_us: 0,
        bytes_per_s: 0.0,
        events_in_per_s: 0.0,
        events_out_per_s: 0.0,
        latency_ns_mean: 0,
        latency_ns_max: 0,
        clients: Vec::new(),
        views: Vec::new(),
    }))
}

#[test]
fn another_version_is_told_before_shared_memory_is_touched() {
    for banner in [
        Banner { abi: Banner::ours().abi + 1, ..Banner::ours() },
        Banner { iceoryx2: "0.9.0".into(), ..Banner::ours() },
    ] {
        let (folder, options) = daemon(vec![json(&banner), json(&hello())]);
        let error = Client::connect(options).unwrap_err();
        assert!(matches!(error, Error::AbiMismatch { .. }), "{error}");
        assert!(error.to_string().contains("same release"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "only the socket");
    }
    // Another build of the same wire is welcome.
    let (_folder, options) =
        daemon(vec![json(&Banner { lobulad: "9.9".into(), ..Banner::ours() }), json(&hello())]);
    assert_eq!(Client::connect(options).unwrap().hello().camera, "cam0");
}

#[test]
fn what_is_not_understood_is_an_error_and_a_hang_up_means_no_daemon() {
    for lines in
        [vec!["garbage".into()], vec!["{}".into()], vec![json(&Banner::ours()), "{\"reply\":\"new\"}".into()]]
    {
        let (_folder, options) = daemon(lines);
        let error = Client::connect(options).unwrap_err();
        assert!(matches!(error, Error::Transport { .. }), "{error}");
    }
    let (_folder, options) = daemon(vec![json(&Banner::ours())]);
    assert!(matches!(Client::connect(options).unwrap_err(), Error::NoDaemon { .. }));
}

#[test]
fn a_camera_that_is_gone_is_told_with_the_reason() {
    let answers =
        [status(SourceState::Playing, &[]), status(SourceState::NoDevice, &["unplugged", "retrying"])];
    let mut lines = vec![json(&Banner::ours()), json(&hello())];
    lines.extend(answers.iter().map(json));
    let (_folder, options) = daemon(lines);
    let client = Client::connect(options).unwrap();
    assert_eq!(client.device().unwrap(), SourceState::Playing);
    assert_eq!(client.device().unwrap_err(), Error::NoDevice { reason: "unplugged; retrying".into() });
    assert!(matches!(client.device().unwrap_err(), Error::NoDaemon { .. }));
}

#[test]
fn an_error_of_the_daemon_has_its_type() {
    let refused = Reply::Error { kind: "no_stream".into(), message: "no".into() };
    let (_folder, options) = daemon(vec![json(&Banner::ours()), json(&hello()), json(&refused)]);
    let client = Client::connect(options).unwrap();
    let error = client.view("voxel", Default::default()).unwrap_err();
    let expected = Error::NoStream { asked: "view/voxel".into(), available: vec!["events".into()] };
    assert_eq!(error, expected);
}
