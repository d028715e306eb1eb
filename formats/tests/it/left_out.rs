//! What a file does not hold of what was given is counted: no part of a side item is lost without a word.

use super::conversion::TARGETS;
use super::everything;
use lobula_core::{Event, Geometry, Polarity, Span, Trigger};
use lobula_formats::{Frame, ImuSample, LeftOut, PixelFormat, Recording, WriteOptions, Writer, open};
use std::path::Path;

/// Of the two layouts of AEDAT 2.0, of which one has no place for samples.
const SENSORS: [Geometry; 2] = [Geometry::new(240, 180), Geometry::new(128, 128)];

/// An event, and side items with and without each of their parts.
fn given() -> (Vec<Trigger>, Vec<ImuSample>, Vec<Frame>) {
    let edges = [(0, Polarity::On), (0, Polarity::Off), (1, Polarity::On), (1, Polarity::Off)];
    let triggers = edges.map(|(channel, edge)| Trigger { t: 20, ordinal: 1, channel, edge }).to_vec();
    let sample =
        |magnetic_field, temperature| ImuSample { t: 30, magnetic_field, temperature, ..Default::default() };
    let field = Some([1.0, -2.0, 3.0]);
    let samples =
        vec![sample(None, None), sample(field, None), sample(None, Some(30.0)), sample(field, Some(30.0))];
    let frame = |exposure, x, y| {
        let (width, height, format) = (2, 1, PixelFormat::Gray8);
        Frame { t: 40, exposure, x, y, width, height, format, pixels: vec![1, 2] }
    };
    let frames =
        vec![frame(None, 0, 0), frame(Some(35..45), 0, 0), frame(None, 3, 0), frame(Some(35..45), 0, 4)];
    (triggers, samples, frames)
}

/// Writes what is given; what is left out by its count.
fn write(path: &Path, geometry: Geometry, set: fn(&mut WriteOptions)) -> LeftOut {
    let mut options = WriteOptions::default();
    options.overwrite = true;
    set(&mut options);
    let mut writer = Writer::create(path, Some(geometry), &options).unwrap();
    let events = [Event::new(10, 1, 1, Polarity::On)];
    writer.write(Span { t_first: 10, t_last: 10, geometry, events: &events }).unwrap();
    let (triggers, samples, frames) = given();
    triggers.iter().for_each(|trigger| writer.write_trigger(*trigger).unwrap());
    samples.iter().for_each(|sample| writer.write_imu(sample).unwrap());
    frames.into_iter().for_each(|frame| writer.write_frame(frame).unwrap());
    writer.finish().unwrap().left_out
}

/// How many triggers, samples, frames there are, and of how many each part is told.
fn parts(triggers: &[Trigger], samples: &[ImuSample], frames: &[Frame]) -> [u64; 7] {
    let counts = [
        triggers.len(),
        samples.len(),
        frames.len(),
        samples.iter().filter(|sample| sample.magnetic_field.is_some()).count(),
        samples.iter().filter(|sample| sample.temperature.is_some()).count(),
        frames.iter().filter(|frame| frame.exposure.is_some()).count(),
        frames.iter().filter(|frame| (frame.x, frame.y) != (0, 0)).count(),
    ];
    counts.map(|count| count as u64)
}

fn held(recording: &Recording) -> [u64; 7] {
    let samples: Vec<_> = recording.imu().map(Result::unwrap).collect();
    let frames: Vec<_> = recording.frames().map(Result::unwrap).collect();
    parts(&everything(recording.blocks()).triggers, &samples, &frames)
}

#[test]
fn what_a_file_does_not_hold_is_counted() {
    let folder = tempfile::tempdir().unwrap();
    let (triggers, samples, frames) = given();
    let given = parts(&triggers, &samples, &frames);
    for (target, geometry) in TARGETS.iter().flat_map(|target| SENSORS.map(|sensor| (target, sensor))) {
        let path = folder.path().join(target.name);
        let left_out = write(&path, geometry, target.set);
        let LeftOut { triggers, imu, frames, magnetic_fields, temperatures, exposures, positions, .. } =
            left_out;
        // The parts of an item that is left out are not counted beside it: all have each part twice.
        let (of_imu, of_frames) = (if imu > 0 { 2 } else { 0 }, if frames > 0 { 2 } else { 0 });
        let unknown = left_out.temperatures_unknown;
        let counted = [
            triggers,
            imu,
            frames,
            magnetic_fields + of_imu,
            (temperatures + of_imu).wrapping_sub(unknown),
            exposures + of_frames,
            positions + of_frames,
        ];
        let held = held(&open(&path).unwrap());
        let lost: Vec<_> = given.iter().zip(held).map(|(given, held)| given.wrapping_sub(held)).collect();
        assert_eq!(counted[..], lost[..], "{} {geometry}: {left_out:?}", target.name);
        assert!([0, 4].contains(&imu) && [0, 4].contains(&frames), "{}: all or none", target.name);
    }
}
