//! Every error is one sentence with the path, the cause and what to do.

use super::raw_writer;
use lobula_core::wire::Encoding;
use lobula_core::{Event, Fault, Geometry, Polarity, Span};
use lobula_formats::{
    Error, ErrorKind, FORMATS, OpenOptions, Summary, WithDigest, WriteOptions, open, open_with,
};
use lobula_tests::data;
use std::path::{Path, PathBuf};

/// A folder with one file of these bytes.
fn file(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.raw");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// The message without its path, which it must begin with, in the form of one sentence.
fn message(path: &Path, error: &Error) -> String {
    let text = error.to_string();
    let (head, rest) = text.split_once(": ").unwrap();
    assert_eq!(Path::new(head), path);
    assert!(!text.contains('\n') && !text.ends_with('.'), "{text}");
    assert!(rest.contains("; "), "no remedy: {text}");
    rest.to_owned()
}

#[track_caller]
fn check(bytes: &[u8], kind: ErrorKind, expected: &str) {
    let (_folder, path) = file(bytes);
    let error = open(&path).unwrap_err();
    assert_eq!((message(&path, &error).as_str(), error.kind()), (expected, kind));
}

const CONVERT: &str = "convert it to one of these, or give --encoding if it is the bare bytes of a camera";

#[test]
fn content() {
    let known = FORMATS.iter().map(|format| format.name).collect::<Vec<_>>().join(", ");
    check(b"", ErrorKind::Empty, "is empty (0 bytes); record it again or copy it again");
    let text = format!("is text, and no recording of a known format ({known}); {CONVERT}");
    check(b"hello, world\n", ErrorKind::UnknownFormat, &text);
    let binary = format!("is no recording of a known format ({known}); {CONVERT}");
    check(&[0, 1, 2, 0x80], ErrorKind::UnknownFormat, &binary);
    let size = "has the sensor size 1000000x1000000, beyond 8192 pixels a side, at byte 10; give the true size with --sensor-size WxH";
    check(b"% evt 3.0\n% geometry 1000000x1000000\n% end\n", ErrorKind::TooLarge, size);
    let cut = "ends inside its header at byte 20; copy it again from where it was recorded";
    check(b"% evt 3.0\n% geometry", ErrorKind::Malformed, cut);
}

#[test]
fn places() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_owned();
    let error = open(&path).unwrap_err();
    assert_eq!(message(&path, &error), "is a directory; name the recording inside it");
    let error = open("/dev/null").unwrap_err();
    let expected = "is a pipe or a device, not a file; save what comes out of it to a file and open that";
    assert_eq!(message(Path::new("/dev/null"), &error), expected);
    let path = path.join("none");
    let error = open(&path).unwrap_err();
    assert_eq!(
        (message(&path, &error).as_str(), error.kind()),
        ("no such file; check the path", ErrorKind::NotFound)
    );
}

#[test]
fn options_overrule_the_header() {
    let (_folder, path) = file(b"% evt 4.0\n% geometry 1000000x1000000\n% end\n");
    let mut options = OpenOptions::default();
    options.encoding = Some(Encoding::Evt3);
    options.sensor_size = Some(Geometry::new(64, 64));
    let recording = open_with(&path, &options).unwrap();
    assert_eq!((recording.encoding(), recording.geometry()), (options.encoding, options.sensor_size));
}

#[test]
fn bare_bytes_open_with_an_encoding() {
    let Some(whole) = data("evt3_trigger_1280x720.raw") else { return };
    let whole = open(whole).unwrap();
    let mut payload = whole.payload().unwrap();
    let mut bytes = vec![0; (payload.range().end - payload.range().start) as usize];
    assert_eq!(payload.read(&mut bytes).unwrap(), bytes.len());
    let (_folder, path) = file(&bytes);
    let mut options = OpenOptions::default();
    options.encoding = Some(Encoding::Evt3);
    let bare = open_with(&path, &options).unwrap();
    let digest = |recording| Summary::of(recording, WithDigest::Yes).unwrap();
    let (bare_says, whole_says) = (digest(&bare), digest(&whole));
    assert_eq!(bare_says.sha256, whole_says.sha256);
    assert_eq!((bare_says.width, bare_says.height), (None, None), "an unknown size is not guessed");
    let error = bare.sensor_size().unwrap_err();
    assert!(error.remedy().contains("--sensor-size"), "{error}");
}

#[test]
fn bytes_of_another_encoding_are_counted_faults() {
    let Some(path) = data("evt2_gen3_640x480.raw") else { return };
    let mut options = OpenOptions::default();
    options.encoding = Some(Encoding::Evt3);
    let recording = open_with(path, &options).unwrap();
    let summary = Summary::of(&recording, WithDigest::No).unwrap();
    assert!(summary.faults[Fault::UnknownWord.name()] > 1000, "{summary:?}");
    let payload = recording.payload().unwrap().range();
    assert_eq!(summary.bytes_decoded + summary.bytes_faulty, payload.end - payload.start);
}

#[test]
fn a_file_cut_while_it_is_read_is_an_error_after_the_events_before_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.raw");
    let geometry = Geometry::new(1280, 720);
    let mut writer = raw_writer(&path, Encoding::Evt2, geometry, &WriteOptions::default()).unwrap();
    let events: Vec<_> = (0..60_000).map(|t| Event::new(t, 1, 2, Polarity::On)).collect();
    writer.write(Span { t_first: 0, t_last: 59_999, geometry, events: &events }).unwrap();
    writer.finish().unwrap();

    let mut blocks = open(&path).unwrap().blocks();
    let mut seen = blocks.next_block().unwrap().unwrap().block.len();
    std::fs::File::options().write(true).open(&path).unwrap().set_len(100_000).unwrap();
    let error = loop {
        match blocks.next_block() {
            Ok(chunk) => seen += chunk.expect("an error, not an end").block.len(),
            Err(error) => break error,
        }
    };
    assert_eq!(error.kind(), ErrorKind::Changed, "{error}");
    assert!(message(&path, &error).contains("became shorter than the"), "{error}");
    assert!(seen > 10_000, "events before the cut are given: {seen}");
    assert!(blocks.next_block().unwrap().is_none(), "told once");
}
