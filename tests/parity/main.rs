//! Every operation that eventcv has gives what eventcv gives, on two real recordings: integers the same, floats within
//! 1e-5 of max(1, |v|).
//!
//! The other side is the Python package, in an environment that the first run makes; it needs a package index, so it
//! is run on request, as .ci/run does: `cargo test -p lobula-tests --test parity -- --ignored`.
//!
//! To add an operation, add a line to the table of its family: its name, eventcv's call as Python that is given the
//! recording `s` (an `EventStream`) and `ecv`, and ours over the same events. What differs on purpose stands in
//! [`DIFFERENCES`].
#![allow(clippy::unwrap_used)] // helpers of tests may too

mod filters;
mod representations;
mod statistics;
mod transforms;

use lobula_core::{Block, Event, Geometry, SPAN_MAX_US, Span, full_time};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

const PACKAGES: &[&str] = &["numpy==2.4.6", "eventcv==1.0.8"];

/// Real recordings that both sides read with the same events.
const RECORDINGS: &[&str] = &["evt3_gen41_1280x720.raw", "evt2_gen3_640x480.raw"];

/// What eventcv's streams can do and is not compared here, with the reason. Of what is random, only that is compared which
/// does not depend on the generator: always, never, and by nothing.
const DIFFERENCES: &[(&str, &str)] = &[
    ("numpy", "every line compares it"),
    ("save", "files are compared in formats/tests/interop"),
    ("efast harris_corners optical_flow contrast_maximise iwe", "features and motion are not here yet"),
    ("play view save_video draw_mask", "display"),
    ("concat", "streams come one after the other; merging them in order of time is `merge`"),
    (NOT_YET, "not here yet"),
];

const NOT_YET: &str = "pset";

/// An operation of both.
struct Op {
    /// Ours, by its name in settings.
    name: &'static str,
    /// Theirs: a Python expression whose value is an `EventStream`, an `EventFrame` or an array.
    theirs: &'static str,
    /// Ours over the same events.
    ours: fn(&Slice) -> Answer,
}

/// A recording as one slice.
#[derive(Clone)]
struct Slice {
    t_first: u64,
    t_last: u64,
    geometry: Geometry,
    events: Vec<Event>,
}

impl Slice {
    fn open(path: &Path) -> Self {
        let loaded = lobula_formats::open(path).unwrap().load().unwrap();
        let spans: Vec<Span<'_>> = loaded.spans().collect();
        let (first, last) = (spans[0], spans[spans.len() - 1]);
        assert!(last.t_last - first.t_first < SPAN_MAX_US, "{} is too long for one block", path.display());
        Self {
            t_first: first.t_first,
            t_last: last.t_last,
            geometry: first.geometry,
            events: spans.iter().flat_map(|span| span.events).copied().collect(),
        }
    }

    fn span(&self) -> Span<'_> {
        Span { t_first: self.t_first, t_last: self.t_last, geometry: self.geometry, events: &self.events }
    }

    fn block(&mut self) -> Block<'_> {
        Block::new(self.t_first, self.t_last, self.geometry, &mut self.events)
    }

    /// The slice as an answer: x, y, t, p of each event.
    fn answer(&self) -> Answer {
        let row = |event: &Event| {
            let t = full_time(self.t_first, event.t());
            [event.x().into(), event.y().into(), t, event.is_on().into()]
        };
        Answer::Integers(vec![self.events.len(), 4], self.events.iter().flat_map(row).collect())
    }
}

/// What an operation gives: extent and elements, row-major.
#[derive(Debug, PartialEq)]
enum Answer {
    Integers(Vec<usize>, Vec<u64>),
    Floats(Vec<usize>, Vec<f32>),
}

impl Answer {
    /// From what peer.py wrote.
    fn read(shape: Vec<usize>, dtype: &str, bytes: &[u8]) -> Self {
        let integers = |width: usize| {
            bytes
                .chunks_exact(width)
                .map(|word| word.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte)))
                .collect()
        };
        match dtype {
            "uint8" | "bool" => Self::Integers(shape, integers(1)),
            "uint16" => Self::Integers(shape, integers(2)),
            "uint64" | "int64" => Self::Integers(shape, integers(8)),
            "float32" => Self::Floats(shape, f32s(bytes)),
            _ => panic!("no answer is of type {dtype}"),
        }
    }

    /// How `self`, which is ours, differs from theirs, in words.
    fn differs(&self, theirs: &Self) -> Option<String> {
        match (self, theirs) {
            (Self::Integers(shape, ours), Self::Integers(other, theirs)) if shape == other => {
                first_difference(ours, theirs, |a, b| a == b)
            }
            (Self::Floats(shape, ours), Self::Floats(other, theirs)) if shape == other => {
                first_difference(ours, theirs, |a, b| (a - b).abs() <= 1e-5 * b.abs().max(1.0))
            }
            _ => Some(format!("ours is {}, theirs {}", self.kind(), theirs.kind())),
        }
    }

    fn kind(&self) -> String {
        match self {
            Self::Integers(shape, _) => format!("integers {shape:?}"),
            Self::Floats(shape, _) => format!("floats {shape:?}"),
        }
    }
}

fn f32s(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect()
}

fn first_difference<T: Copy + std::fmt::Display>(
    ours: &[T],
    theirs: &[T],
    same: impl Fn(T, T) -> bool,
) -> Option<String> {
    let differ = |at: &usize| !same(ours[*at], theirs[*at]);
    let at = (0..ours.len()).find(differ)?;
    let count = (0..ours.len()).filter(differ).count();
    Some(format!("{count} of {} elements, first at {at}: {} and theirs {}", ours.len(), ours[at], theirs[at]))
}

/// What eventcv gives on one recording.
struct Theirs {
    answers: BTreeMap<String, Answer>,
    /// All that its streams can do.
    methods: Vec<String>,
}

impl Theirs {
    fn run(python: &Path, recording: &Path, size: Geometry, ops: &[&Op]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/peer.py");
        let mut command = Command::new(python);
        command.arg(script).arg(recording).arg(size.to_string()).arg(folder.path());
        command.args(ops.iter().map(|op| format!("{}={}", op.name, op.theirs)));
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let told = String::from_utf8(output.stdout).unwrap();
        let read = |line: &str| {
            let (name, dtype, shape): (String, String, Vec<usize>) = serde_json::from_str(line).unwrap();
            let bytes = std::fs::read(folder.path().join(&name)).unwrap();
            (name, Answer::read(shape, &dtype, &bytes))
        };
        let lines: Vec<_> = told.lines().collect();
        let (methods, answers) = lines.split_last().unwrap();
        Self {
            answers: answers.iter().map(|line| read(line)).collect(),
            methods: serde_json::from_str(methods).unwrap(),
        }
    }
}

fn ops() -> Vec<&'static Op> {
    [filters::OPS, representations::OPS, statistics::OPS, transforms::OPS].into_iter().flatten().collect()
}

#[test]
fn names_are_told_apart() {
    let mut names: Vec<_> = ops().iter().map(|op| op.name).collect();
    names.sort_unstable();
    let all = names.len();
    names.dedup();
    assert_eq!(names.len(), all);
}

#[test]
#[ignore = "makes a Python environment: see the top of the file"]
fn every_operation_gives_what_eventcv_gives() {
    let python = lobula_tests::python(&Path::new(env!("CARGO_TARGET_TMPDIR")).join("eventcv"), PACKAGES);
    let ops = ops();
    let mut wrong = Vec::new();
    for name in RECORDINGS {
        let Some(path) = lobula_tests::data(name) else { return };
        let slice = Slice::open(&path);
        let theirs = Theirs::run(&python, &path, slice.geometry, &ops);
        assert_eq!(theirs.answers.len(), ops.len(), "{name}");
        for op in &ops {
            if let Some(difference) = (op.ours)(&slice).differs(&theirs.answers[op.name]) {
                wrong.push(format!("{name}: {}, {}: {difference}", op.name, op.theirs));
            }
        }
        let told =
            |method: &str| DIFFERENCES.iter().any(|(names, _)| names.split(' ').any(|name| name == method));
        let compared = |method: &str| ops.iter().any(|op| op.theirs.contains(&format!(".{method}(")));
        wrong.extend(theirs.methods.iter().filter(|method| told(method) == compared(method)).map(|method| {
            format!("{method}: stands in {} of the tables", if told(method) { "both" } else { "none" })
        }));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
