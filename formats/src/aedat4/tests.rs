use super::*;
use crate::{Compression, Recording, WriteOptions, Writer, open_with};
use lobula_core::Event;
use lobula_core::{Fault, Span, Trigger};
use std::path::{Path, PathBuf};

/// Everything of a recording, as text.
fn told(recording: &Recording) -> Vec<String> {
    let (mut told, mut blocks) = (Vec::new(), recording.blocks());
    while let Some(chunk) = blocks.next_block().unwrap() {
        let span = chunk.span();
        let event = |event: &Event| format!("{} {event:?}", span.time(*event));
        told.extend(span.events.iter().map(event));
        told.extend(chunk.triggers.iter().map(|one| format!("{one:?}")));
    }
    told.extend(recording.imu().map(|sample| format!("{:?}", sample.unwrap())));
    told.extend(recording.frames().map(|frame| format!("{:?}", frame.unwrap())));
    told
}

fn opened(path: &Path, topic: Option<&str>) -> Result<Recording, Error> {
    let options = OpenOptions { topic: topic.map(str::to_owned), ..OpenOptions::default() };
    open_with(path, &options)
}

/// A file of these streams and packets, without a table, as the specification spells it out.
fn file(streams: &str, packets: &[(i32, &[u8])]) -> (tempfile::TempDir, PathBuf) {
    let info = format!("<dv version=\"2.0\"><node name=\"outInfo\" path=\"/outInfo/\">{streams}</node></dv>");
    // Root at 8 after the letters; a vtable of 10 bytes: compression absent, table absent, text at 4.
    let mut header = [12u32.to_le_bytes(), *b"IOHE"].concat();
    header.splice(0..4, 20u32.to_le_bytes());
    header.extend([0, 0, 10, 0, 8, 0, 0, 0, 0, 0, 4, 0]);
    header.extend(10i32.to_le_bytes());
    header.extend(4u32.to_le_bytes());
    header.extend((info.len() as u32).to_le_bytes());
    header.extend(info.as_bytes());
    let mut bytes = b"#!AER-DAT4.0\r\n".to_vec();
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(header);
    for (stream, packet) in packets {
        bytes.extend(stream.to_le_bytes());
        bytes.extend((packet.len() as i32).to_le_bytes());
        bytes.extend(*packet);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.aedat4");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn stream(id: i32, kind: &str, name: &str, source: &str) -> String {
    format!(
        "<node name=\"{id}\" path=\"/outInfo/{id}/\"><attr key=\"typeIdentifier\" type=\"string\">{kind}</attr>\
         <attr key=\"originalOutputName\" type=\"string\">{name}</attr><node name=\"info\" path=\"/outInfo/{id}/info/\">\
         <attr key=\"sizeX\" type=\"int\">346</attr><attr key=\"sizeY\" type=\"int\">260</attr>\
         <attr key=\"source\" type=\"string\">{source}</attr></node></node>"
    )
}

/// A plain packet of events, as DV lays it out.
fn events(events: &[(i64, i16, i16, u8)]) -> Vec<u8> {
    let mut bytes = [[0; 4], 16u32.to_le_bytes(), *b"EVTS"].concat();
    bytes.extend([0, 0, 6, 0, 8, 0, 4, 0, 6, 0, 0, 0, 4, 0, 0, 0]);
    bytes.extend((events.len() as u32).to_le_bytes());
    for (t, x, y, on) in events {
        bytes.extend(t.to_le_bytes());
        bytes.extend(x.to_le_bytes());
        bytes.extend(y.to_le_bytes());
        bytes.extend([*on, 0, 0, 0]);
    }
    let size = bytes.len() as u32 - 4;
    bytes.splice(0..4, size.to_le_bytes());
    bytes
}

#[test]
fn plain_events() {
    let packet =
        events(&[(1_700_000_000_000_000, 3, 4, 1), (1_699_999_999_999_999, 345, 259, 0), (9, 346, 0, 1)]);
    let (_folder, path) = file(&stream(0, "EVTS", "events", "a"), &[(0, &packet), (0, &events(&[]))]);
    let recording = opened(&path, None).unwrap();
    assert_eq!(recording.geometry(), Some(Geometry::new(346, 260)));
    assert_eq!(recording.fields(), [("events", "a")]);
    let told = told(&recording);
    assert!(told[0].starts_with("1700000000000000 ") && told[0].ends_with("x=3 y=4 p=1"), "{told:?}");
    assert!(told[1].starts_with("1699999999999999 ") && told[1].ends_with("x=345 y=259 p=0"), "{told:?}");
    let mut blocks = recording.blocks();
    while blocks.next_block().unwrap().is_some() {}
    assert_eq!((blocks.counters().events, blocks.counters().off_sensor), (3, 1));
    assert_eq!(blocks.position(), recording.bytes());
}

#[test]
fn times_before_0_are_refused() {
    let packet = events(&[(1, 3, 4, 1), (-1, 3, 4, 1)]);
    let (_folder, path) = file(&stream(0, "EVTS", "events", "a"), &[(0, &packet)]);
    let mut blocks = opened(&path, None).unwrap().blocks();
    assert_eq!(blocks.next_block().unwrap().unwrap().block.len(), 1);
    let error = blocks.next_block().unwrap_err();
    assert!(error.remedy().contains("--time-shift") && error.offset().is_some(), "{error}");
}

/// The peer reads the first stream and says nothing (eventcv D19).
#[test]
fn of_several_streams_one_is_named() {
    let streams =
        [(0, "left"), (1, "right"), (2, "right")].map(|(id, name)| stream(id, "EVTS", name, name)).concat();
    let packets = [0, 1, 2].map(|id| events(&[(id, 1, 1, 1)]));
    let (_folder, path) = file(&streams, &[(0, &packets[0]), (2, &packets[2]), (1, &packets[1])]);
    let error = opened(&path, None).unwrap_err();
    assert!(error.to_string().contains("3 streams of events: left, 1:right, 2:right"), "{error}");
    assert!(error.remedy().contains("--topic"), "{error}");
    let error = opened(&path, Some("right")).unwrap_err();
    assert!(error.to_string().contains("called right, but left, 1:right, 2:right"), "{error}");
    for (topic, t) in [("left", "0 "), ("1:right", "1 "), ("2", "2 ")] {
        let told = told(&opened(&path, Some(topic)).unwrap());
        assert!(told.len() == 1 && told[0].starts_with(t), "{topic}: {told:?}");
    }
}

const GEOMETRY: Geometry = Geometry::new(346, 260);

/// Every kind of stream, in the order that it is written.
fn written(path: &Path, compression: Compression) {
    let options = WriteOptions { compression: Some(compression), overwrite: true, ..WriteOptions::default() };
    let mut writer = Writer::create(path, Some(GEOMETRY), &options).unwrap();
    for i in 0..25_000u64 {
        let t = 1_700_000_000_000_000 + 3 * i;
        let event =
            Event::new(t as u32, (i % 346) as u16, (i * 7 % 260) as u16, Polarity::from_bit(i as u16 / 3));
        writer.write(Span { t_first: t, t_last: t, geometry: GEOMETRY, events: &[event] }).unwrap();
        if i % 4_000 < 3 {
            let (channel, edge) = ((i % 2 * 6) as u8, Polarity::from_bit(i as u16));
            writer.write_trigger(Trigger { t, ordinal: 0, channel, edge }).unwrap();
        }
        if i % 90 == 7 {
            writer.write_imu(&sample(t, i)).unwrap();
        }
        if i % 7_000 == 9 {
            frames(t).into_iter().for_each(|frame| writer.write_frame(frame).unwrap());
        }
    }
    let written = writer.finish().unwrap();
    assert_eq!((written.events, written.triggers, written.imu, written.frames), (25_000, 21, 278, 16));
}

fn sample(t: u64, i: u64) -> ImuSample {
    let part = |k: u64| f64::from((i + k) as f32 / 64.0);
    ImuSample {
        t,
        acceleration: [0, 1, 2].map(|axis| part(axis) * GRAVITY),
        rotation: [3, 4, 5].map(|axis| part(axis).to_radians()),
        magnetic_field: (i % 180 == 7).then(|| [6, 7, 8].map(part)),
        temperature: (i % 270 == 7).then(|| part(9)),
    }
}

fn frames(t: u64) -> Vec<Frame> {
    let formats = [PixelFormat::Gray8, PixelFormat::Gray16, PixelFormat::Bgr8, PixelFormat::Bgra8];
    let frame = |format: PixelFormat| {
        let pixels = (0..20 * 10 * format.bytes()).map(|i| (i * 31 % 256) as u8).collect();
        let exposure = (format != PixelFormat::Gray16).then_some(t + 5..t + 900);
        Frame { t, exposure, x: 7, y: 9, width: 20, height: 10, format, pixels }
    };
    formats.map(frame).to_vec()
}

#[test]
fn every_stream_in_every_compression() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.aedat4");
    let mut before = None;
    for compression in compression::ALL {
        written(&path, compression);
        let recording = opened(&path, None).unwrap();
        let told = told(&recording);
        assert_eq!(told.len(), 25_000 + 21 + 278 + 16);
        let names: Vec<_> = recording.streams().into_iter().map(|stream| stream.name).collect();
        assert_eq!(names, ["events", "triggers", "triggers6", "frames", "imu"]);
        assert!(before.is_none_or(|before| before == told), "{compression:?}");
        let expected: Vec<_> = (0..).map(|k| 7 + 90 * k).take_while(|i| *i < 25_000).collect();
        for (sample_read, i) in recording.imu().zip(expected) {
            let (sample_read, expected) = (sample_read.unwrap(), sample(1_700_000_000_000_000 + 3 * i, i));
            let near =
                |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs());
            assert!(near(sample_read.acceleration, expected.acceleration), "{sample_read:?}");
            assert!(near(sample_read.rotation, expected.rotation), "{sample_read:?}");
            assert_eq!(
                (sample_read.t, sample_read.magnetic_field, sample_read.temperature),
                (expected.t, expected.magnetic_field, expected.temperature)
            );
        }
        let read: Vec<_> = recording.frames().map(Result::unwrap).collect();
        let expected = [9, 7_009, 14_009, 21_009].map(|i| frames(1_700_000_000_000_000 + 3 * i)).concat();
        assert!(read == expected, "{compression:?}");
        before = Some(told);
    }
}

#[test]
fn what_is_not_aedat4_compression_is_refused() {
    let options = WriteOptions { compression: Some(Compression::Gzip), ..WriteOptions::default() };
    let folder = tempfile::tempdir().unwrap();
    let error = Writer::create(folder.path().join("it.aedat4"), Some(GEOMETRY), &options).unwrap_err();
    assert!(error.what().contains("gzip") && error.remedy().contains("lz4-high"), "{error}");
}

/// The peer reads no event and says nothing (eventcv D20).
#[test]
fn a_file_that_is_cut_gives_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.aedat4");
    for compression in compression::ALL {
        written(&path, compression);
        let len = std::fs::metadata(&path).unwrap().len();
        let half = len / 2;
        std::fs::File::options().write(true).open(&path).unwrap().set_len(half).unwrap();
        let mut blocks = opened(&path, None).unwrap().blocks();
        let mut events = 0;
        while let Some(chunk) = blocks.next_block().unwrap() {
            events += chunk.block.len();
        }
        let counters = blocks.counters();
        assert!(events > 8_000, "{compression:?}: {events}");
        assert_eq!(counters.faults.get(Fault::CutShort), 1, "{compression:?}: {counters:?}");
        assert_eq!(counters.faults.total(), 1, "{compression:?}: {counters:?}");
    }
}

#[test]
fn a_damaged_packet_is_counted_and_the_rest_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.aedat4");
    for compression in compression::ALL {
        written(&path, compression);
        let whole = std::fs::read(&path).unwrap();
        let first =
            MAGIC.len() + 4 + u32::from_le_bytes(*whole[MAGIC.len()..].first_chunk().unwrap()) as usize;
        let size = i32::from_le_bytes(*whole[first + 4..].first_chunk().unwrap()) as usize;
        let second = first + 8 + size;
        // The body's marks, and the length of another packet.
        for (at, byte) in [(first + 8, 0xAA), (second + 6, 0x7F)] {
            let mut bytes = whole.clone();
            bytes[at] ^= byte;
            std::fs::write(&path, bytes).unwrap();
            let mut blocks = opened(&path, None).unwrap().blocks();
            let mut events = 0;
            while let Some(chunk) = blocks.next_block().unwrap() {
                events += chunk.block.len();
            }
            let counters = blocks.counters();
            assert!((20_000..25_000).contains(&events) || at > first + 8, "{compression:?}: {events}");
            assert!(events >= 20_000, "{compression:?}: {events}");
            assert_eq!(counters.faults.get(Fault::Damaged), 1, "{compression:?}: {counters:?}");
            assert_eq!(counters.faults.total(), 1, "{compression:?}: {counters:?}");
        }
    }
}
