//! `lobula hot-pixels`, and the list put to use, on a real recording.

use crate::tool::{failure, run};
use lobula_tests::data;
use serde_json::Value;

const RECORDING: &str = "evt2_gen3_640x480.raw";
/// What eventcv 1.0.8 drops of it with `hot_pixel_filter(3)`.
const PIXELS: usize = 9;
const REMOVED: u64 = 7_324;
const EVENTS: u64 = 539_481;

fn json(args: &[&str]) -> Value {
    let output = run(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn they_are_learned_kept_by_serial_number_and_dropped_from_any_slice() {
    let Some(recording) = data(RECORDING) else { return };
    let recording = recording.to_str().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let told = json(&["hot-pixels", recording, folder.path().to_str().unwrap(), "--json"]);
    assert_eq!((&told["pixels"], &told["removed"]), (&PIXELS.into(), &REMOVED.into()));
    assert_eq!((&told["events"], &told["serial"]), (&EVENTS.into(), &"30384338".into()));
    let share = told["share"].as_f64().unwrap();
    assert!((share - REMOVED as f64 / EVENTS as f64).abs() < 1e-12, "{share}");

    let list = folder.path().join("30384338.txt");
    let text = std::fs::read_to_string(&list).unwrap();
    let header = "# lobula hot pixels\n# serial 30384338\n# sensor 640x480\n# sigmas 3\n";
    assert!(text.starts_with(header), "{text}");
    let mut pixels: Vec<_> = text[header.len()..].lines().collect();
    pixels.sort_unstable();
    assert_eq!(pixels, TRUTH);

    let list = list.to_str().unwrap();
    let to = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let whole = json(&["convert", recording, &to("whole.csv"), "--hot-pixels", list, "--json"]);
    assert_eq!((&whole["filtered"], &whole["events"]), (&REMOVED.into(), &(EVENTS - REMOVED).into()));
    // What is learned once holds in two slices as in the whole.
    let slice = |name: &str, events: &str| {
        let slice = ["slice", recording, &to(name), "--events", events, "--hot-pixels", list, "--json"];
        json(&slice)["filtered"].as_u64().unwrap()
    };
    assert_eq!(slice("a.csv", "0..200000") + slice("b.csv", "200000..539481"), REMOVED);
}

#[test]
fn a_list_of_another_camera_and_a_bad_line_are_refused() {
    let Some(recording) = data(RECORDING) else { return };
    let recording = recording.to_str().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("list.txt");
    let list = path.to_str().unwrap();
    let to = folder.path().join("out.csv");
    let refused = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let (code, said) = failure(&run(&["convert", recording, to.to_str().unwrap(), "--hot-pixels", list]));
        assert_eq!(code, 2, "{said}");
        assert!(said.contains(list), "{said}");
        said
    };
    let said = refused("# sensor 1280x720\n1,2\n");
    assert!(said.contains("1280x720") && said.contains("640x480") && said.contains("hot-pixels"), "{said}");
    let said = refused("# serial 7\n# sensor 640x480\n1,2\n");
    assert!(said.contains("camera 7") && said.contains("30384338"), "{said}");
    let said = refused("# sensor 640x480\n1,2\n12\n");
    assert!(said.contains("line 3") && said.contains("12") && said.contains("640,359"), "{said}");
    std::fs::remove_file(&path).unwrap();
    let (_, said) = failure(&run(&["convert", recording, to.to_str().unwrap(), "--hot-pixels", list]));
    assert!(said.contains("no such file"), "{said}");
    let (code, said) = failure(&run(&["hot-pixels", recording, "--sigmas=-1"]));
    assert!(code == 2 && said.contains("3 is usual"), "{said}");
}

/// The pixels that eventcv drops, in the order of their letters.
const TRUTH: [&str; PIXELS] =
    ["123,438", "284,104", "285,389", "348,31", "353,93", "407,169", "482,272", "565,296", "99,37"];
