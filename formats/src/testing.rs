//! What the tests of tables have in common, as text and in NumPy's files.

use crate::{Error, OpenOptions, Recording, open_with};

/// Opens these bytes as a file.
pub(crate) fn file(bytes: &[u8], options: &OpenOptions) -> Result<Recording, Error> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    std::fs::write(&path, bytes).unwrap();
    open_with(&path, options)
}

/// Size, then every event as `t x y p`, then the number of faults.
pub(crate) fn said(recording: &Recording) -> String {
    let mut blocks = recording.blocks();
    let mut said = recording.geometry().map_or("?".into(), |size| size.to_string());
    while let Some(chunk) = blocks.next_block().unwrap() {
        let span = chunk.span();
        for event in span.events {
            let (t, x, y, p) = (span.time(*event), event.x(), event.y(), u8::from(event.is_on()));
            said += &format!(", {t} {x} {y} {p}");
        }
    }
    match blocks.counters().faults.total() {
        0 => said,
        faults => format!("{said}, {faults} faults"),
    }
}

/// With a unit of time and names of columns, none where they are empty.
pub(crate) fn options(unit: &str, columns: &str) -> OpenOptions {
    OpenOptions { time_unit: unit.parse().ok(), columns: columns.parse().ok(), ..OpenOptions::default() }
}
