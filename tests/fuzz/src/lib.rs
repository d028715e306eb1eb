//! What every fuzz target does: opens a file of these bytes and reads all of it.

use lobula_formats::{Blocks, Error, open};
use std::path::PathBuf;

/// Opens and reads a file whose name ends so. It may be refused; it must not panic, and a slice of all of it holds what
/// a full pass gives.
pub fn read(extension: &str, bytes: &[u8]) {
    let path = path(extension);
    if let Err(error) = std::fs::write(&path, bytes) {
        panic!("{}: {error}", path.display());
    }
    let Ok(recording) = open(&path) else { return };
    let (events, error) = count(&mut recording.blocks());
    match recording.slice_time(0..u64::MAX) {
        Ok(mut slice) => assert_eq!(count(&mut slice).0, events),
        Err(_) => assert!(error.is_some()),
    }
    recording.imu().for_each(drop);
    recording.frames().for_each(drop);
}

fn count(blocks: &mut Blocks) -> (u64, Option<Error>) {
    let mut events = 0;
    loop {
        match blocks.next_block() {
            Ok(Some(chunk)) => events += chunk.block.len() as u64,
            Ok(None) => return (events, None),
            Err(error) => return (events, Some(error)),
        }
    }
}

/// A file of this process, in memory.
fn path(extension: &str) -> PathBuf {
    PathBuf::from(format!("/dev/shm/lobula-fuzz-{}.{extension}", std::process::id()))
}
