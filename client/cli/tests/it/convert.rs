//! `lobula convert`, `slice` and `check` on real and on damaged recordings.

use crate::tool::run;
use lobula_tests::data;
use serde_json::Value;
use std::path::Path;

fn json(args: &[&str]) -> Value {
    let output = run(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// What is said of a bad input.
fn refused(args: &[&str]) -> String {
    let (code, text) = crate::tool::failure(&run(args));
    assert_eq!(code, 2, "{text}");
    text
}

fn info(path: &Path) -> Value {
    json(&["info", "--json", "--digest", path.to_str().unwrap()])
}

#[test]
fn a_converted_file_has_the_same_events() {
    let Some(from) = data("evt3_trigger_1280x720.raw") else { return };
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("it.raw");
    let (from, to_text) = (from.to_str().unwrap(), to.to_str().unwrap());
    let told = json(&["convert", from, to_text, "--output-encoding", "evt2", "--json"]);
    let (before, after) = (info(Path::new(from)), info(&to));
    assert_eq!((&after["sha256"], &after["encoding"]), (&before["sha256"], &Value::from("evt2")));
    assert_eq!((&told["events"], &told["triggers"]), (&before["events"], &before["triggers"]));
    let again = refused(&["convert", from, to_text]);
    assert!(again.contains("is there already; give --overwrite"), "{again}");
    let text = String::from_utf8(run(&["convert", from, to_text, "--overwrite"]).stdout).unwrap();
    assert!(text.starts_with("wrote 82 469 events, "), "{text}");
}

/// Events of the whole by polarity and place, to compare parts with.
#[test]
fn parts_are_what_the_options_say() {
    let Some(from) = data("evt3_gen41_1280x720.raw") else { return };
    let whole = info(&from);
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("it.raw");
    let part = |options: &[&str]| {
        let name = if options[0].starts_with("--events") || options[0].starts_with("--t-") {
            "slice"
        } else {
            "convert"
        };
        let files = [name, from.to_str().unwrap(), to.to_str().unwrap(), "--overwrite", "--json"];
        json(&[&files[..], options].concat());
        info(&to)
    };
    let number = |value: &Value| value.as_u64().unwrap();
    assert_eq!(part(&["--polarity", "on"])["events"], whole["on"]);
    assert_eq!(part(&["--events", "100..350"])["events"], 250);
    let first = number(&whole["t_first_us"]);
    let early = part(&["--t-stop", "+2ms"]);
    assert!(number(&early["t_last_us"]) < first + 2000, "{early}");
    let late = part(&["--t-start", &format!("{}", first + 2000)]);
    assert!(number(&late["t_first_us"]) >= first + 2000);
    assert_eq!(number(&early["events"]) + number(&late["events"]), number(&whole["events"]));
    let halves = ["0,0,640x720", "640,0,640x720"].map(|roi| number(&part(&["--roi", roi])["events"]));
    assert_eq!(halves.iter().sum::<u64>(), number(&whole["events"]));
    assert_eq!(part(&["--rebase"])["t_first_us"], 0);
    let files = [from.to_str().unwrap(), to.to_str().unwrap()];
    json(&[&["convert", "--overwrite", "--json", "--rebase"], &files[..]].concat());
    assert_eq!(info(&to)["t_first_us"], 0, "the option takes no file for a number");
    assert_eq!(part(&[&format!("--rebase={}", first - 7)])["t_first_us"], 7);
}

#[test]
fn a_chain_moves_events_in_space_and_time() {
    let Some(from) = data("evt3_trigger_1280x720.raw") else { return };
    let whole = info(&from);
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("it.raw");
    let files = ["convert", from.to_str().unwrap(), to.to_str().unwrap(), "--overwrite", "--json"];
    let through = |chain: &str| (json(&[&files[..], &["--chain", chain]].concat()), info(&to));
    let number = |value: &Value| value.as_u64().unwrap();

    let (_, back) =
        through(r#"[{ "kind": "rotate90", "k": 1 }, { "kind": "flip_x" }, { "kind": "transpose" }]"#);
    assert_eq!((&back["sha256"], &back["width"]), (&whole["sha256"], &whole["width"]));

    let (told, left) = through(r#"[{ "kind": "crop", "x": 0, "y": 0, "width": 640, "height": 720 }]"#);
    assert_eq!((number(&left["width"]), number(&left["height"])), (640, 720));
    assert_eq!(number(&told["events"]) + number(&told["filtered"]), number(&whole["events"]));
    json(&[&files[..], &["--roi", "0,0,640x720"]].concat());
    assert_eq!(left["events"], info(&to)["events"]);

    let first = number(&whole["t_first_us"]);
    let (told, later) = through(r#"[{ "kind": "time_shift", "dt_us": 5000 }]"#);
    assert_eq!(number(&later["t_first_us"]), first + 5000);
    assert_eq!((&later["events"], &later["triggers"]), (&whole["events"], &whole["triggers"]));
    assert_eq!(number(&told["out_of_time"]), 0);

    // Slow motion: what was a second takes hours, far more than one block can span.
    let (_, slow) = through(r#"[{ "kind": "normalize_time" }, { "kind": "time_scale", "factor": 100000 }]"#);
    let last = number(&whole["t_last_us"]) - first;
    assert_eq!((number(&slow["t_first_us"]), number(&slow["t_last_us"])), (0, last * 100_000));
    assert_eq!(slow["events"], whole["events"]);

    let error = refused(
        &[&files[..], &["--chain", r#"[{ "kind": "crop", "x": 0, "y": 0, "width": 0, "height": 1 }]"#]]
            .concat(),
    );
    assert!(error.contains("--chain: filter 0 (crop): no pixel would be left"), "{error}");
}

#[test]
fn a_slice_of_nothing_said_is_refused() {
    let Some(from) = data("evt3_gen41_1280x720.raw") else { return };
    let error = refused(&["slice", from.to_str().unwrap(), "/dev/null/x.raw"]);
    assert!(error.contains("say which part: --t-start and --t-stop, or --events FIRST..END"), "{error}");
    let error = refused(&["convert", from.to_str().unwrap(), "x.unheard"]);
    assert!(
        error.contains("its name ends in that of no format that we write; end the name in one of"),
        "{error}"
    );
}

#[test]
fn check_tells_what_can_be_read() {
    let Some(from) = data("evt2_gen3_640x480.raw") else { return };
    let check = json(&["check", "--json", from.to_str().unwrap()]);
    assert_eq!((&check["sound"], &check["events"]), (&Value::from(true), &info(&from)["events"]));
    let folder = tempfile::tempdir().unwrap();
    let cut = folder.path().join("cut.raw");
    let bytes = std::fs::read(&from).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() - 3]).unwrap();
    let output = run(&["check", cut.to_str().unwrap()]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text.contains("damage       1 bytes (1 cut_short)") && text.contains("not sound"), "{text}");
}
