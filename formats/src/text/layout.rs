//! Which column of a text is what, and in which unit: settled by the text or an option, else asked for.

use super::line::{Separator, comment, polarity};
use super::number::{Decimal, exponent_of_us};
use crate::names::{self, OWN};
use crate::{Column, Columns, Error, ErrorKind, OpenOptions, TimeUnit};
use lobula_core::Geometry;
use std::path::Path;

/// How to read a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub separator: Separator,
    /// Fields of a line.
    pub fields: usize,
    /// Which of them, counted from 0, are t, x, y and p.
    pub places: [usize; 4],
    /// By which power of ten times become µs.
    pub power: i32,
}

/// What the start of a text told.
pub(super) struct Findings {
    pub layout: Layout,
    pub size: Option<Geometry>,
    /// Offset of the first line that may be an event.
    pub start: u64,
}

/// What of the layout is known.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    unit: Option<TimeUnit>,
    /// Which field is what, and the number of fields.
    places: Option<([usize; 4], usize)>,
    size: Option<Geometry>,
}

const COLUMNS: [Column; 4] = [Column::T, Column::X, Column::Y, Column::P];

/// Fields of a line where no header tells another number.
const FIELDS: usize = 4;

/// Whether text begins a table of events. The last line of `head` counts only where it is `whole`.
pub(super) fn is_table(head: &[u8], whole: bool) -> bool {
    let (mut numbers, mut others) = (0, 0);
    let mut lines = Lines::new(head).peekable();
    while let Some((_, line)) = lines.next() {
        if lines.peek().is_none() && !whole && !line.ends_with(b"\n") {
            break;
        }
        if let Some(told) = comment(line) {
            if told.starts_with(OWN.as_bytes()) || header(told).is_some() {
                return true;
            }
        } else if !line.trim_ascii().is_empty() {
            if numbers + others == 0 && header(line).is_some() {
                return true;
            }
            let fields: Vec<_> = Separator::of(line).fields(line).collect();
            let is_row = fields.len() >= FIELDS && fields.into_iter().all(is_number);
            *(if is_row { &mut numbers } else { &mut others }) += 1;
        }
    }
    numbers > 0 && numbers >= others
}

fn is_number(field: &[u8]) -> bool {
    Decimal::parse(field).is_some() || polarity(field).is_some()
}

/// Finds the layout of a text that begins with `head`.
pub(super) fn find(head: &[u8], path: &Path, options: &OpenOptions) -> Result<Findings, Error> {
    let mut known = Known::default();
    let mut start = 0;
    let mut size_line = false;
    for (offset, line) in Lines::new(head) {
        start = offset;
        if let Some(told) = comment(line) {
            known.learn_of_comment(told);
        } else if let Some((places, unit)) = header(line) {
            known.places = Some(places);
            known.unit = known.unit.or(unit);
        } else if let Some(size) = size_of_e2vid(line).filter(|_| !size_line && known.places.is_none()) {
            known.size = known.size.or(Some(size));
            size_line = true;
        } else if !line.trim_ascii().is_empty() {
            break;
        }
        start = offset + line.len();
    }
    if size_line && known.places.is_none() {
        known.places = Some((Columns::TXYP.places(), FIELDS));
    }
    known.hear(options);
    let rows = head.get(start..).unwrap_or_default();
    let separator = Lines::new(rows).map(|(_, line)| line).find(|line| comment(line).is_none());
    let separator = Separator::of(separator.unwrap_or(head));
    known.learn_of_rows(rows, separator);
    match known {
        Known { unit: Some(unit), places: Some((places, fields)), size } => {
            let layout = Layout { separator, fields, places, power: exponent_of_us(unit) };
            Ok(Findings { layout, size, start: start as u64 })
        }
        _ => Err(known.ask(path)),
    }
}

impl Known {
    fn learn_of_comment(&mut self, told: &[u8]) {
        let text = String::from_utf8_lossy(told);
        let Some(own) = text.strip_prefix(OWN) else {
            if let Some((places, unit)) = header(told) {
                self.places = Some(places);
                self.unit = self.unit.or(unit);
            }
            return;
        };
        let value = |key| names::value(own, key);
        self.unit = value("time-unit").and_then(|unit| unit.parse().ok()).or(self.unit);
        let columns = value("columns").and_then(|columns| columns.parse::<Columns>().ok());
        self.places = columns.map(|columns| (columns.places(), FIELDS)).or(self.places);
        self.size = value("sensor-size").and_then(|size| names::size(size.split('x'))).or(self.size);
    }

    fn hear(&mut self, options: &OpenOptions) {
        self.unit = options.time_unit.or(self.unit);
        if let Some(columns) = options.columns {
            self.places = Some((columns.places(), FIELDS));
        }
    }

    /// Only times have fractions, and where they do they are in seconds.
    fn learn_of_rows(&mut self, rows: &[u8], separator: Separator) {
        let rows = || Lines::new(rows).map(|(_, line)| line).filter(|line| comment(line).is_none());
        let fields = |line| separator.fields(line).collect::<Vec<_>>();
        let is_fraction = |field: &&[u8]| Decimal::parse(field).is_some_and(Decimal::is_fraction);
        if self.places.is_none() {
            let whole = || rows().map(fields).filter(|row| row.len() == FIELDS);
            let first = whole().any(|row| row.first().is_some_and(is_fraction));
            let is_txyp = |row: &Vec<&[u8]>| match row.as_slice() {
                [_, x, y, p] => [x, y].iter().all(|field| is_plain(field)) && polarity(p).is_some(),
                _ => false,
            };
            // A damaged row here and there does not unsettle it.
            let fits = whole().filter(is_txyp).count();
            if first && fits * 2 > whole().count() {
                self.places = Some((Columns::TXYP.places(), FIELDS));
            }
        }
        let t = self.places.map(|([t, ..], _)| t);
        if self.unit.is_none() {
            let mut times = rows().map(fields).filter_map(|row| match t {
                Some(t) => row.get(t).copied(),
                None => row.into_iter().find(is_fraction),
            });
            self.unit = times.any(|t| is_fraction(&t)).then_some(TimeUnit::Seconds);
        }
    }

    /// What is not known, and the options that tell it.
    fn ask(&self, path: &Path) -> Error {
        let (what, remedy) = match (self.places, self.unit) {
            (None, None) => (
                "does not tell which column is what, nor the unit of its times",
                "give both, such as --columns t,x,y,p --time-unit us",
            ),
            (None, Some(_)) => {
                ("does not tell which column is what", "give their order, such as --columns t,x,y,p")
            }
            (Some(_), _) => (
                "does not tell the unit of its times",
                "give it with --time-unit s, --time-unit ms, --time-unit us or --time-unit ns",
            ),
        };
        Error::new(ErrorKind::NeedsOption, path, what, remedy)
    }
}

impl Columns {
    /// Which columns, counted from 0, are t, x, y and p.
    fn places(self) -> [usize; 4] {
        COLUMNS.map(|column| self.place(column))
    }
}

/// Whether a number is written as an integer.
fn is_plain(field: &[u8]) -> bool {
    !field.is_empty() && field.iter().all(|byte| byte.is_ascii_digit() || *byte == b'-')
}

/// The size in the first line of a text of E2VID: two numbers alone.
fn size_of_e2vid(line: &[u8]) -> Option<Geometry> {
    let text = std::str::from_utf8(line).ok()?;
    names::size(text.split_ascii_whitespace())
}

/// What a header tells: the places of the columns and the number of fields, and the unit if the name of t has one.
type Header = (([usize; 4], usize), Option<TimeUnit>);

/// The names of a header; `None` unless all four columns are among them, once each.
fn header(line: &[u8]) -> Option<Header> {
    let fields: Vec<_> = Separator::of(line)
        .fields(line)
        .map(|field| names::column(&String::from_utf8_lossy(field)))
        .collect();
    // A unit set apart by a space is no column: `t [us] x y p`.
    let place = |column| {
        let mut found = (0..).zip(&fields).filter(|(_, name)| name.is_some_and(|(named, _)| named == column));
        let (place, name) = found.next()?;
        found.next().is_none().then_some((place, name.and_then(|(_, unit)| unit)))
    };
    let [t, x, y, p] = COLUMNS.map(place);
    let ((t, unit), (x, _), (y, _), (p, _)) = (t?, x?, y?, p?);
    Some((([t, x, y, p], fields.len()), unit))
}

/// Lines with their ends, and where they begin.
struct Lines<'a> {
    rest: &'a [u8],
    offset: usize,
}

impl<'a> Lines<'a> {
    /// Without a byte order mark.
    fn new(text: &'a [u8]) -> Self {
        let rest = text.strip_prefix("\u{FEFF}".as_bytes()).unwrap_or(text);
        Self { rest, offset: text.len() - rest.len() }
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let (line, rest) = self.rest.split_at(super::end_of_line(self.rest).unwrap_or(self.rest.len()));
        let offset = self.offset;
        (self.rest, self.offset) = (rest, offset + line.len());
        Some((offset, line))
    }
}
