//! The two loops under every transform: one moves all events, one drops those that have no place any more.
//!
//! Both work on events that are one word ([`Event::word`]), which compilers vectorise well.

use crate::vector::in_order;
use crate::{Block, Event, Geometry, WrongGeometry, compact};

/// Time and polarity of a word.
const REST: u64 = 0x8000_0000_FFFF_FFFF;

/// Largest row and column that a word holds.
pub(super) const X_MAX: u64 = 0xFFFF;
pub(super) const Y_MAX: u64 = 0x7FFF;

#[inline(always)]
pub(super) const fn x_of(word: u64) -> u64 {
    word >> 32 & X_MAX
}

#[inline(always)]
pub(super) const fn y_of(word: u64) -> u64 {
    word >> 48 & Y_MAX
}

/// The event at another pixel, at most ([`X_MAX`], [`Y_MAX`]).
#[inline(always)]
pub(super) const fn at(word: u64, x: u64, y: u64) -> u64 {
    word & REST | x << 32 | y << 48
}

/// The event at another time modulo 2^32.
#[inline(always)]
pub(crate) const fn at_time(word: u64, t: u32) -> u64 {
    word & !0xFFFF_FFFF | t as u64
}

/// Moves every event of a block of sensor `from`, which becomes one of sensor `to`. `moved` should own all it computes with:
/// what it borrows is loaded anew for each event, since the compiler cannot tell that events are not it.
#[inline(always)]
pub(crate) fn move_all(
    block: &mut Block<'_>,
    from: Geometry,
    to: Geometry,
    moved: impl Fn(u64) -> u64,
) -> Result<usize, WrongGeometry> {
    from.check(block.geometry)?;
    let events = block.events_mut();
    in_order(
        #[inline(always)]
        move || {
            for event in events {
                *event = Event::from_word(moved(event.word()));
            }
        },
    );
    block.geometry = to;
    Ok(block.len())
}

/// Moves the events of a block of sensor `from`, which becomes one of sensor `to`, and keeps those that `moved` says
/// have a place; with each comes the number of events of the block before it.
#[inline(always)]
pub(crate) fn select(
    block: &mut Block<'_>,
    from: Geometry,
    to: Geometry,
    moved: impl Fn(u64, usize) -> (u64, bool),
) -> Result<usize, WrongGeometry> {
    from.check(block.geometry)?;
    let kept = compact::select(block.events_mut(), moved);
    block.truncate(kept);
    block.geometry = to;
    Ok(kept)
}
