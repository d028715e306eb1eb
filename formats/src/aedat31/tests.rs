use super::*;
use crate::{Check, Recording, Summary, WithDigest, open_with};
use lobula_core::{Event, Fault};

/// A file as the specification spells it out.
fn file(sources: &str, packets: &[Vec<u8>]) -> (tempfile::TempDir, std::path::PathBuf) {
    let mut bytes = b"#!AER-DAT3.1\r\n#Format: RAW\r\n".to_vec();
    bytes.extend(sources.as_bytes());
    bytes.extend(b"#Start-Time: 2016-05-12 16:02:32 (TZ+0200)\r\n#!END-HEADER\r\n");
    packets.iter().for_each(|packet| bytes.extend(packet));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.aedat");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

const DAVIS: &str = "#Source 1: DAVIS240C\r\n#-Source 0: DVS128\r\n";

fn opened(path: &Path, topic: Option<&str>) -> Result<Recording, Error> {
    let options = OpenOptions { topic: topic.map(str::to_owned), ..OpenOptions::default() };
    open_with(path, &options)
}

fn packet(number: i16, source: i16, time: i32, overflow: i32, events: &[Vec<u8>]) -> Vec<u8> {
    let count = events.len() as i32;
    let mut bytes = [number.to_le_bytes(), source.to_le_bytes()].concat();
    for word in [events[0].len() as i32, time, overflow, count, count, count] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(events.concat());
    bytes
}

fn pair(data: u32, t: i32) -> Vec<u8> {
    [data.to_le_bytes(), t.to_le_bytes()].concat()
}

fn polarity(x: u32, y: u32, on: u32, t: i32) -> Vec<u8> {
    pair(x << 17 | y << 2 | on << 1 | 1, t)
}

/// Events and triggers as text.
fn told(recording: &Recording) -> Vec<String> {
    let (mut told, mut blocks) = (Vec::new(), recording.blocks());
    while let Some(chunk) = blocks.next_block().unwrap() {
        let span = chunk.span();
        let event = |event: &Event| {
            format!("{} {},{} {}", span.time(*event), event.x(), event.y(), u8::from(event.is_on()))
        };
        told.extend(span.events.iter().map(event));
        told.extend(
            chunk
                .triggers
                .iter()
                .map(|one| format!("{} {} {:?} {}", one.t, one.channel, one.edge, one.ordinal)),
        );
    }
    told
}

#[test]
fn events_and_triggers() {
    let invalid = pair(7 << 17 | 7 << 2, 12);
    let packets = [
        packet(
            1,
            1,
            4,
            0,
            &[polarity(3, 4, 1, 10), invalid, polarity(239, 179, 0, 13), polarity(240, 0, 0, 14)],
        ),
        packet(0, 1, 4, 0, &[pair(2 << 1 | 1, 15), pair(1, 16), pair(7 << 1 | 1, 17), pair(14 << 1 | 1, 18)]),
        packet(1, 1, 4, 1, &[polarity(5, 6, 1, 1)]),
        packet(7, 1, 4, 1, &[vec![0; 12]]),
        packet(1, 9, 4, 1, &[polarity(5, 6, 1, 1)]),
    ];
    let (_folder, path) = file(&format!("{DAVIS}#Source 9: Other\r\n"), &packets);
    let recording = opened(&path, Some("DAVIS240C")).unwrap();
    assert_eq!(recording.geometry(), Some(Geometry::new(240, 180)));
    let expected = ["10 3,4 1", "13 239,179 0", "2147483649 5,6 1", "15 0 On 2", "17 1 Off 2"];
    assert_eq!(told(&recording), expected);
    let mut blocks = recording.blocks();
    while blocks.next_block().unwrap().is_some() {}
    assert_eq!((blocks.counters().off_sensor, blocks.counters().bytes_faulty), (1, 0));
    assert_eq!(blocks.counters().marked_invalid, 1);
}

/// An event, a trigger, a sample and a frame: what was taken out is told, and is no damage.
#[test]
fn what_is_marked_invalid_is_told() {
    let invalid_frame = |mut frame: Vec<u8>| {
        frame[0] &= !1;
        frame
    };
    let packets = [
        packet(1, 1, 4, 0, &[polarity(3, 4, 1, 10), pair(7 << 17, 11)]),
        packet(0, 1, 4, 0, &[pair(2 << 1, 12)]),
        packet(3, 1, 4, 0, &[[pair(0, 13), vec![0; 28]].concat(), [pair(0, 14), vec![0; 28]].concat()]),
        packet(2, 1, 12, 0, &[invalid_frame(frame(1, [1, 1], &[0]))]),
        packet(1, 1, 4, 0, &[polarity(3, 4, 1, 15), pair(7 << 17, 16), pair(7 << 17, 17)]),
    ];
    let (_folder, path) = file(DAVIS, &packets);
    let recording = opened(&path, None).unwrap();
    let expected = [
        "2 samples of the inertial sensor are marked invalid",
        "1 frames are marked invalid",
        "4 events and triggers are marked invalid",
    ];
    for _ in 0..2 {
        let summary = Summary::of(&recording, WithDigest::No).unwrap();
        assert_eq!((summary.events, summary.marked_invalid), (2, 4));
        let check = Check::of(&recording, |_| {});
        assert_eq!((check.events, check.marked_invalid, check.sound), (2, 4, true));
        for warnings in [summary.warnings, check.warnings] {
            let told =
                warnings.iter().zip(expected).filter(|(warning, expected)| warning.starts_with(expected));
            assert_eq!((warnings.len(), told.count()), (3, 3), "{warnings:?}");
        }
    }
    assert_eq!(recording.load().unwrap().counters().marked_invalid, 4);
}

#[test]
fn imu_samples() {
    let numbers =
        |numbers: &[f32]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<_>>();
    let six = [pair(1, 7), numbers(&[1.0, -1.0, 0.5, 90.0, -180.0, 0.0, 31.5])].concat();
    let invalid = [pair(0, 8), numbers(&[0.0; 7])].concat();
    let nine = [pair(1, 9), numbers(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0, 11.0, 12.0, 13.0])].concat();
    let (_folder, path) = file(DAVIS, &[packet(3, 1, 4, 0, &[six, invalid]), packet(4, 1, 4, 2, &[nine])]);
    let recording = opened(&path, None).unwrap();
    let samples: Vec<_> = recording.imu().map(Result::unwrap).collect();
    let pi = std::f64::consts::PI;
    let first = ImuSample {
        t: 7,
        acceleration: [9.80665, -9.80665, 4.903325],
        rotation: [pi / 2.0, -pi, 0.0],
        magnetic_field: None,
        temperature: Some(31.5),
    };
    assert_eq!(samples[0], first);
    assert_eq!((samples[1].t, samples[1].magnetic_field), ((2 << 31) + 9, Some([11.0, 12.0, 13.0])));
    assert_eq!((samples.len(), recording.warnings().len()), (2, 1), "one is invalid");
}

fn frame(channels: i32, [width, height]: [i32; 2], levels: &[u16]) -> Vec<u8> {
    let words = [channels << 1 | 1, 100, 900, 200, 700, width, height, 5, 6];
    let mut bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    bytes.extend(levels.iter().flat_map(|level| level.to_le_bytes()));
    bytes
}

#[test]
fn frames() {
    let gray = frame(1, [2, 1], &[0x1234, 0xFFC0]);
    let colour = frame(4, [1, 1], &[0x1100, 0x2200, 0x3300, 0x4400]);
    let wrong = frame(3, [9, 9], &[0; 4]);
    let packets =
        [packet(2, 1, 12, 0, &[gray]), packet(2, 1, 12, 0, &[colour]), packet(2, 1, 12, 0, &[wrong])];
    let (_folder, path) = file(DAVIS, &packets);
    let recording = opened(&path, None).unwrap();
    let frames: Vec<_> = recording.frames().map(Result::unwrap).collect();
    let expected = Frame {
        t: 200,
        exposure: Some(200..700),
        x: 5,
        y: 6,
        width: 2,
        height: 1,
        format: PixelFormat::Gray16,
        pixels: vec![0x34, 0x12, 0xC0, 0xFF],
    };
    assert_eq!(frames[0], expected);
    assert_eq!(
        (frames[1].format, frames[1].pixels.as_slice()),
        (PixelFormat::Bgra8, &[0x33, 0x22, 0x11, 0x44][..])
    );
    assert_eq!(frames.len(), 2);
    assert!(recording.warnings()[0].starts_with("1 packets of frames"), "{:?}", recording.warnings());
}

#[test]
fn of_several_sources_one_is_named() {
    let sources = "#Source 0: DVS128\r\n#Source 1: DVS128\r\n";
    let packets = [0, 1].map(|source| packet(1, source, 4, 0, &[polarity(1, 1, 1, 10 + i32::from(source))]));
    let (_folder, path) = file(sources, &packets);
    let error = opened(&path, None).unwrap_err();
    assert!(
        error.to_string().contains("2 sources: 0:DVS128, 1:DVS128") && error.remedy().contains("--topic")
    );
    assert_eq!(told(&opened(&path, Some("1")).unwrap()), ["11 1,1 1"]);
    assert_eq!(told(&opened(&path, Some("0:DVS128")).unwrap()), ["10 1,1 1"]);
}

#[test]
fn damage_is_counted_and_the_rest_is_read() {
    let packets = [1, 2, 3, 4].map(|t| packet(1, 1, 4, 0, &vec![polarity(1, 1, 1, t); 10]));
    let (_folder, path) = file(DAVIS, &packets);
    let whole = std::fs::read(&path).unwrap();
    let second = whole.len() - 3 * packets[0].len();
    let mut damaged = whole.clone();
    damaged[second + 4] = 9;
    for (bytes, fault, events) in
        [(&damaged[..], Fault::Damaged, 30), (&whole[..whole.len() - 13], Fault::CutShort, 38)]
    {
        std::fs::write(&path, bytes).unwrap();
        let recording = opened(&path, None).unwrap();
        assert_eq!(told(&recording).len(), events);
        let mut blocks = recording.blocks();
        while blocks.next_block().unwrap().is_some() {}
        assert_eq!((blocks.counters().faults.get(fault), blocks.counters().faults.total()), (1, 1));
    }
}

#[test]
fn other_versions_and_forms_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.aedat");
    for (text, said) in [
        ("#!AER-DAT3.0\r\n#!END-HEADER\r\n", "other than 3.1"),
        ("#!AER-DAT3.1\r\n#Format: PNG\r\n#!END-HEADER\r\n", "the form PNG"),
        ("#!AER-DAT3.1\r\n#Format: RAW\r\n", "without an end"),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = opened(&path, None).unwrap_err();
        assert!(error.to_string().contains(said), "{error}");
    }
}
