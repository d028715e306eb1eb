//! Checksums of an archive's members, compared where a pass took every byte of them: a pass from the start to the end,
//! by one cursor or by several pieces. What does not fit is told, and its events are given.

use super::table::{Lane, Table};
use crate::byte_cursor::Bytes as _;
use crate::packed::Source;
use crc32fast::Hasher;
use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of a checksum in an archive.
pub(super) const CRC_BYTES: u64 = 4;
/// Bytes read at once of what is no row.
const READ_BYTES: usize = 4096;

/// A member that is read as rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Checked {
    pub name: String,
    pub crc: u32,
    /// The lanes that it holds, in order.
    pub lanes: Range<usize>,
}

/// Names of the members found not to be what their checksums say.
#[derive(Debug, Default)]
pub(super) struct Damaged(Mutex<BTreeSet<String>>);

impl Damaged {
    pub fn add(&self, name: &str) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned());
    }

    /// In sentences.
    pub fn warnings(&self) -> Vec<String> {
        let names = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let warning = |name: &String| {
            format!("{name} is damaged: it does not fit its checksum, so some of it is wrong")
        };
        names.iter().map(warning).collect()
    }
}

/// A pass: of each piece that is done, the checksum of its part of each lane.
#[derive(Debug)]
struct Pass(Mutex<Vec<Option<Vec<Hasher>>>>);

impl Pass {
    /// A piece is done; the checksums of the whole lanes, if it was the last.
    fn end(&self, piece: usize, lanes: Vec<Hasher>) -> Option<Vec<Hasher>> {
        let mut pieces = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(place) = pieces.get_mut(piece) {
            *place = Some(lanes);
        }
        let all: Vec<_> = pieces.iter().flatten().collect();
        let (first, rest) = all.split_first().filter(|_| all.len() == pieces.len())?;
        let mut whole = (*first).clone();
        for piece in rest {
            whole.iter_mut().zip(*piece).for_each(|(whole, part)| whole.combine(part));
        }
        Some(whole)
    }
}

/// The checksums of one piece of a pass.
#[derive(Debug)]
pub(super) struct Checksums {
    pass: Arc<Pass>,
    piece: usize,
    lanes: Vec<Hasher>,
}

impl Checksums {
    /// For each of `n` pieces.
    pub fn of_pieces(n: usize, table: &Table) -> impl Iterator<Item = Option<Self>> {
        let pass = Arc::new(Pass(Mutex::new(vec![None; n])));
        let (has_any, lanes) = (!table.checked.is_empty(), table.lanes.len());
        (0..n).map(move |piece| {
            has_any.then(|| Self { pass: pass.clone(), piece, lanes: vec![Hasher::new(); lanes] })
        })
    }

    /// Adds the next rows of a lane.
    pub fn add(&mut self, lane: usize, rows: &[u8]) {
        if let Some(hasher) = self.lanes.get_mut(lane) {
            hasher.update(rows);
        }
    }

    /// Adds what stands before the first row.
    pub fn add_head(&mut self, lane: usize, layout: &Lane, source: &mut Source) {
        self.read(lane, source, layout.start.saturating_sub(layout.head_bytes)..layout.start);
    }

    /// Adds what stands after the last of so many rows.
    pub fn add_tail(&mut self, lane: usize, layout: &Lane, rows: u64, source: &mut Source) {
        let end = layout.start.saturating_add(rows.saturating_mul(layout.stride as u64));
        self.read(lane, source, end..layout.tail_end.unwrap_or(u64::MAX));
    }

    fn read(&mut self, lane: usize, source: &mut Source, range: Range<u64>) {
        let (mut at, mut bytes) = (range.start, [0; READ_BYTES]);
        while at < range.end {
            let want = usize::try_from(range.end - at).unwrap_or(usize::MAX).min(READ_BYTES);
            // What cannot be read is no longer what the checksum was made of.
            let Ok(len @ 1..) = source.read_at(at, &mut bytes[..want]) else { return };
            self.add(lane, bytes.get(..len).unwrap_or_default());
            at += len as u64;
        }
    }

    /// The piece is done: how many members do not fit their checksums, if it was the last of its pass.
    pub fn end(self, table: &Table) -> u64 {
        let Some(lanes) = self.pass.end(self.piece, self.lanes) else { return 0 };
        let is_damaged = |one: &&Checked| {
            let mut whole = Hasher::new();
            lanes.get(one.lanes.clone()).unwrap_or_default().iter().for_each(|lane| whole.combine(lane));
            whole.finalize() != one.crc
        };
        let damaged = table.checked.iter().filter(is_damaged);
        damaged.map(|one| table.damaged.add(&one.name)).count() as u64
    }
}
