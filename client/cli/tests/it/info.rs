//! `lobula info`: the truth about real recordings, and what it says of files that are none.

use crate::tool::{failure, run};
use lobula_tests::data;
use serde_json::Value;
use std::path::Path;

fn info(path: &Path) -> Value {
    let output = run(&["info", "--json", "--digest", path.to_str().unwrap()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn real_recordings_give_the_truth() {
    let Some(truth) = data("truth.json") else { return };
    let truth: Value = serde_json::from_slice(&std::fs::read(truth).unwrap()).unwrap();
    let recordings = truth
        .as_object()
        .unwrap()
        .iter()
        .filter(|(name, _)| name.starts_with("evt") && name.ends_with(".raw"));
    let mut seen = 0;
    for (name, truth) in recordings {
        let Some(path) = data(name) else { return };
        let found = info(&path);
        for key in ["events", "on", "off", "t_first_us", "t_last_us", "width", "height", "sha256"] {
            assert_eq!(found[key], truth[key], "{key} of {name}");
        }
        seen += 1;
    }
    assert_eq!(seen, 5);
}

#[test]
fn people_get_the_same_numbers() {
    let Some(path) = data("evt3_gen41_1280x720.raw") else { return };
    let text = String::from_utf8(run(&["info", path.to_str().unwrap()]).stdout).unwrap();
    let events = info(&path)["events"].to_string();
    assert!(text.replace(' ', "").contains(&format!("events{events}(")), "{text}");
    assert!(text.contains("1280x720") && !text.contains("sha256"), "{text}");
}

#[test]
fn bad_files_are_exit_code_2_and_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    };
    let lie = b"% evt 3.0\n% format EVT3\n% geometry 1000000x1000000\n% end\n\0\0\0\0";
    let cases = [
        folder.path().join("missing.raw"),
        folder.path().to_owned(),
        write("empty.raw", b""),
        write("text.txt", b"This is a letter, and nothing else.\n"),
        write("lie.raw", lie),
    ];
    for path in cases {
        for flags in [&["info"][..], &["info", "--json", "--digest"]] {
            let output = run(&[flags, &[path.to_str().unwrap()]].concat());
            let (code, said) = failure(&output);
            assert_eq!(code, 2, "{said}");
            assert!(said.contains(path.to_str().unwrap()), "{said}");
            assert_eq!(said.trim_end().lines().count(), 1, "one line: {said}");
            assert!(said.contains("; "), "what to do: {said}");
        }
    }
}

#[test]
fn wrong_usage_is_exit_code_2() {
    for args in [&["info"][..], &["inform", "x"], &["info", "x", "--sensor-size", "big"]] {
        assert_eq!(failure(&run(args)).0, 2, "{args:?}");
    }
}

#[test]
fn without_a_daemon_clients_say_how_to_start_one() {
    let folder = tempfile::tempdir_in("/dev/shm").unwrap();
    let root = folder.path().join("none");
    for args in [&["status"][..], &["top", "-n", "1"], &["echo", "events"]] {
        let output = crate::tool::lobula().args(args).env("LOBULA_ROOT", &root).output().unwrap();
        let (code, said) = failure(&output);
        assert_eq!(code, 4, "{said}");
        assert!(said.contains("lobula serve"), "{said}");
    }
}
