//! Written files hold the same events, or are refused and not there.

use super::{events_of, everything, raw_writer};
use lobula_core::wire::Encoding;
use lobula_core::{Event, Geometry, Polarity, Span};
use lobula_formats::{Error, ErrorKind, Rebase, Recording, Summary, WithDigest, WriteOptions, Written, open};
use lobula_tests::data;
use std::path::Path;

const HD: Geometry = Geometry::new(1280, 720);

fn copy(from: &Recording, to: &Path, encoding: Encoding, options: &WriteOptions) -> Result<Written, Error> {
    let mut writer = raw_writer(to, encoding, from.sensor_size()?, options)?;
    let mut blocks = from.blocks();
    while let Some(chunk) = blocks.next_block()? {
        writer.write_chunk(&chunk)?;
    }
    writer.finish()
}

fn write_at(
    path: &Path,
    encoding: Encoding,
    times: &[u64],
    options: &WriteOptions,
) -> Result<Written, Error> {
    let mut writer = raw_writer(path, encoding, HD, options)?;
    for t in times {
        let events = [Event::new(*t as u32, 3, 4, Polarity::On)];
        writer.write(Span { t_first: *t, t_last: *t, geometry: HD, events: &events })?;
    }
    writer.finish()
}

fn times(path: &Path) -> Vec<u64> {
    events_of(&open(path).unwrap()).iter().map(|(t, _)| *t).collect()
}

fn names(folder: &Path) -> Vec<String> {
    std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect()
}

#[test]
fn every_sample_in_every_encoding() {
    let folder = tempfile::tempdir().unwrap();
    for file in ["evt2_gen3_640x480.raw", "evt3_gen41_1280x720.raw", "evt3_trigger_1280x720.raw"] {
        let Some(path) = data(file) else { return };
        let from = open(path).unwrap();
        let expected = Summary::of(&from, WithDigest::Yes).unwrap();
        let triggers = everything(from.blocks()).triggers;
        for encoding in Encoding::ALL.iter().copied() {
            let path = folder.path().join(format!("{encoding}-{file}"));
            let written = copy(&from, &path, encoding, &WriteOptions::default()).unwrap();
            let to = open(&path).unwrap();
            let summary = Summary::of(&to, WithDigest::Yes).unwrap();
            assert_eq!(summary.sha256, expected.sha256, "{encoding} {file}");
            assert_eq!((to.encoding(), to.geometry()), (Some(encoding), from.geometry()));
            assert_eq!((written.events, written.bytes), (summary.events, summary.bytes));
            assert_eq!(everything(to.blocks()).triggers, triggers, "{encoding} {file}");
            assert_eq!(written.triggers, triggers.len() as u64);
            assert_eq!(summary.bytes_faulty, 0);
        }
    }
}

#[test]
fn silence_of_hours_and_starts_up_to_2_to_the_40() {
    let folder = tempfile::tempdir().unwrap();
    const HOUR: u64 = 3_600_000_000;
    for start in [0, 1 << 24, 1 << 34, 1 << 39, (1 << 40) - 1] {
        let expected = [0, 1, HOUR, 9 * HOUR, 9 * HOUR + 7, 100 * HOUR].map(|t| start + t);
        for encoding in Encoding::ALL.iter().copied() {
            let path = folder.path().join(format!("{encoding}-{start}"));
            write_at(&path, encoding, &expected, &WriteOptions::default()).unwrap();
            assert_eq!(times(&path), expected, "{encoding}");
        }
    }
}

#[test]
fn epoch_times_are_refused_and_rebased() {
    let folder = tempfile::tempdir().unwrap();
    let epoch = [1_744_227_144_732_712, 1_744_227_144_732_719];
    for encoding in Encoding::ALL.iter().copied() {
        let path = folder.path().join(encoding.name());
        let error = write_at(&path, encoding, &epoch, &WriteOptions::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Refused);
        assert!(error.remedy().contains("--rebase"), "{error}");
        assert_eq!(names(folder.path()), [""; 0], "a refused file is not there");
        for (rebase, expected) in [(Rebase::First, [0, 7]), (Rebase::By(epoch[0] - 5), [5, 12])] {
            let mut options = WriteOptions::default();
            (options.rebase, options.overwrite) = (rebase, true);
            let written = write_at(&path, encoding, &epoch, &options).unwrap();
            assert_eq!(times(&path), expected);
            assert_eq!(written.rebased_us, epoch[0] - expected[0]);
        }
        std::fs::remove_file(path).unwrap();
    }
}

#[test]
fn rebasing_below_zero_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut options = WriteOptions::default();
    options.rebase = Rebase::First;
    let error = write_at(&folder.path().join("a.raw"), Encoding::Evt2, &[100, 99], &options).unwrap_err();
    assert!(error.to_string().contains("99 µs is earlier than the 100 µs to subtract"), "{error}");
}

#[test]
fn every_pixel_of_the_largest_sensor_and_none_beyond() {
    let folder = tempfile::tempdir().unwrap();
    let largest = Geometry::new(2048, 2048);
    let corners = [(0, 0), (2047, 0), (0, 2047), (2047, 2047), (1024, 31)];
    for encoding in Encoding::ALL.iter().copied() {
        let path = folder.path().join(encoding.name());
        let mut writer = raw_writer(&path, encoding, largest, &WriteOptions::default()).unwrap();
        let events = corners.map(|(x, y)| Event::new(5, x, y, Polarity::Off));
        writer.write(Span { t_first: 5, t_last: 5, geometry: largest, events: &events }).unwrap();
        writer.finish().unwrap();
        let found: Vec<_> = events_of(&open(&path).unwrap()).iter().map(|(_, event)| *event).collect();
        assert_eq!(found, events, "{encoding}");

        let error = raw_writer(&path, encoding, Geometry::new(2049, 1), &WriteOptions::default());
        assert_eq!(error.unwrap_err().kind(), ErrorKind::Refused);
    }
}

#[test]
fn an_event_off_the_sensor_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer =
        raw_writer(folder.path().join("a.raw"), Encoding::Evt3, HD, &WriteOptions::default()).unwrap();
    let geometry = Geometry::new(2048, 2048);
    let events = [Event::new(5, 1279, 719, Polarity::Off), Event::new(5, 1280, 0, Polarity::Off)];
    let span = Span { t_first: 5, t_last: 5, geometry, events: &events };
    assert!(writer.write(span.with_events(&events[..1])).is_ok());
    let error = writer.write(span).unwrap_err();
    assert!(error.what().contains("pixel (1280, 0) is off the 1280x720 sensor"), "{error}");
}

#[test]
fn a_file_is_replaced_only_on_request_and_only_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.raw");
    write_at(&path, Encoding::Evt2, &[1], &WriteOptions::default()).unwrap();
    let error = write_at(&path, Encoding::Evt2, &[2], &WriteOptions::default()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Exists);
    assert!(error.remedy().contains("--overwrite"), "{error}");
    let mut options = WriteOptions::default();
    options.overwrite = true;
    drop(raw_writer(&path, Encoding::Evt2, HD, &options).unwrap());
    assert_eq!(times(&path), [1], "the old one stays until the new one is complete");
    write_at(&path, Encoding::Evt2, &[2], &options).unwrap();
    assert_eq!((times(&path), names(folder.path())), (vec![2], vec!["a.raw".to_owned()]));
}

#[test]
fn no_events_make_a_file_that_opens() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("none.raw");
    for encoding in Encoding::ALL.iter().copied() {
        let mut options = WriteOptions::default();
        options.overwrite = true;
        write_at(&path, encoding, &[], &options).unwrap();
        let recording = open(&path).unwrap();
        let slice = everything(recording.slice_time(0..u64::MAX).unwrap());
        assert!(slice.events.is_empty() && slice.triggers.is_empty());
        assert_eq!(recording.index().unwrap().times(), None);
    }
}
