//! `lobula render` on a real recording.

use crate::tool::{failure, run};
use lobula_tests::data;
use serde_json::Value;
use std::path::Path;

const RECORDING: &str = "evt3_gen41_1280x720.raw";

fn json(args: &[&str]) -> Value {
    let output = run(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// What is said of a bad input.
fn refused(args: &[&str]) -> String {
    let (code, text) = failure(&run(args));
    assert_eq!(code, 2, "{text}");
    text
}

/// Header and data of an .npy file.
fn npy(path: &Path) -> (String, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let len = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert_eq!((10 + len) % 64, 0);
    (String::from_utf8(bytes[10..10 + len].to_vec()).unwrap(), bytes[10 + len..].to_vec())
}

#[test]
fn an_array_holds_every_event_once() {
    let Some(from) = data(RECORDING) else { return };
    let from = from.to_str().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("count.npy");
    let to = path.to_str().unwrap();
    let render = ["render", from, to, "--kind", "count", "--period", "5ms", "--set", "dtype=u16"];
    let told = json(&[&render[..], &["--json"]].concat());
    let (header, data) = npy(&path);
    assert_eq!((&told["windows"], &told["shape"]), (&3.into(), &serde_json::json!([1, 720, 1280])));
    assert!(header.contains("'descr': '<u2'") && header.contains("'shape': (3, 1, 720, 1280)"), "{header}");
    let counts = data.chunks_exact(2).map(|word| u64::from(u16::from_le_bytes([word[0], word[1]])));
    assert_eq!(counts.sum::<u64>(), 219_596, "as truth.json has it");
    let again = refused(&render);
    assert!(again.contains("--overwrite"), "{again}");
    assert!(run(&[&render[..], &["--overwrite"]].concat()).status.success());
}

#[test]
fn windows_that_overlap_hold_every_event_in_each_of_them() {
    let Some(from) = data(RECORDING) else { return };
    let from = from.to_str().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let counts = |name: &str, times: &[&str]| {
        let path = folder.path().join(name);
        let args =
            ["render", from, path.to_str().unwrap(), "--kind", "count", "--set", "dtype=u16", "--json"];
        let told = json(&[&args[..], times].concat());
        assert_eq!((&told["overflowed"], &told["saturated"]), (&0.into(), &0.into()));
        npy(&path).1.chunks_exact(2 * 720 * 1280).map(<[u8]>::to_vec).collect::<Vec<_>>()
    };
    let millisecond = counts("1.npy", &["--period", "1ms"]);
    let sliding = counts("4.npy", &["--period", "4ms", "--stride", "1ms"]);
    assert_eq!(sliding.len(), millisecond.len() - 3);
    let number = |word: &[u8]| u16::from_le_bytes([word[0], word[1]]);
    for (window, strides) in sliding.iter().zip(millisecond.windows(4)) {
        let sum = |at| strides.iter().map(|stride| number(&stride[at..at + 2])).sum::<u16>();
        assert!((0..window.len()).step_by(2).all(|at| number(&window[at..at + 2]) == sum(at)));
    }
}

/// Of 219,596 events, as truth.json has it.
#[test]
fn windows_of_so_many_events_hold_as_many_and_may_overlap() {
    let Some(from) = data(RECORDING) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (array, pictures) = (folder.path().join("a.npy"), folder.path().join("pictures"));
    let to = |path: &Path, options: &[&str]| {
        let args = ["render", from.to_str().unwrap(), path.to_str().unwrap(), "--json", "--kind", "count"];
        json(&[&args[..], &["--slice-events", "40000"], options].concat())["windows"].as_u64().unwrap()
    };
    let counts = |options: &[&str]| {
        let windows = to(&array, &[&["--overwrite", "--set", "dtype=u16"], options].concat());
        let data = npy(&array).1;
        let sum =
            |tensor: &[u8]| tensor.chunks_exact(2).map(|n| u64::from(n[0]) | u64::from(n[1]) << 8).sum();
        let sums: Vec<u64> = data.chunks_exact(2 * 720 * 1280).map(sum).collect();
        assert_eq!(sums.len() as u64, windows);
        sums
    };
    assert_eq!(counts(&[]), [40_000, 40_000, 40_000, 40_000, 40_000, 19_596]);
    let mut overlapping = vec![40_000; 18];
    overlapping.push(39_596);
    assert_eq!(counts(&["--stride-events", "10000"]), overlapping);
    assert_eq!(to(&pictures, &[]), 6);
    assert!(pictures.join("000000000005.png").exists());
}

#[test]
fn pictures_have_the_sensor_s_size_and_show_events() {
    let Some(from) = data(RECORDING) else { return };
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("pictures");
    let args = ["render", from.to_str().unwrap(), to.to_str().unwrap(), "--kind", "time_surface"];
    assert!(run(&[&args[..], &["--period", "5ms", "--t-start", "+1ms"]].concat()).status.success());
    let mut names: Vec<_> = std::fs::read_dir(&to).unwrap().map(|file| file.unwrap().file_name()).collect();
    names.sort();
    // From 11718656 to 11727457 µs, as truth.json has it.
    assert_eq!(names, ["000011715000.png", "000011720000.png", "000011725000.png"]);
    let file = std::io::BufReader::new(std::fs::File::open(to.join(&names[1])).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((frame.width, frame.height), (1280, 720));
    let lit = pixels.chunks_exact(3).filter(|pixel| **pixel != [0, 0, 0]).count();
    assert!((10_000..400_000).contains(&lit), "{lit}");
}

#[test]
fn what_cannot_be_says_what_to_do() {
    let Some(from) = data(RECORDING) else { return };
    let from = from.to_str().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (npy, jpg) = (folder.path().join("a.npy"), folder.path().join("a.jpg"));
    let (npy, jpg) = (npy.to_str().unwrap(), jpg.to_str().unwrap());
    let said = |args: &[&str]| refused(&[&["render", from], args].concat());
    assert!(said(&[npy, "--kind", "cuont"]).contains("`count`"));
    assert!(
        said(&[npy, "--kind", "count", "--set", "bins=3"]).contains("bins means nothing to a count view")
    );
    assert!(said(&[npy, "--kind", "count", "--set", "bisn=3"]).contains("unknown field `bisn`"));
    assert!(said(&[npy, "--kind", "count", "--period", "+1s"]).contains("leave the plus out"));
    let stride = said(&[npy, "--kind", "count", "--period", "5ms", "--stride", "2ms"]);
    assert!(stride.contains("stride_us = 2000 is no stride of windows of 5000 µs"), "{stride}");
    let stride = said(&[npy, "--kind", "count", "--slice-events", "9", "--stride-events", "2"]);
    assert!(stride.contains("stride_events = 2 is no stride of windows of 9 events"), "{stride}");
    assert!(said(&[jpg, "--kind", "count"]).contains("a name that ends in .npy"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left of it");
}
