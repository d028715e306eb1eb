//! Names of columns in headers, and how our own text and array files tell what their format has no place for.

use crate::{Column, TimeUnit};
use lobula_core::Geometry;

/// What marks the comment in which our files tell it: `lobula: time-unit=us sensor-size=346x260`.
pub(crate) const OWN: &str = "lobula:";

/// The value of a key in such a comment.
pub(crate) fn value<'a>(told: &'a str, key: &str) -> Option<&'a str> {
    told.split_whitespace()
        .filter_map(|part| part.split_once('='))
        .find_map(|(k, value)| (k == key).then_some(value))
}

/// Two sides of a sensor, and nothing after them.
pub(crate) fn size<'a>(mut sides: impl Iterator<Item = &'a str>) -> Option<Geometry> {
    let mut side = || sides.next()?.parse::<u16>().ok().filter(|side| *side > 0);
    let size = Geometry::new(side()?, side()?);
    sides.next().is_none().then_some(size)
}

/// The column of this name, and for t the unit that may stand after it: `t_us`, `t [us]`, `timestamp(ns)`.
pub(crate) fn column(name: &str) -> Option<(Column, Option<TimeUnit>)> {
    let name = name.to_lowercase();
    let name = name.trim_matches(['"', '\'', ' ']);
    match name {
        "x" => return Some((Column::X, None)),
        "y" => return Some((Column::Y, None)),
        "p" | "pol" | "polarity" | "on" => return Some((Column::P, None)),
        _ => {}
    }
    let rest =
        ["timestamps", "timestamp", "times", "time", "ts", "t"].iter().find_map(|t| name.strip_prefix(t))?;
    // `trigger` is no time.
    if rest.starts_with(char::is_alphanumeric) {
        return None;
    }
    match rest.trim_matches(['_', ' ', '[', ']', '(', ')', '/']) {
        "" => Some((Column::T, None)),
        "sec" | "seconds" => Some((Column::T, Some(TimeUnit::Seconds))),
        "µs" | "μs" => Some((Column::T, Some(TimeUnit::Microseconds))),
        unit => unit.parse().ok().map(|unit| (Column::T, Some(unit))),
    }
}
