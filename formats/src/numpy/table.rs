//! Where the four columns of events are.

use super::archive::{self, Member};
use super::checksum::{Checked, Damaged};
use super::dtype::{Dtype, Kind};
use super::header::{self, Elements, Header};
use super::refuse;
use crate::byte_cursor::Bytes as _;
use crate::input::Input;
use crate::names;
use crate::packed::Source;
use crate::{Column, Columns, Error, ErrorKind, OpenOptions, TimeUnit};
use lobula_core::Geometry;
use std::path::Path;
use std::sync::Arc;

/// The events of a file.
#[derive(Debug)]
pub(super) struct Table {
    /// Number of events that the header tells.
    pub rows: u64,
    pub unit: TimeUnit,
    pub lanes: Vec<Lane>,
    /// t, x, y, p.
    pub columns: [Place; 4],
    /// The sensor's size, where the file tells it.
    pub size: Option<Geometry>,
    /// Name of the array; empty where it has none.
    pub name: String,
    /// Names of arrays that are not read.
    pub others: Vec<String>,
    /// The members that it is in, where it is in an archive.
    pub checked: Vec<Checked>,
    pub damaged: Damaged,
}

impl Table {
    /// How many of the rows are there in whole; `None` where that is not known before they are unpacked.
    pub fn rows_there(&self) -> Option<u64> {
        let there = |lane: &Lane| match (&lane.source, lane.end) {
            (Source::Plain(input), Some(end)) => {
                Some(end.min(input.len()).saturating_sub(lane.start) / (lane.stride as u64).max(1))
            }
            _ => None,
        };
        self.lanes.iter().map(there).try_fold(self.rows, |least, rows| Some(least.min(rows?)))
    }
}

/// Rows of bytes, one after the other.
#[derive(Debug)]
pub(super) struct Lane {
    pub source: Source,
    /// Offset of the first.
    pub start: u64,
    /// Offset of the end, where it is known.
    pub end: Option<u64>,
    /// Bytes of a row.
    pub stride: usize,
    /// Bytes of its array before the first row, and offset of the end of what is after the last: of several lanes of an
    /// array, those of the first and the last; `None` is as far as there is any.
    pub head_bytes: u64,
    pub tail_end: Option<u64>,
}

/// Where a column is in the rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub lane: usize,
    pub offset: usize,
    pub dtype: Dtype,
}

/// Longest row.
const STRIDE_BYTES_MAX: u64 = 4096;

const COLUMNS: [Column; 4] = [Column::T, Column::X, Column::Y, Column::P];

/// The table in an array file.
pub(super) fn of_file(input: &Arc<Input>, options: &OpenOptions) -> Result<Table, Error> {
    let array = Array::open(Source::Plain(input.clone()), 0, Some(input.len()), input.path(), options)?;
    let own = Own::of_comment(&array.header.comment);
    array.table(String::new(), own, options, input.path())
}

/// The table in an archive: of columns, or of one array.
pub(super) fn of_archive(input: &Arc<Input>, options: &OpenOptions) -> Result<Table, Error> {
    let (path, members) = (input.path(), archive::members(input)?);
    let damaged = Damaged::default();
    let own = Own::of_members(&members, input, &damaged)?;
    let checked = |member: &Member, lanes| Checked { name: member.name.clone(), crc: member.crc, lanes };
    let open = |member: &Member| {
        let (source, start, end) = member.open(input)?;
        Array::open(source, start, end, path, options)
    };
    let others = |read: &dyn Fn(&str) -> bool| {
        let names = members.iter().map(|member| member.name.clone());
        names.filter(|name| !read(name) && !Own::is_one(name)).collect::<Vec<_>>()
    };
    let column =
        |column| members.iter().find(|one| names::column(&one.name).is_some_and(|(c, _)| c == column));
    if options.topic.is_none()
        && let [Some(t), Some(x), Some(y), Some(p)] = COLUMNS.map(column)
    {
        let columns = [t, x, y, p];
        let arrays = columns.map(open);
        let unit = names::column(&t.name).and_then(|(_, unit)| unit);
        let own = Own { unit: own.unit.or(unit), ..own };
        let mut table = of_columns(columns.map(|one| one.name.as_str()), arrays, own, options, path)?;
        table.others = others(&|name| columns.iter().any(|column| column.name == name));
        table.checked = columns.iter().enumerate().map(|(i, one)| checked(one, i..i + 1)).collect();
        table.damaged = damaged;
        return Ok(table);
    }
    let mut tables = Vec::new();
    for member in members.iter().filter(|member| !Own::is_one(&member.name)) {
        let chosen = options.topic.as_ref().is_none_or(|topic| *topic == member.name);
        // What is no table is left aside, unless it was asked for or is alone.
        match open(member) {
            Ok(array) if chosen && array.is_table() => tables.push((member, array)),
            Err(error) if chosen && (options.topic.is_some() || members.len() == 1) => return Err(error),
            _ => {}
        }
    }
    let tables_names: Vec<_> = tables.iter().map(|(member, _)| member.name.clone()).collect();
    if tables.len() > 1 {
        let what = format!("holds several arrays of events ({}),", tables_names.join(", "));
        return Err(Error::new(ErrorKind::NeedsOption, path, what, "choose one with --topic NAME"));
    }
    let Some((member, array)) = tables.pop() else {
        let found: Vec<_> = members.iter().map(|member| member.name.as_str()).collect();
        let what = format!(
            "holds no events: no arrays t, x, y, p and none with these fields ({}),",
            found.join(", ")
        );
        return Err(refuse(
            path,
            what,
            "save the columns under these names, or name an array with --topic NAME",
        ));
    };
    let mut table = array.table(member.name.clone(), own, options, path)?;
    table.others = others(&|name| name == member.name);
    table.checked = vec![checked(member, 0..table.lanes.len())];
    table.damaged = damaged;
    Ok(table)
}

/// The table of four arrays.
fn of_columns(
    names: [&str; 4],
    arrays: [Result<Array, Error>; 4],
    own: Own,
    options: &OpenOptions,
    path: &Path,
) -> Result<Table, Error> {
    let (mut lanes, mut places, mut rows) = (Vec::new(), Vec::new(), None);
    for (lane, (name, array)) in names.into_iter().zip(arrays).enumerate() {
        let array = array?;
        let header = &array.header;
        let Elements::Number(dtype) = header.elements else {
            return Err(refuse(
                path,
                format!("has an array {name} that is no column of numbers"),
                "save it as numbers",
            ));
        };
        // A column may also be N x 1.
        let count = match header.shape.as_slice() {
            [count] | [count, 1] => *count,
            _ => {
                let what = format!("has an array {name} of shape {:?}, not one column", header.shape);
                return Err(refuse(path, what, "save t, x, y and p as arrays of one dimension"));
            }
        };
        if rows.is_some_and(|rows| rows != count) {
            let what = format!("has {count} numbers in {name} and {} in {}", rows.unwrap_or(0), names[0]);
            return Err(Error::new(
                ErrorKind::Malformed,
                path,
                what,
                "save the columns again, all of one length",
            ));
        }
        rows = Some(count);
        lanes.push(array.lane(dtype.bytes));
        places.push(Place { lane, offset: 0, dtype });
    }
    let columns: Option<[Place; 4]> = places.try_into().ok();
    let columns = columns.ok_or_else(|| refuse(path, "has not four columns", "save t, x, y and p"))?;
    table(rows.unwrap_or(0), lanes, columns, String::new(), own, options, path)
}

fn table(
    rows: u64,
    lanes: Vec<Lane>,
    columns: [Place; 4],
    name: String,
    own: Own,
    options: &OpenOptions,
    path: &Path,
) -> Result<Table, Error> {
    let [t, .., p] = columns;
    if t.dtype.kind == Kind::Bool {
        return Err(refuse(path, "has times of type bool", "name the columns with --columns"));
    }
    let _ = p;
    let unit = options.time_unit.or(t.dtype.unit).or(own.unit).ok_or_else(|| {
        let what = "does not tell the unit of its times";
        let remedy = "give it with --time-unit s, --time-unit ms, --time-unit us or --time-unit ns";
        Error::new(ErrorKind::NeedsOption, path, what, remedy)
    })?;
    let (others, checked, damaged) = Default::default();
    Ok(Table { rows, unit, lanes, columns, size: own.size, name, others, checked, damaged })
}

/// An array, its header read.
struct Array {
    source: Source,
    /// Offset of the first element.
    start: u64,
    end: Option<u64>,
    /// Bytes before it.
    header_bytes: u64,
    header: Header,
}

impl Array {
    fn open(
        mut source: Source,
        start: u64,
        end: Option<u64>,
        path: &Path,
        options: &OpenOptions,
    ) -> Result<Self, Error> {
        let mut prefix = [0; header::PREFIX_BYTES];
        let available = end.map_or(u64::MAX, |end| end.saturating_sub(start));
        let cut = |_| {
            let what = "ends inside the header of an array";
            Error::new(ErrorKind::Malformed, path, what, "copy it again").at(start)
        };
        let want = prefix.len().min(usize::try_from(available).unwrap_or(usize::MAX));
        let read = source.read_at(start, &mut prefix[..want])?;
        let len = header::len(&prefix[..read]).ok_or(()).map_err(cut)?;
        let limit = options.limits.header_bytes_max;
        if len > limit {
            let what = format!("has an array header of {len} bytes, more than {limit}");
            return Err(
                Error::new(ErrorKind::TooLarge, path, what, "save it again with numpy.save").at(start)
            );
        }
        let mut bytes = vec![0; len];
        if len as u64 > available || source.read_at(start, &mut bytes)? < len {
            return Err(cut(()));
        }
        let header = Header::parse(&bytes, path)?;
        let header_bytes = len as u64;
        Ok(Self { source, start: start + header_bytes, end, header_bytes, header })
    }

    /// All of its rows, of so many bytes each.
    fn lane(&self, stride: usize) -> Lane {
        let Self { start, end, header_bytes, .. } = *self;
        Lane { source: self.source.fork(), start, end, stride, head_bytes: header_bytes, tail_end: end }
    }

    /// Whether it can be a table of events by itself.
    fn is_table(&self) -> bool {
        match &self.header.elements {
            Elements::Record(..) => true,
            Elements::Number(_) => matches!(self.header.shape.as_slice(), [_, 4]),
        }
    }

    fn table(self, name: String, own: Own, options: &OpenOptions, path: &Path) -> Result<Table, Error> {
        match self.header.elements.clone() {
            Elements::Record(fields, stride) => self.record(&fields, stride, name, own, options, path),
            Elements::Number(dtype) => self.matrix(dtype, name, own, options, path),
        }
    }

    /// Of a structured array.
    fn record(
        self,
        fields: &[header::Field],
        stride: u64,
        name: String,
        own: Own,
        options: &OpenOptions,
        path: &Path,
    ) -> Result<Table, Error> {
        let [rows] = *self.header.shape.as_slice() else {
            let what =
                format!("has a structured array of shape {:?}, not one row of events", self.header.shape);
            return Err(refuse(path, what, "save it flat, as array.ravel() is"));
        };
        if stride == 0 || stride > STRIDE_BYTES_MAX {
            return Err(refuse(path, format!("has elements of {stride} bytes"), "save t, x, y and p alone"));
        }
        let place = |column| {
            let mut found =
                fields.iter().filter(|field| names::column(&field.name).is_some_and(|(c, _)| c == column));
            let field = found.next().filter(|_| found.next().is_none())?;
            Some((Place { lane: 0, offset: field.offset as usize, dtype: field.dtype? }, field))
        };
        let [Some((t, t_field)), Some((x, _)), Some((y, _)), Some((p, _))] = COLUMNS.map(place) else {
            let found: Vec<_> = fields.iter().map(|field| field.name.as_str()).collect();
            let what = format!("has fields ({}) that are not one each of t, x, y, p", found.join(", "));
            return Err(refuse(path, what, "name them so, each one number"));
        };
        let unit = names::column(&t_field.name).and_then(|(_, unit)| unit);
        let own = Own { unit: own.unit.or(unit), ..own };
        let lane = self.lane(stride as usize);
        table(rows, vec![lane], [t, x, y, p], name, own, options, path)
    }

    /// Of an array of N x 4.
    fn matrix(
        self,
        dtype: Dtype,
        name: String,
        own: Own,
        options: &OpenOptions,
        path: &Path,
    ) -> Result<Table, Error> {
        let [rows, 4] = *self.header.shape.as_slice() else {
            let what = format!("has an array of shape {:?}, not N x 4", self.header.shape);
            return Err(refuse(path, what, "save the events as rows of four numbers"));
        };
        let columns = self.columns(own, options, path)?;
        let bytes = dtype.bytes;
        if !self.header.fortran_order {
            let places = COLUMNS.map(|c| Place { lane: 0, offset: columns.place(c) * bytes, dtype });
            let lane = self.lane(4 * bytes);
            return table(rows, vec![lane], places, name, own, options, path);
        }
        // Column after column.
        let column_bytes = rows.saturating_mul(bytes as u64);
        let lane = |i: usize| {
            let start = self.start.saturating_add(column_bytes.saturating_mul(i as u64));
            let end = start.saturating_add(column_bytes);
            let column_end = Some(self.end.map_or(end, |last| last.min(end)));
            Lane {
                start,
                end: column_end,
                head_bytes: if i == 0 { self.header_bytes } else { 0 },
                tail_end: if i == 3 { self.end } else { Some(end) },
                ..self.lane(bytes)
            }
        };
        let lanes = (0..4).map(lane).collect();
        let places = COLUMNS.map(|c| Place { lane: columns.place(c), offset: 0, dtype });
        table(rows, lanes, places, name, own, options, path)
    }

    /// The order of the columns of N x 4: an option must tell it.
    fn columns(&self, own: Own, options: &OpenOptions, path: &Path) -> Result<Columns, Error> {
        options.columns.ok_or_else(|| {
            let both = options.time_unit.or(own.unit).is_none();
            let (what, remedy) = match both {
                true => (
                    "does not tell which column is what, nor the unit of its times",
                    "give both, such as --columns t,x,y,p --time-unit us",
                ),
                false => {
                    ("does not tell which column is what", "give their order, such as --columns t,x,y,p")
                }
            };
            Error::new(ErrorKind::NeedsOption, path, what, remedy)
        })
    }
}

/// What our own files tell beside the events.
#[derive(Clone, Copy, Debug, Default)]
struct Own {
    unit: Option<TimeUnit>,
    size: Option<Geometry>,
}

/// Names of members of archives that tell it.
pub(super) const TIME_UNIT: &str = "time_unit";
pub(super) const SENSOR_SIZE: &str = "sensor_size";

/// Longest member that is one of them.
const OWN_BYTES_MAX: usize = 1024;

impl Own {
    fn is_one(name: &str) -> bool {
        matches!(name, TIME_UNIT | SENSOR_SIZE)
    }

    fn of_comment(comment: &str) -> Self {
        let told = comment.strip_prefix(names::OWN).unwrap_or_default();
        let value = |key| names::value(told, key);
        Self {
            unit: value("time-unit").and_then(|unit| unit.parse().ok()),
            size: value("sensor-size").and_then(|size| names::size(size.split('x'))),
        }
    }

    /// A text and two numbers, if they are there and sound.
    fn of_members(members: &[Member], input: &Arc<Input>, damaged: &Damaged) -> Result<Self, Error> {
        let mut own = Self::default();
        for member in members.iter().filter(|member| Self::is_one(&member.name)) {
            let head = member.head(input, OWN_BYTES_MAX)?;
            if member.bytes <= OWN_BYTES_MAX as u64 && crc32fast::hash(&head) != member.crc {
                damaged.add(&member.name);
                continue;
            }
            let Some(bytes) = header::len(&head).and_then(|len| head.get(len..)) else { continue };
            match member.name.as_str() {
                TIME_UNIT => {
                    // NumPy's texts are of four bytes a letter, or of one.
                    let letters = bytes.iter().filter(|byte| **byte != 0).map(|byte| char::from(*byte));
                    own.unit = letters.collect::<String>().parse().ok();
                }
                _ => {
                    let side =
                        |i: usize| bytes.as_chunks::<8>().0.get(i).map(|side| i64::from_le_bytes(*side));
                    let side = |i| side(i).and_then(|side| u16::try_from(side).ok()).filter(|side| *side > 0);
                    own.size = side(0).zip(side(1)).map(|(width, height)| Geometry::new(width, height));
                }
            }
        }
        Ok(own)
    }
}
