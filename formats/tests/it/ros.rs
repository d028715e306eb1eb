//! Files of messages: what the samples do not have.

use super::{events_of, everything};
use lobula_core::{Event, Fault, Geometry, Polarity, Span};
use lobula_formats::{
    Compression, ErrorKind, Frame, ImuSample, OpenOptions, PixelFormat, Recording, StreamKind, Summary,
    WithDigest, WriteOptions, Writer, open, open_with,
};
use lobula_tests::data;
use std::path::{Path, PathBuf};

const SENSOR: Geometry = Geometry::new(346, 260);

/// Writes events, with a sample after each thousand and a frame after each ten thousand.
fn write(path: &Path, events: &[(u64, Event)], compression: Compression) -> (Vec<ImuSample>, Vec<Frame>) {
    let mut options = WriteOptions::default();
    (options.compression, options.overwrite) = (Some(compression), true);
    let mut writer = Writer::create(path, Some(SENSOR), &options).unwrap();
    let (mut samples, mut frames) = (Vec::new(), Vec::new());
    for (i, events) in events.chunks(1000).enumerate() {
        for (t, event) in events {
            writer.write(Span { t_first: *t, t_last: *t, geometry: SENSOR, events: &[*event] }).unwrap();
        }
        let t = events.last().unwrap().0;
        let value = i as f64 + 0.125;
        let mut sample = ImuSample::default();
        (sample.t, sample.acceleration, sample.rotation) = (t, [value, -1.5, 9.81], [0.25, value, -3.0]);
        writer.write_imu(&sample).unwrap();
        samples.push(sample);
        if i % 10 == 9 {
            let format = FORMATS[i / 10 % FORMATS.len()];
            let pixels = (0..8 * 6 * format.bytes()).map(|byte| (byte + i) as u8).collect();
            let frame = Frame { t, exposure: None, x: 0, y: 0, width: 8, height: 6, format, pixels };
            writer.write_frame(frame.clone()).unwrap();
            frames.push(frame);
        }
    }
    let written = writer.finish().unwrap();
    assert_eq!((written.imu, written.frames), (samples.len() as u64, frames.len() as u64));
    (samples, frames)
}

const FORMATS: [PixelFormat; 5] =
    [PixelFormat::Gray8, PixelFormat::Gray16, PixelFormat::Bgr8, PixelFormat::Rgb8, PixelFormat::Bgra8];

/// Events of a second or two, times stepping back now and then.
fn events() -> Vec<(u64, Event)> {
    let mut t = 40_000_000u64;
    let step = |i: u64| if i % 50 == 49 { 0 } else { i * i % 47 };
    (0..60_000u64)
        .map(|i| {
            t += step(i);
            let at = t - if i % 50 == 49 { 7 } else { 0 };
            let event = Event::new(
                at as u32,
                (i * 7 % 346) as u16,
                (i * 3 % 260) as u16,
                Polarity::from_bit(i as u16),
            );
            (at, event)
        })
        .collect()
}

const KINDS: [(&str, Compression); 6] = [
    ("none.bag", Compression::None),
    ("bz2.bag", Compression::Bz2),
    ("lz4.bag", Compression::Lz4),
    ("none.mcap", Compression::None),
    ("lz4.mcap", Compression::Lz4),
    ("zstd.mcap", Compression::Zstd),
];

#[test]
fn samples_and_frames_come_back_with_the_events() {
    let folder = tempfile::tempdir().unwrap();
    let events = events();
    for (name, compression) in KINDS {
        let path = folder.path().join(name);
        let (samples, frames) = write(&path, &events, compression);
        let recording = open(&path).unwrap();
        assert_eq!((recording.geometry(), recording.warnings()), (Some(SENSOR), vec![]), "{name}");
        assert!(events_of(&recording) == events, "{name}");
        assert_eq!(recording.imu().collect::<Result<Vec<_>, _>>().unwrap(), samples, "{name}");
        assert_eq!(recording.frames().collect::<Result<Vec<_>, _>>().unwrap(), frames, "{name}");
        let kinds: Vec<_> = recording.streams().iter().map(|stream| stream.kind).collect();
        assert_eq!(kinds, [StreamKind::Events, StreamKind::Imu, StreamKind::Frames], "{name}");
    }
}

/// Windows of a peer lost 98 % of an unsorted bag without a word (research/eventcv.md, D9).
#[test]
fn windows_of_unsorted_files_lose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut draw = 1u64;
    let mut events = events();
    for i in (1..events.len()).rev() {
        draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        // Chunks of the file are out of order too.
        events.swap(i, (draw >> 33) as usize % (i + 1));
    }
    let path = folder.path().join("it.bag");
    write(&path, &events, Compression::Lz4);
    let recording = open(&path).unwrap();
    assert!(events_of(&recording) == events, "file order is kept");
    assert!(Summary::of(&recording, WithDigest::No).unwrap().steps_back > 20_000);
    let (low, high) = (40_000_000, 42_000_000);
    let mut found = 0;
    for start in (low..high).step_by(33_000) {
        let window = everything(recording.slice_time(start..start + 33_000).unwrap()).events;
        let kept: Vec<_> =
            events.iter().filter(|(t, _)| (start..start + 33_000).contains(t)).copied().collect();
        assert!(window == kept, "{start}");
        found += window.len();
    }
    assert_eq!(found, events.len());
}

/// A peer panics on these (research/eventcv.md, C2).
#[test]
fn cut_files_give_what_is_before_the_cut() {
    let folder = tempfile::tempdir().unwrap();
    let events: Vec<_> = events().into_iter().cycle().take(200_000).collect();
    for (name, compression) in KINDS {
        let path = folder.path().join(name);
        write(&path, &events, compression);
        let whole = std::fs::read(&path).unwrap();
        for percent in [5, 50, 90, 99] {
            std::fs::write(&path, &whole[..whole.len() * percent / 100]).unwrap();
            let recording = match open(&path) {
                // Nothing of a packed chunk can be known before its first block is whole.
                Err(error) if percent == 5 && compression != Compression::None => {
                    assert!(error.what().starts_with("holds no message that can be read"), "{error}");
                    continue;
                }
                recording => recording.unwrap(),
            };
            assert!(recording.warnings()[0].starts_with("has no "), "{name}: {:?}", recording.warnings());
            let found = events_of(&recording);
            assert!(events.starts_with(&found), "{name} {percent}");
            // Of a packed chunk, a third of the file here, blocks are whole or lost.
            let lost = if compression == Compression::None { 12 } else { 45 };
            let expected = percent.saturating_sub(lost);
            assert!(found.len() >= events.len() * expected / 100, "{name} {percent}: {}", found.len());
        }
    }
}

/// One bit of a chunk that has a checksum, which only a plain one of a bag has not: the chunk is lost, counted, and no
/// other; also a plain chunk that is too long to be held in memory.
#[test]
fn a_damaged_chunk_costs_that_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let events: Vec<_> = events().into_iter().cycle().take(400_000).collect();
    for (name, compression) in KINDS.into_iter().filter(|(name, _)| *name != "none.bag") {
        let path = folder.path().join(name);
        write(&path, &events, compression);
        let mut bytes = std::fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x10;
        std::fs::write(&path, &bytes).unwrap();
        let summary = Summary::of(&open(&path).unwrap(), WithDigest::No).unwrap();
        if name == "none.mcap" {
            let mut options = OpenOptions::default();
            options.limits.chunk_bytes_max = 100_000;
            let small = open_with(&path, &options).unwrap();
            assert_eq!(Summary::of(&small, WithDigest::No).unwrap(), summary);
        }
        assert_eq!(summary.faults[Fault::Damaged.name()], 1, "{name}: {summary:?}");
        assert!(summary.bytes_faulty > 0);
        let lost = events.len() as u64 - summary.events;
        assert!((1..events.len() as u64 * 3 / 4).contains(&lost), "{name}: {lost} lost");
    }
}

/// A record of a bag.
fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let fields = fields.iter().flat_map(|(name, value)| {
        let len = (name.len() + 1 + value.len()) as u32;
        [&len.to_le_bytes()[..], name.as_bytes(), b"=", value].concat()
    });
    let fields: Vec<u8> = fields.collect();
    [&(fields.len() as u32).to_le_bytes()[..], &fields, &(data.len() as u32).to_le_bytes(), data].concat()
}

/// A bag without index, spelt out: connections by name and type, messages by connection.
fn bag(connections: &[(&str, &str)], messages: &[(u32, Vec<u8>)]) -> (tempfile::TempDir, PathBuf) {
    let mut chunk = Vec::new();
    for (conn, (topic, kind)) in (0u32..).zip(connections) {
        let data = record(&[("topic", topic.as_bytes()), ("type", kind.as_bytes()), ("md5sum", b"*")], &[]);
        let data = &data[4..data.len() - 4];
        let topic = topic.as_bytes();
        chunk.extend(record(&[("op", &[7]), ("conn", &conn.to_le_bytes()), ("topic", topic)], data));
    }
    for (conn, message) in messages {
        let time = [1u8, 0, 0, 0, 0, 0, 0, 0];
        chunk.extend(record(&[("op", &[2]), ("conn", &conn.to_le_bytes()), ("time", &time)], message));
    }
    let zero = [0; 8];
    let mut bytes = b"#ROSBAG V2.0\n".to_vec();
    bytes.extend(record(
        &[("op", &[3]), ("index_pos", &zero), ("conn_count", &zero[..4]), ("chunk_count", &zero[..4])],
        &[b' '; 100],
    ));
    let size = (chunk.len() as u32).to_le_bytes();
    bytes.extend(record(&[("op", &[5]), ("compression", b"none"), ("size", &size)], &chunk));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.bag");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// `std_msgs/Header` of 5 s.
const HEADER: [u8; 16] = [9, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];

/// An EventArray of one event of 5 s and these ns.
fn array(x: u16, ns: u32) -> Vec<u8> {
    let size = [&180u32.to_le_bytes()[..], &240u32.to_le_bytes(), &1u32.to_le_bytes()].concat();
    let event = [&x.to_le_bytes()[..], &[2, 0], &[5, 0, 0, 0], &ns.to_le_bytes(), &[1]].concat();
    [&HEADER[..], &size, &event].concat()
}

/// An EventPacket of ROS 1.
fn packet(seq: u64, encoding: &str, is_bigendian: u8, words: &[u16]) -> Vec<u8> {
    let events: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let length = |len: usize| (len as u32).to_le_bytes();
    [
        &HEADER[..],
        &480u32.to_le_bytes(),
        &640u32.to_le_bytes(),
        &seq.to_le_bytes(),
        &7_000_000u64.to_le_bytes(),
        &length(encoding.len()),
        encoding.as_bytes(),
        &[is_bigendian],
        &length(events.len()),
        &events,
    ]
    .concat()
}

fn told(recording: &Recording) -> Vec<(u64, u16, u16)> {
    events_of(recording).iter().map(|(t, event)| (*t, event.x(), event.y())).collect()
}

const ARRAY: &str = "dvs_msgs/EventArray";
const PACKET: &str = "event_camera_msgs/EventPacket";

#[test]
fn of_several_topics_one_is_chosen() {
    let topics = [
        ("/left/events", ARRAY),
        ("/right/events", "prophesee_event_msgs/EventArray"),
        ("/chatter", "std_msgs/String"),
    ];
    let (_folder, path) = bag(&topics, &[(1, array(11, 1000)), (0, array(10, 2999)), (2, vec![0; 4])]);
    let error = open(&path).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NeedsOption);
    assert!(
        error
            .to_string()
            .ends_with("has 2 topics of events; choose one with --topic: /left/events, /right/events")
    );
    let mut options = OpenOptions::default();
    for (topic, expected) in [("/left/events", (5_000_002, 10, 2)), ("/right/events", (5_000_001, 11, 2))] {
        options.topic = Some(topic.into());
        let recording = open_with(&path, &options).unwrap();
        assert_eq!(told(&recording), [expected]);
        assert_eq!(recording.geometry(), Some(Geometry::new(240, 180)));
    }
    options.topic = Some("/chatter".into());
    let error = open_with(&path, &options).unwrap_err();
    assert!(error.remedy().contains("/left/events, /right/events"), "{error}");
    let (_folder, path) = bag(&[("/chatter", "std_msgs/String")], &[]);
    let error = open(&path).unwrap_err();
    assert!(error.to_string().contains("no topic of events that we read (its topics: /chatter)"), "{error}");
}

#[test]
fn packets_go_on_from_message_to_message() {
    // TIME_HIGH, TIME_LOW, ADDR_Y | ADDR_X, then the same of the next message.
    let messages = [packet(1, "evt3", 0, &[0x8001, 0x6002, 0x0007]), packet(2, "evt3", 0, &[0x2805])];
    let (_folder, path) = bag(&[("/events", PACKET)], &messages.map(|message| (0, message)));
    let recording = open(&path).unwrap();
    assert_eq!(told(&recording), [(4098, 5, 7)]);
    assert_eq!(recording.geometry(), Some(Geometry::new(640, 480)));
    assert!(recording.warnings().iter().all(|warning| !warning.contains("missing")));
}

#[test]
fn missing_messages_are_gaps() {
    let again = [0x2806, 0x8001, 0x6003, 0x0008, 0x2807];
    let messages = [packet(1, "evt3", 0, &[0x8001, 0x6002, 0x0007, 0x2805]), packet(4, "evt3", 0, &again)];
    let (_folder, path) = bag(&[("/events", PACKET)], &messages.map(|message| (0, message)));
    let recording = open(&path).unwrap();
    assert_eq!(told(&recording), [(4098, 5, 7), (4099, 7, 8)], "nothing before time and row are known again");
    assert_eq!(recording.warnings()[1], "2 messages of events are missing by their sequence numbers");
    let summary = Summary::of(&open(&path).unwrap(), WithDigest::No).unwrap();
    assert_eq!(summary.warnings, recording.warnings(), "what shows in the pass is told too");
}

#[test]
fn what_no_decoder_knows_is_refused() {
    for (encoding, is_bigendian, what) in
        [("mono", 0, "encoding \"mono\"; we read evt3"), ("evt3", 1, "big-endian machine")]
    {
        let (_folder, path) =
            bag(&[("/events", PACKET)], &[(0, packet(1, encoding, is_bigendian, &[0x8001]))]);
        let error = open(&path).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Unsupported);
        assert!(error.to_string().contains(what), "{error}");
    }
}

#[test]
fn messages_of_libcaer_begin_at_their_time() {
    let (_folder, path) =
        bag(&[("/events", PACKET)], &[(0, packet(1, "libcaer_cmp", 0, &[0x2003, 0x1004, 0x3805]))]);
    let mut options = OpenOptions::default();
    assert_eq!(told(&open_with(&path, &options).unwrap()), [(7004, 3, 5)]);
    options.time_shift_us = -7000;
    assert_eq!(told(&open_with(&path, &options).unwrap()), [(4, 3, 5)]);
    options.time_shift_us = -8000;
    let error = open_with(&path, &options).unwrap().blocks().next_block().unwrap_err();
    assert!(error.remedy().contains("--time-shift"), "{error}");
}

#[test]
fn messages_that_lie_about_their_events_are_counted() {
    let mut lie = array(1, 0);
    lie[24] = 200;
    let (_folder, path) = bag(&[("/events", ARRAY)], &[(0, array(10, 0)), (0, lie), (0, array(12, 0))]);
    let recording = open(&path).unwrap();
    assert_eq!(told(&recording).iter().map(|one| one.1).collect::<Vec<_>>(), [10, 12]);
    assert_eq!(Summary::of(&recording, WithDigest::No).unwrap().faults["damaged"], 1);
}

#[test]
fn calibration_stands_among_the_fields() {
    let mut info = [&HEADER[..], &180u32.to_le_bytes(), &240u32.to_le_bytes()].concat();
    info.extend([&9u32.to_le_bytes()[..], b"plumb_bob"].concat());
    info.extend(1u32.to_le_bytes());
    (0..31).for_each(|i| info.extend((f64::from(i) / 2.0).to_le_bytes()));
    let topics = [("/dvs/events", ARRAY), ("/dvs/camera_info", "sensor_msgs/CameraInfo")];
    let (_folder, path) = bag(&topics, &[(0, array(1, 0)), (1, info)]);
    let recording = open(&path).unwrap();
    let fields = recording.fields();
    assert!(fields.contains(&("distortion_model", "plumb_bob")), "{fields:?}");
    assert!(fields.contains(&("K", "0.5 1 1.5 2 2.5 3 3.5 4 4.5")), "{fields:?}");
}

#[test]
fn bags_that_are_no_bags_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.bag");
    for (bytes, what) in [
        (&b"#ROSBAG V1.2\n0000"[..], "another version than 2.0"),
        (b"#ROSBAG V2.0\n", "ends inside its header"),
        (b"#ROSBAG V2.0\n\x05\0\0\0\x01\0\0\0a\0\0\0\0", "has no bag header"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let error = open(&path).unwrap_err();
        assert!(error.to_string().contains(what), "{error}");
    }
}

#[test]
fn a_database_with_more_beside_it_is_refused() {
    let Some(sample) = data("rosbag2_evt3_trigger.db3") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.db3");
    std::fs::copy(&sample, &path).unwrap();
    std::fs::write(folder.path().join("it.db3-wal"), "pages").unwrap();
    let error = open(&path).unwrap_err();
    assert!(error.to_string().contains("was not closed"), "{error}");
    std::fs::write(folder.path().join("it.db3-wal"), "").unwrap();
    assert!(open(&path).is_ok(), "an empty one holds nothing");
}

#[test]
fn slices_of_every_container_are_what_a_full_pass_keeps() {
    for name in [
        "rosbag_dvs_msgs.bag",
        "rosbag_dvs_msgs_lz4.bag",
        "mcap_libcaer_cmp_davis346.mcap",
        "rosbag2_evt3_trigger.db3",
    ] {
        let Some(path) = data(name) else { return };
        let recording = open(&path).unwrap();
        let all = everything(recording.blocks());
        let (low, high) = (all.events[0].0, all.events[all.events.len() - 1].0);
        for i in 0..20 {
            let t = low + (high - low) * i / 20;
            let t = t..t + (high - low) / 13;
            let slice = everything(recording.slice_time(t.clone()).unwrap());
            let kept: Vec<_> = all.events.iter().filter(|(time, _)| t.contains(time)).copied().collect();
            assert!(slice.events == kept, "{name} {t:?}");
            let triggers: Vec<_> = all.triggers.iter().filter(|one| t.contains(&one.t)).copied().collect();
            assert_eq!(slice.triggers, triggers, "{name} {t:?}");
        }
        let numbers = 1000..all.events.len() as u64 - 1000;
        let slice = everything(recording.slice_events(numbers.clone()).unwrap());
        assert!(slice.events == all.events[numbers.start as usize..numbers.end as usize], "{name}");
    }
}
