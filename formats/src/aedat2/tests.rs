use super::*;
use crate::{PixelFormat, Recording, open_with};
use lobula_core::Event;

/// A file with this chip and these records.
fn file(chip: &str, records: &[(u32, u32)]) -> (tempfile::TempDir, Recording) {
    let mut bytes = b"#!AER-DAT2.0\r\n# Timestamps tick is 1 us\r\n".to_vec();
    bytes.extend_from_slice(format!("# AEChip: {chip}\r\n").as_bytes());
    for (address, reading) in records {
        bytes.extend_from_slice(&address.to_be_bytes());
        bytes.extend_from_slice(&reading.to_be_bytes());
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.aedat");
    std::fs::write(&path, bytes).unwrap();
    let recording = open_with(&path, &OpenOptions::default()).unwrap();
    (folder, recording)
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
        told.extend(chunk.triggers.iter().map(|one| format!("{} {:?} {}", one.t, one.edge, one.ordinal)));
    }
    told
}

/// Bits as the specification spells them out.
fn davis(y: u32, x: u32, low: u32) -> u32 {
    y << 22 | x << 12 | low
}

const APS: u32 = 1 << 31;
const SIGNAL: u32 = 1 << 10;
const IMU: u32 = APS | 3 << 10;

#[test]
fn davis_events_and_triggers() {
    let records =
        [(davis(259, 345, 1 << 11), 5), (davis(0, 0, 0), 6), (0x403, 7), (0x402, 8), (davis(1, 1, 0), 9)];
    let (_folder, recording) = file("eu.seebetter.ini.chips.davis.Davis346B", &records);
    assert_eq!(recording.geometry(), Some(Geometry::new(346, 260)));
    let expected = ["5 0,0 1", "6 345,259 0", "9 344,258 0", "7 On 2", "8 Off 2"];
    assert_eq!(told(&recording), expected);
}

#[test]
fn dvs128_events_and_triggers() {
    let event = |y: u32, x: u32, off: u32| y << 8 | x << 1 | off;
    let records = [(event(127, 127, 0), 1), (event(0, 3, 1), 2), (0x8000, 3), (1 << 20, 4)];
    let (_folder, recording) = file("ch.unizh.ini.jaer.chip.retina.DVS128", &records);
    assert_eq!(told(&recording), ["1 0,0 1", "2 124,127 0", "3 On 2"]);
    let mut blocks = recording.blocks();
    while blocks.next_block().unwrap().is_some() {}
    assert_eq!(blocks.counters().faults.get(Fault::UnknownWord), 1);
    assert_eq!((blocks.counters().bytes_decoded, blocks.counters().bytes_faulty), (24, 8));
}

/// Long runs take the fast path, and what breaks them the other: both give what a naive reader gives.
#[test]
fn runs_are_as_single_records() {
    let mut state = 0x2545_F491_4F6C_DD1Du64;
    let mut draw = |end: u64| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % end
    };
    let (mut records, mut expected) = (Vec::new(), Vec::new());
    let (mut t, mut epoch) = (4_294_000_000u32, 0u64);
    for i in 0..30_000u32 {
        let step = if draw(900) == 0 { draw(50_000_000) as u32 } else { draw(9) as u32 };
        let after = t.wrapping_add(step);
        epoch += u64::from(after < t) << 32;
        t = after;
        let (x, y, on) = (draw(350) as u32, draw(262) as u32, draw(2) as u32);
        records.push((davis(y, x, on << 11), t));
        if x < 346 && y < 260 {
            expected.push(format!("{} {},{} {on}", epoch + u64::from(t), 345 - x, 259 - y));
        }
        if i % 5_000 == 4_999 {
            records.push((IMU, t));
        }
    }
    let (_folder, recording) = file("Davis346", &records);
    assert!(told(&recording) == expected);
}

/// Seven words a sample: numbers of the MPU-6150's data sheet at 4 g and 500 °/s full scale.
#[test]
fn imu_samples() {
    let word = |which: u32, value: i16| IMU | which << 28 | u32::from(value as u16) << 12;
    let values = [8192, -8192, 4096, 340, 65, -131, 0];
    let whole = (0u32..).zip(values).map(|(which, value)| (word(which, value), 100 + which));
    let mut records: Vec<_> = whole.clone().collect();
    records.insert(3, (davis(1, 1, 0), 101));
    records.extend(whole.clone().take(4)); // cut short: left out
    records.extend(whole.map(|(address, t)| (address, t + 50)));
    let (_folder, recording) = file("Davis240C", &records);
    let samples: Vec<_> = recording.imu().map(Result::unwrap).collect();
    assert_eq!(samples.iter().map(|sample| sample.t).collect::<Vec<_>>(), [100, 150]);
    assert_eq!(samples[0].acceleration, [9.80665, -9.80665, 4.903325]);
    assert_eq!(samples[0].temperature, Some(36.0));
    let degrees = samples[0].rotation.map(f64::to_degrees);
    let expected = [65.0 / 65.5, -2.0, 0.0];
    assert!(degrees.iter().zip(expected).all(|(one, other)| (one - other).abs() < 1e-12), "{degrees:?}");
}

/// All resets, then all signals: exposure starts with the last reset.
#[test]
fn frames_of_a_global_shutter() {
    let pixels = [(10, 100), (11, 100), (10, 101), (11, 101)];
    let mut records = Vec::new();
    for (frame, t) in [(0, 1_000), (1, 9_000)] {
        for (i, (x, y)) in (0..).zip(pixels) {
            records.push((davis(y, x, APS | (900 - frame)), t + i));
        }
        for (i, (x, y)) in (0..).zip(pixels) {
            records.push((davis(y, x, APS | SIGNAL | (100 * i)), t + 500 + i));
        }
    }
    let (_folder, recording) = file("Davis240C", &records);
    let frames: Vec<_> = recording.frames().map(Result::unwrap).collect();
    assert_eq!(frames.len(), 2);
    let Frame { t, exposure, x, y, width, height, format, pixels } = &frames[1];
    assert_eq!((*t, exposure.clone()), (9_003, Some(9_003..9_500)));
    // Raw row 101 is above row 100.
    assert_eq!((*x, *y, *width, *height, *format), (10, 78, 2, 2, PixelFormat::Gray16));
    let levels: Vec<_> = pixels.as_chunks().0.iter().map(|level| u16::from_le_bytes(*level) >> 6).collect();
    assert_eq!(levels, [699, 599, 899, 799]);
}

/// Resets and signals side by side: exposure starts with the first reset.
#[test]
fn frames_of_a_rolling_shutter() {
    let mut records = Vec::new();
    for x in 0..4 {
        records.push((davis(0, x, APS | 512), 100 + 10 * x));
        if x > 0 {
            records.push((davis(0, x - 1, APS | SIGNAL | 12), 105 + 10 * x));
        }
    }
    records.push((davis(0, 3, APS | SIGNAL | 1000), 200));
    let (_folder, recording) = file("Davis240C", &records);
    let frames: Vec<_> = recording.frames().map(Result::unwrap).collect();
    assert_eq!(frames.len(), 1);
    assert_eq!((frames[0].exposure.clone(), frames[0].y), (Some(100..115), 179));
    let levels: Vec<_> =
        frames[0].pixels.as_chunks().0.iter().map(|level| u16::from_le_bytes(*level) >> 6).collect();
    assert_eq!(levels, [500, 500, 500, 0], "darker than the reset is black");
}

#[test]
fn a_chip_of_unknown_size_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.aedat");
    std::fs::write(&path, "#!AER-DAT2.0\r\n# AEChip: some.Chip\r\n12345678").unwrap();
    let error = open_with(&path, &OpenOptions::default()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NeedsOption);
    assert!(error.to_string().contains("some.Chip") && error.remedy().contains("--sensor-size"), "{error}");
    let sensor_size = Some(Geometry::new(346, 260));
    let options = OpenOptions { sensor_size, ..OpenOptions::default() };
    assert_eq!(open_with(&path, &options).unwrap().geometry(), options.sensor_size);
}

/// jAER puts all its preferences into the header.
#[test]
fn long_headers() {
    let preference = "#! <entry key=\"DAVIS240C.AddressedIPotCF\" value=\"false\"/>\r\n".repeat(3000);
    let mut bytes = format!("#!AER-DAT2.0\r\n# AEChip: DAVIS240C\r\n{preference}").into_bytes();
    // A record that begins with `#`.
    bytes.extend_from_slice(&[b'#', 0x40, 0x50, 0, 0, 0, 0, b'\n']);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.aedat");
    std::fs::write(&path, bytes).unwrap();
    let recording = open_with(&path, &OpenOptions::default()).unwrap();
    assert_eq!(recording.fields(), [("AEChip", "DAVIS240C")]);
    assert_eq!(told(&recording).len(), 1);
}
