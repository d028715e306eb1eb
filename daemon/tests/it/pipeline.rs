//! One pipeline: what a client of a lossless replay gets is what the offline reader gives, through the same stages.

use crate::stage::{Books, PATIENCE, Stage, recording};
use lobula_client::{Client, Error, SubscribeOptions};
use lobula_core::chain::{Chain, Offline, Spec, View, ViewSpec};
use lobula_core::{Block, Event, Geometry, Transform};
use lobula_formats::Digest;
use std::path::Path;

/// Receives a lossless replay to its end; returns the digest and the number of events.
fn receive(client: &Client, clients: u32) -> (String, u64) {
    let mut events = client.events(SubscribeOptions::default().lossless()).unwrap();
    client.play(clients).unwrap();
    let (mut digest, mut books) = (Digest::default(), Books::default());
    loop {
        let packet = events.recv(PATIENCE).unwrap().gapless().unwrap();
        books.enter(&packet);
        assert!(
            packet.span().events.iter().all(|event| packet.span().geometry.contains(event.x(), event.y()))
        );
        digest.update(packet.span());
        if packet.is_end() {
            assert_eq!(books.joined_at, 0);
            return (digest.finish(), books.delivered);
        }
    }
}

/// The digest of a recording read offline through a chain.
fn offline(path: &Path, filters: &str) -> (String, u64) {
    let recording = lobula_formats::open(path).unwrap();
    let spec: Spec = serde_json::from_str(filters).unwrap();
    let mut chain = Chain::try_new(&spec, recording.sensor_size().unwrap()).unwrap();
    let (mut digest, mut count) = (Digest::default(), 0);
    let mut blocks = recording.blocks();
    while let Some(chunk) = blocks.next_block().unwrap() {
        let span = chunk.span();
        let mut events: Vec<Event> = span.events.to_vec();
        let mut block = Block::new(span.t_first, span.t_last, span.geometry, &mut events);
        count += chain.apply(&mut block).unwrap() as u64;
        digest.update(block.span());
    }
    (digest.finish(), count)
}

/// With a transform among them, so that packets and views are of another sensor than the camera's.
const FILTERS: &str = r#"[{ "kind": "refractory", "dt_us": 500 },
    { "kind": "rotate90", "k": 1 },
    { "kind": "background_activity", "dt_us": 5000, "neighbours": "eight" },
    { "kind": "resize", "width": 50, "height": 31 }]"#;
const FILTERS_TOML: &str = "[[filter]]\nkind = \"refractory\"\ndt_us = 500\n\
    [[filter]]\nkind = \"rotate90\"\nk = 1\n\
    [[filter]]\nkind = \"background_activity\"\ndt_us = 5000\nneighbours = \"eight\"\n\
    [[filter]]\nkind = \"resize\"\nwidth = 50\nheight = 31\n";

fn lossless(path: &Path) -> String {
    format!("[camera]\nsource = {{ kind = \"file\", path = \"{}\", lossless = true }}\n", path.display())
}

#[test]
fn a_real_recording_arrives_whole() {
    let Some(path) = lobula_tests::data("evt3_gen41_1280x720.raw") else { return };
    let stage = Stage::new();
    let daemon = stage.daemon(&lossless(&path));
    let (digest, events) = receive(&stage.client(), 1);
    assert_eq!(events, 219_596);
    assert_eq!(digest, "9bba5ca48301878102200069a89413a3240eaae3ff599d217f1c1a84d13fe7ba");
    daemon.stop();
    daemon.join();
    assert!(!stage.root().path().exists(), "nothing is left behind");
}

#[test]
fn two_clients_get_the_same_as_the_offline_reader_through_filters() {
    let stage = Stage::new();
    let path = stage.path("scene.raw");
    recording(&path, 200_000);
    let (expected, count) = offline(&path, FILTERS);
    assert!(count > 10_000 && count < 200_000);
    let daemon = stage.daemon(&(lossless(&path) + FILTERS_TOML));
    let results: Vec<_> = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..2).map(|_| scope.spawn(|| receive(&stage.client(), 2))).collect();
        handles.into_iter().map(|handle| handle.join().unwrap()).collect()
    });
    assert_eq!(results, [(expected.clone(), count), (expected, count)]);
    let again = stage.client().play(1).unwrap_err();
    assert!(matches!(again, Error::Refused { .. }), "{again}");
    daemon.stop();
    daemon.join();
}

#[test]
fn views_are_the_same_bytes_as_offline() {
    let stage = Stage::new();
    let path = stage.path("scene.raw");
    recording(&path, 100_000);
    let specs: Vec<ViewSpec> = serde_json::from_str(
        r#"[{ "name": "surface", "kind": "time_surface", "period_us": 7000 },
            { "name": "voxel", "kind": "voxel_grid", "period_us": 10000, "bins": 3 },
            { "name": "count", "kind": "count", "period_us": 1000 },
            { "name": "sum", "kind": "count", "period_us": 8000, "stride_us": 2000 },
            { "name": "anew", "kind": "voxel_grid", "period_us": 8000, "stride_us": 4000 }]"#,
    )
    .unwrap();
    let expected: Vec<_> = specs.iter().map(|spec| offline_view(&path, spec)).collect();
    let views = "[[view]]\nname = \"surface\"\nkind = \"time_surface\"\nperiod_us = 7000\n\
        [[view]]\nname = \"voxel\"\nkind = \"voxel_grid\"\nperiod_us = 10000\nbins = 3\n\
        [[view]]\nname = \"count\"\nkind = \"count\"\nperiod_us = 1000\n\
        [[view]]\nname = \"sum\"\nkind = \"count\"\nperiod_us = 8000\nstride_us = 2000\n\
        [[view]]\nname = \"anew\"\nkind = \"voxel_grid\"\nperiod_us = 8000\nstride_us = 4000\n";
    let daemon = stage.daemon(&(lossless(&path) + FILTERS_TOML + views));
    let clients = specs.len() as u32;
    let received: Vec<_> = std::thread::scope(|scope| {
        let of = |spec: &ViewSpec| {
            let (stage, name) = (&stage, spec.name.clone());
            scope.spawn(move || receive_view(&stage.client(), &name, clients))
        };
        let handles: Vec<_> = specs.iter().map(of).collect();
        handles.into_iter().map(|handle| handle.join().unwrap()).collect()
    });
    for ((spec, expected), received) in specs.iter().zip(&expected).zip(&received) {
        assert_eq!(received.len(), expected.len(), "{}", spec.name);
        assert!(received == expected, "{}", spec.name);
    }
    daemon.stop();
    daemon.join();
}

type Windows = Vec<((u64, u64, u64), Vec<u8>)>;

fn offline_view(path: &Path, spec: &ViewSpec) -> Windows {
    let recording = lobula_formats::open(path).unwrap();
    let geometry = recording.sensor_size().unwrap();
    let filters: Spec = serde_json::from_str(FILTERS).unwrap();
    let mut chain = Chain::try_new(&filters, geometry).unwrap();
    let mut view = View::try_new(spec, chain.output_geometry()).unwrap();
    assert_eq!(chain.output_geometry(), Geometry::new(50, 31));
    let mut windows = Vec::new();
    let mut canvas = Offline::new(view.len_bytes(), |closed, bytes: &[u8]| {
        windows.push(((closed.window.t0, closed.window.t1, closed.events), bytes.to_vec()));
    });
    let mut blocks = recording.blocks();
    let mut now = 0;
    while let Some(chunk) = blocks.next_block().unwrap() {
        let span = chunk.span();
        let mut events: Vec<Event> = span.events.to_vec();
        let mut block = Block::new(span.t_first, span.t_last, span.geometry, &mut events);
        chain.apply(&mut block).unwrap();
        view.push(block.span(), &mut canvas).unwrap();
        now = span.t_last;
    }
    view.finish(now, &mut canvas).unwrap();
    windows
}

fn receive_view(client: &Client, name: &str, clients: u32) -> Windows {
    let mut view = client.view(name, SubscribeOptions::default().lossless()).unwrap();
    client.play(clients).unwrap();
    let mut windows = Vec::new();
    loop {
        let tensor = view.recv(PATIENCE).unwrap();
        let header = tensor.header();
        assert_eq!((tensor.lost_before(), header.sequence), (0, windows.len() as u64));
        windows.push(((header.t0, header.t1, header.events), tensor.bytes().to_vec()));
        if tensor.is_end() {
            return windows;
        }
    }
}

#[test]
fn a_live_camera_is_seen_by_all_kinds_of_clients() {
    let stage = Stage::new();
    let daemon = stage.daemon(
        "[camera]\nname = \"front\"\nsource = { kind = \"synthetic\", rate_evs = 100000, geometry = { width = 64, height = 48 } }\n\
         [[view]]\nname = \"count\"\nkind = \"count\"\nperiod_us = 5000\n",
    );
    let client = stage.client();
    assert_eq!(client.hello().camera, "front");
    assert_eq!(client.hello().streams, ["events", "view/count"]);
    let error = client.view("counts", SubscribeOptions::default()).unwrap_err();
    assert!(error.to_string().contains("view/count"), "{error}");
    let error = client.events(SubscribeOptions::default().lossless()).unwrap_err();
    assert!(matches!(error, Error::NoStream { .. }), "{error}");

    let mut sleeping = client.events(SubscribeOptions::default()).unwrap();
    let mut polling = client.events(SubscribeOptions::default().poll()).unwrap();
    let mut view = client.view("count", SubscribeOptions::default()).unwrap();
    for subscriber in [&mut sleeping, &mut polling] {
        let mut books = Books::default();
        while books.delivered < 1000 {
            books.enter(&subscriber.recv(PATIENCE).unwrap());
        }
    }
    let tensor = view.recv(PATIENCE).unwrap();
    assert_eq!((tensor.bytes().len(), tensor.header().t1 - tensor.header().t0), (64 * 48, 5000));
    assert_eq!(view.info().unwrap().shape, [1, 48, 64]);

    // Four packets may be held, no more.
    let mut held = Vec::new();
    let error = loop {
        match sleeping.recv(PATIENCE) {
            Ok(packet) => held.push(packet),
            Err(error) => break error,
        }
    };
    assert_eq!((held.len(), error), (4, Error::HeldTooMany { max: 4 }));
    drop(held);

    let status = client.status().unwrap();
    assert!(status.bytes.is_exact() && status.events.is_exact(), "{status:?}");
    assert!(status.events.published > 1000 && status.degraded.is_empty());
    assert_eq!(status.clients[0].streams, ["events", "events", "view/count"]);
    client.stop().unwrap();
    daemon.join();
    let end = loop {
        match sleeping.recv(PATIENCE) {
            Ok(packet) if packet.is_end() => break packet,
            Ok(_) => {}
            Err(error) => panic!("{error}"),
        }
    };
    assert!(end.header().events.is_exact());
}
