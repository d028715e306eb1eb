//! HDF5: what the file says and does not say, layouts, lengths around chunks.

use super::{events_of, everything};
use lobula_core::{Event, Geometry, Polarity, Span, Trigger};
use lobula_formats::{Compression, ErrorKind, StreamKind, Summary, WithDigest, WriteOptions, Writer, open};
use std::path::Path;

const VGA: Geometry = Geometry::new(640, 480);

fn events(count: u64, start: u64) -> Vec<(u64, Event)> {
    let event = |i: u64| {
        // With small steps back, as cameras' clocks have.
        let t = start + i * 37 + (i * i % 11);
        (
            t,
            Event::new(
                t as u32,
                (i * 7 % 640) as u16,
                (i * 3 % 480) as u16,
                Polarity::from_bit(i as u16 / 3),
            ),
        )
    };
    (0..count).map(event).collect()
}

fn write(path: &Path, geometry: Option<Geometry>, options: &WriteOptions, events: &[(u64, Event)]) {
    let mut writer = Writer::create(path, geometry, options).unwrap();
    for (t, event) in events {
        let geometry = geometry.unwrap_or(VGA);
        writer.write(Span { t_first: *t, t_last: *t, geometry, events: &[*event] }).unwrap();
    }
    assert_eq!(writer.finish().unwrap().events, events.len() as u64);
}

#[test]
fn lengths_around_chunks_in_every_kind() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    for layout in ["lobula", "dsec"] {
        for compression in [Compression::None, Compression::Gzip, Compression::Lz4, Compression::Zstd] {
            // One chunk, two, and more than a node of the tree has.
            for count in [0, 1, 16383, 16384, 16385, 65 * 16384 + 1] {
                if count > 20_000 && compression != Compression::None {
                    continue;
                }
                let mut options = WriteOptions::default();
                options.layout = Some(layout.into());
                (options.compression, options.overwrite) = (Some(compression), true);
                let events = events(count, 5_000_000_000);
                write(&path, Some(VGA), &options, &events);
                let recording = open(&path).unwrap();
                assert_eq!((recording.format().name, recording.geometry()), ("HDF5", Some(VGA)));
                assert!(events_of(&recording) == events, "{layout} {compression:?} {count}");
                let middle = count / 2..count / 2 + 100;
                let slice = everything(recording.slice_events(middle.clone()).unwrap());
                let expected = events.iter().skip(middle.start as usize).take(100);
                assert!(slice.events.iter().map(|(_, event)| event).eq(expected.map(|(_, event)| event)));
            }
        }
    }
}

#[test]
fn an_unknown_size_stays_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    write(&path, None, &WriteOptions::default(), &events(10, 0));
    let recording = open(&path).unwrap();
    assert_eq!(recording.geometry(), None);
    let error = recording.sensor_size().unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NeedsOption);
    assert_eq!(Summary::of(&recording, WithDigest::No).unwrap().off_sensor, 0);
}

#[test]
fn dsec_refuses_what_32_bits_cannot_tell() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    let mut options = WriteOptions::default();
    options.layout = Some("dsec".into());
    let at = |t: u64| (t, Event::new(t as u32, 1, 2, Polarity::On));
    let start = 1_744_227_144_732_712;
    write(&path, Some(VGA), &options, &[at(start), at(start + u64::from(u32::MAX))]);
    let found = events_of(&open(&path).unwrap());
    assert_eq!(found.iter().map(|(t, _)| t - start).collect::<Vec<_>>(), [0, u64::from(u32::MAX)]);
    options.overwrite = true;
    let mut writer = Writer::create(&path, Some(VGA), &options).unwrap();
    for (t, event) in [at(start), at(start + (1 << 32))] {
        writer.write(Span { t_first: t, t_last: t, geometry: VGA, events: &[event] }).unwrap();
    }
    let error = writer.finish().unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Refused);
    assert!(error.to_string().contains("after event 1") && error.remedy().contains("--layout"), "{error}");
}

#[test]
fn layouts_and_compressions_that_are_none_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    let mut options = WriteOptions::default();
    options.layout = Some("e2vid".into());
    let error = Writer::create(&path, None, &options).unwrap_err();
    assert!(error.to_string().contains("called e2vid") && error.remedy().contains("dsec"), "{error}");
    let mut options = WriteOptions::default();
    options.compression = Some(Compression::Bz2);
    let error = Writer::create(&path, None, &options).unwrap_err();
    assert!(error.remedy().contains("none, gzip, lz4, zstd"), "{error}");
}

/// A peer guesses the size from the first and the last million, and drops what is beyond in between without a word.
#[test]
fn no_event_is_lost_where_the_size_is_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    let mut events = events(50_000, 0);
    for (t, event) in &mut events[20_000..30_000] {
        *event = Event::new(*t as u32, 5000, 4000, Polarity::On);
    }
    let mut writer = Writer::create(&path, None, &WriteOptions::default()).unwrap();
    let geometry = Geometry::new(8192, 8192);
    for (t, event) in &events {
        writer.write(Span { t_first: *t, t_last: *t, geometry, events: &[*event] }).unwrap();
    }
    writer.finish().unwrap();
    let recording = open(&path).unwrap();
    assert_eq!(recording.geometry(), None);
    assert!(events_of(&recording) == events);
    assert_eq!(recording.index().unwrap().events(), 50_000);
}

#[test]
fn slices_of_times_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    let mut events = events(100_000, 1_000_000);
    // Three stretches in another order, and one far away.
    events[..60_000].rotate_left(25_000);
    for (t, event) in &mut events[70_000..70_010] {
        *t += 1 << 40;
        *event = Event::new(*t as u32, event.x(), event.y(), event.polarity());
    }
    write(&path, Some(VGA), &WriteOptions::default(), &events);
    for limit in [8 << 20, 64] {
        let mut options = lobula_formats::OpenOptions::default();
        options.limits.index_bytes_max = limit;
        let recording = lobula_formats::open_with(&path, &options).unwrap();
        assert!(events_of(&recording) == events);
        let far = 1 << 40;
        for t in [
            0..1_000_000,
            1_000_000..1_000_001,
            1_500_000..1_533_000,
            0..u64::MAX,
            far..u64::MAX,
            9_000_000..far,
        ] {
            let slice = everything(recording.slice_time(t.clone()).unwrap());
            let expected: Vec<_> =
                events.iter().filter(|(time, _)| t.contains(time)).map(|(_, event)| *event).collect();
            assert!(slice.events.iter().map(|(_, event)| *event).eq(expected), "{t:?}");
        }
    }
}

/// Before and after all events, more at one place than a block has room for, at times in any order.
#[test]
fn triggers_keep_their_place() {
    let folder = tempfile::tempdir().unwrap();
    for (count, compression) in [(0, None), (100, None), (40_000, None), (200_000, Some(Compression::None))] {
        let path = folder.path().join(format!("{count}.h5"));
        let events = events(count, 1_000_000);
        let mut options = WriteOptions::default();
        options.compression = compression;
        let mut writer = Writer::create(&path, Some(VGA), &options).unwrap();
        let mut triggers = Vec::new();
        for ordinal in 0..=count {
            let times = match ordinal {
                16_384 => 200,
                0 | 50 | 8192 | 99_999 => 1,
                _ if ordinal == count => 3,
                _ => u64::from(ordinal % 997 == 3),
            };
            for i in 0..times {
                let t = 1_000_000 + ordinal * 37 + i * 91 % 50;
                let edge = Polarity::from_bit((i + ordinal) as u16);
                let trigger = Trigger { t, ordinal, channel: (i % 3) as u8, edge };
                writer.write_trigger(trigger).unwrap();
                triggers.push(trigger);
            }
            if let Some((t, event)) = events.get(ordinal as usize) {
                let span = Span { t_first: *t, t_last: *t, geometry: VGA, events: &[*event] };
                writer.write(span).unwrap();
            }
        }
        assert_eq!(writer.finish().unwrap().triggers, triggers.len() as u64);
        let recording = open(&path).unwrap();
        assert!(recording.streams().iter().any(|stream| stream.kind == StreamKind::Triggers));
        let all = everything(recording.blocks());
        assert!(all.events == events && all.triggers == triggers, "{count}");
        assert!(
            all.places.iter().map(|place| *place as u64).eq(triggers.iter().map(|trigger| trigger.ordinal))
        );
        assert_eq!(recording.load().unwrap().triggers(), triggers);
        for start in (0..count * 37 + 100_000).step_by(150_001) {
            let t = start + 990_000..start + 1_040_000;
            let slice = everything(recording.slice_time(t.clone()).unwrap());
            let expected = triggers.iter().filter(|trigger| t.contains(&trigger.t));
            assert!(slice.triggers.iter().eq(expected), "{t:?} of {count}");
            let first = start / 37;
            let slice = everything(recording.slice_events(first..first + 5000).unwrap());
            let expected = triggers.iter().filter(|trigger| (first..first + 5000).contains(&trigger.ordinal));
            assert!(slice.triggers.iter().eq(expected), "{first} of {count}");
        }
    }
}
