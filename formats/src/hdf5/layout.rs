//! Which datasets of a file hold events, and what the file says of them.
//!
//! ```text
//! events/{t,x,y,p}       t an integer in µs                     ours, EventCV, DSEC (t_offset beside: added to t)
//! events/{ts,xs,ys,ps}   ts a floating point number in seconds  E2VID, event_utils
//! CD/events              one dataset of x, y, p, t; t in µs     Prophesee
//! NAME                   N x 4 numbers: columns and unit are to be given
//! ```
//!
//! Datasets of triggers beside them are told in `triggers`.
//!
//! The sensor's size is in attributes of the dataset, of its group or of the root: `width` and `height`,
//! `sensor_resolution` (height first, event_utils), `geometry` ("1280x720", Prophesee). So is the unit of time, where it
//! is told: `time_unit` ("us", ours), `timestamp_scale_ms` (EventCV).

use super::attribute::{self, Attribute, Value};
use super::columns::Place;
use super::dataset::{self, Dataset};
use super::datatype::{Datatype, Member, Number};
use super::file::File;
use super::group;
use super::number;
use super::object::{Kind, Object};
use super::source::Source;
use super::triggers::Table;
use crate::open::{Column, TimeUnit};
use crate::{Error, ErrorKind, OpenOptions};
use lobula_core::Geometry;

/// Names of the columns.
const NAMES: [(Column, &[&str]); 4] = [
    (Column::T, &["t", "ts", "timestamp", "timestamps", "time"]),
    (Column::X, &["x", "xs"]),
    (Column::Y, &["y", "ys"]),
    (Column::P, &["p", "ps", "pol", "polarity", "polarities"]),
];

/// Most objects of a file that are looked at, and how deep.
const OBJECTS_MAX: usize = 10_000;
const DEPTH_MAX: usize = 8;

/// A dataset of the file, by name.
#[derive(Clone, Debug)]
struct Named {
    /// Names of the groups that it is in, and its own.
    path: String,
    object: u64,
    dimensions: Vec<u64>,
    datatype: Datatype,
}

impl Named {
    fn name(&self) -> &str {
        self.path.rsplit('/').next().unwrap_or_default()
    }

    fn group(&self) -> &str {
        parent(&self.path)
    }
}

fn parent(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(group, _)| group)
}

/// A stream of events.
#[derive(Clone, Debug)]
struct Candidate {
    /// Path of its group or dataset.
    path: String,
    shape: Shape,
}

#[derive(Clone, Debug)]
enum Shape {
    /// A dataset each for t, x, y, p.
    Four([Named; 4]),
    /// One dataset with members for t, x, y, p.
    Compound(Named, [Member; 4]),
    /// One dataset of four columns.
    Table(Named),
}

/// Columns of triggers: dataset, bytes in its row, and type of t, id and p, and of how many events come before.
struct Found<'a> {
    name: String,
    columns: [(&'a Named, usize, Number); 3],
    event: Option<(&'a Named, usize, Number)>,
}

/// What was found in a file.
#[derive(Debug)]
pub(super) struct Layout {
    candidates: Vec<Candidate>,
    datasets: Vec<Named>,
    groups: Vec<(String, u64)>,
}

/// A stream of events, ready to be read.
#[derive(Debug)]
pub(super) struct Events {
    pub path: String,
    pub sources: Vec<Source>,
    pub places: [Place; 4],
    pub unit: TimeUnit,
    pub t_offset_us: i64,
    pub geometry: Option<Geometry>,
    /// What is odd, in sentences.
    pub warnings: Vec<String>,
}

impl Layout {
    /// Looks at every object of the file.
    pub fn find(file: &File) -> Result<Self, Error> {
        let mut layout = Self { candidates: Vec::new(), datasets: Vec::new(), groups: Vec::new() };
        let mut seen = Vec::new();
        let mut todo = vec![(String::new(), file.root, 0)];
        while let Some((path, address, depth)) = todo.pop() {
            if seen.contains(&address) || seen.len() >= OBJECTS_MAX {
                continue;
            }
            seen.push(address);
            let object = Object::read(file, address)?;
            if Dataset::is(&object) {
                layout.datasets.extend(outline(file, path, &object));
                continue;
            }
            let links = if depth < DEPTH_MAX { group::links(file, &object)? } else { Vec::new() };
            layout.groups.push((path.clone(), address));
            for link in links {
                let path = if path.is_empty() { link.name } else { format!("{path}/{}", link.name) };
                todo.push((path, link.object, depth + 1));
            }
        }
        layout.datasets.sort_by(|a, b| a.path.cmp(&b.path));
        layout.find_candidates();
        Ok(layout)
    }

    fn find_candidates(&mut self) {
        let fours = self.groups.iter().filter_map(|(path, _)| self.four(path));
        let compounds = self.datasets.iter().filter_map(compound);
        self.candidates = fours.chain(compounds).collect();
        if self.candidates.is_empty() {
            self.candidates = self.datasets.iter().filter_map(table).collect();
        }
        self.candidates.sort_by(|a, b| a.path.cmp(&b.path));
    }

    /// The four columns of a group.
    fn four(&self, group: &str) -> Option<Candidate> {
        let mut of_group =
            self.datasets.iter().filter(|dataset| dataset.group() == group && is_column(dataset));
        let all: Vec<_> = of_group.by_ref().collect();
        let column = |(_, names): &(Column, &[&str])| {
            let mut found = all.iter().filter(|dataset| is_one_of(dataset.name(), names));
            let first = found.next()?;
            // Two of them leave it open which one is meant.
            found.next().is_none().then(|| (*first).clone())
        };
        let [t, x, y, p] = &NAMES;
        let four = [column(t)?, column(x)?, column(y)?, column(p)?];
        Some(Candidate { path: group.to_owned(), shape: Shape::Four(four) })
    }

    /// Names of all streams of events.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.candidates.iter().map(|candidate| candidate.path.as_str())
    }

    /// Names of the datasets that belong to no stream of events, and say nothing about one.
    pub fn others(&self) -> impl Iterator<Item = &str> {
        let others = self.datasets.iter().filter(|dataset| {
            let of_stream = self.candidates.iter().any(|candidate| candidate.holds(&dataset.path));
            !of_stream && !matches!(dataset.name(), "t_offset" | "ms_to_idx" | "indexes")
        });
        others.map(|dataset| dataset.path.as_str())
    }

    /// The triggers of the stream of events of this path: their name, and where they are.
    pub fn triggers(
        &self,
        file: &File,
        path: &str,
        (unit, t_offset_us): (TimeUnit, i64),
    ) -> Result<Option<(String, Table)>, Error> {
        let bases = [parent(path), parent(parent(path))];
        let of =
            |base: &str, name: &str| if base.is_empty() { name.to_owned() } else { format!("{base}/{name}") };
        let found = bases.iter().find_map(|base| {
            self.compound_triggers(of(base, "EXT_TRIGGER/events"))
                .or_else(|| self.own_triggers(of(base, "triggers")))
        });
        let Some(Found { name, columns, event }) = found else { return Ok(None) };
        let (mut sources, mut places) = (Vec::new(), Vec::new());
        for (named, offset, number) in columns.into_iter().chain(event) {
            let dataset = Dataset::open(file, &named.path, &Object::read(file, named.object)?)?;
            places.push(Place { source: sources.len(), offset, number });
            sources.push(Source::open(file, &dataset, 0)?);
        }
        let mut places = places.into_iter();
        let [t, channel, edge] = [places.next(), places.next(), places.next()];
        let event = places.next();
        let table = t.zip(channel).zip(edge).map(|((t, channel), edge)| Table {
            sources,
            t,
            channel,
            edge,
            event,
            unit,
            t_offset_us,
        });
        Ok(table.map(|table| (name, table)))
    }

    /// Prophesee's.
    fn compound_triggers(&self, name: String) -> Option<Found<'_>> {
        let named = self.datasets.iter().find(|dataset| dataset.path == name)?;
        let Datatype::Compound { members, .. } = &named.datatype else { return None };
        let column = |name: &str| {
            let member = members.iter().find(|member| member.name == name)?;
            let Datatype::Number(number) = member.datatype else { return None };
            Some((named, member.offset, number))
        };
        let columns = [column("t")?, column("id")?, column("p")?];
        (named.dimensions.len() == 1).then_some(Found { name, columns, event: None })
    }

    /// Ours.
    fn own_triggers(&self, name: String) -> Option<Found<'_>> {
        let column = |column: &str| {
            let mut of_group =
                self.datasets.iter().filter(|dataset| dataset.group() == name && is_column(dataset));
            let named = of_group.find(|dataset| dataset.name() == column)?;
            let Datatype::Number(number) = named.datatype else { return None };
            Some((named, 0, number))
        };
        let columns = [column("t")?, column("id")?, column("p")?];
        let event = Some(column("event")?);
        Some(Found { name, columns, event })
    }

    /// The stream that is asked for, or the only one.
    pub fn events(&self, file: &File, options: &OpenOptions) -> Result<Events, Error> {
        let candidate = self.choose(file, options)?;
        let unit = self.unit(file, candidate, options)?;
        let (sources, places) = candidate.open(file, options)?;
        let mut events = Events {
            path: candidate.path.clone(),
            sources,
            places,
            unit,
            t_offset_us: self.t_offset(file, &candidate.path)?,
            geometry: self.geometry(file, candidate, options)?,
            warnings: Vec::new(),
        };
        events.warnings.extend(uneven(&events.sources));
        Ok(events)
    }

    fn choose(&self, file: &File, options: &OpenOptions) -> Result<&Candidate, Error> {
        let names: Vec<_> = self.names().map(|name| if name.is_empty() { "/" } else { name }).collect();
        let names = names.join(", ");
        let path = file.input.path();
        if let Some(topic) = &options.topic {
            let wanted = topic.trim_matches('/');
            let found = self.candidates.iter().find(|candidate| candidate.path == wanted);
            return found.ok_or_else(|| {
                let what = format!("has no events called {topic}");
                Error::new(ErrorKind::NeedsOption, path, what, format!("give one of {names} with --topic"))
            });
        }
        match self.candidates.as_slice() {
            [one] => Ok(one),
            [] => {
                let what = "is an HDF5 file without events: no group has t, x, y, p, no dataset has these members, and none is N x 4";
                let remedy = "convert it to one of these layouts";
                Err(Error::new(ErrorKind::Unsupported, path, what, remedy))
            }
            _ => {
                let what = format!("has more than one stream of events: {names}");
                Err(Error::new(ErrorKind::NeedsOption, path, what, "choose one with --topic NAME"))
            }
        }
    }

    /// The unit of time: as given, as the file says, or as the layout defines it.
    fn unit(&self, file: &File, candidate: &Candidate, options: &OpenOptions) -> Result<TimeUnit, Error> {
        if let Some(unit) = options.time_unit {
            return Ok(unit);
        }
        for attribute in self.attributes(file, candidate)? {
            let told = unit_told(&attribute).map_err(|text| {
                let what = format!("says that its times are in {text}, which is no unit we know");
                needs_unit(file, what)
            })?;
            if let Some(unit) = told {
                return Ok(unit);
            }
        }
        candidate.unit_by_layout().ok_or_else(|| {
            let what = format!("does not say what one unit of time is in {}", candidate.path);
            needs_unit(file, what)
        })
    }

    /// Attributes of the stream's dataset, of its groups from the nearest on, and of the root.
    fn attributes(&self, file: &File, candidate: &Candidate) -> Result<Vec<Attribute>, Error> {
        let mut all = Vec::new();
        let (Shape::Four([dataset, ..]) | Shape::Compound(dataset, _) | Shape::Table(dataset)) =
            &candidate.shape;
        all.extend(attribute::attributes(file, &Object::read(file, dataset.object)?)?);
        let mut group = dataset.group();
        loop {
            let found = self.groups.iter().find(|(path, _)| path == group);
            if let Some((_, address)) = found {
                all.extend(attribute::attributes(file, &Object::read(file, *address)?)?);
            }
            if group.is_empty() {
                return Ok(all);
            }
            group = parent(group);
        }
    }

    fn geometry(
        &self,
        file: &File,
        candidate: &Candidate,
        options: &OpenOptions,
    ) -> Result<Option<Geometry>, Error> {
        if options.sensor_size.is_some() {
            return Ok(options.sensor_size);
        }
        let attributes = self.attributes(file, candidate)?;
        let Some((width, height)) = size_told(&attributes) else { return Ok(None) };
        let side_max = f64::from(options.limits.sensor_side_px_max);
        let side =
            |side: f64| (side >= 1.0 && side <= side_max && side.fract() == 0.0).then_some(side as u16);
        let geometry = side(width).zip(side(height)).map(|(width, height)| Geometry { width, height });
        geometry.map(Some).ok_or_else(|| {
            let what = format!("has the sensor size {width}x{height}, beyond 1 to {side_max} pixels a side");
            let remedy = "give the true size with --sensor-size WxH";
            Error::new(ErrorKind::TooLarge, file.input.path(), what, remedy)
        })
    }

    /// DSEC: what to add to every time, beside the group of events or in it.
    fn t_offset(&self, file: &File, path: &str) -> Result<i64, Error> {
        let groups = [path, parent(path)];
        let is_it = |dataset: &&Named| dataset.name() == "t_offset" && groups.contains(&dataset.group());
        let Some(named) = self.datasets.iter().find(is_it) else { return Ok(0) };
        let malformed = || file.malformed("dataset t_offset", named.object);
        let dataset = Dataset::open(file, &named.path, &Object::read(file, named.object)?)?;
        let Datatype::Number(of) = dataset.datatype else { return Err(malformed()) };
        let bytes = dataset.small(file)?.ok_or_else(malformed)?;
        number::value(of, &bytes).whole().ok_or_else(malformed)
    }
}

fn needs_unit(file: &File, what: String) -> Error {
    Error::new(ErrorKind::NeedsOption, file.input.path(), what, "give it with --time-unit s|ms|us|ns")
}

/// Name, shape and type of a dataset; nothing where these cannot be read, as they need not be.
fn outline(file: &File, path: String, object: &Object) -> Option<Named> {
    let message = |kind| object.get(file, kind).ok().flatten();
    let dimensions = dataset::dimensions(file.fields(&message(Kind::Dataspace)?.body))?;
    let datatype = Datatype::parse(&mut file.fields(&message(Kind::Datatype)?.body))?;
    Some(Named { path, object: object.address, dimensions, datatype })
}

fn is_one_of(name: &str, names: &[&str]) -> bool {
    names.iter().any(|one| one.eq_ignore_ascii_case(name))
}

fn is_column(dataset: &Named) -> bool {
    dataset.dimensions.len() == 1 && matches!(dataset.datatype, Datatype::Number(_))
}

fn compound(dataset: &Named) -> Option<Candidate> {
    let Datatype::Compound { members, .. } = &dataset.datatype else { return None };
    let column = |(_, names): &(Column, &[&str])| {
        let mut found = members.iter().filter(|member| is_one_of(&member.name, names));
        let first = found.next().filter(|first| matches!(first.datatype, Datatype::Number(_)))?;
        found.next().is_none().then(|| first.clone())
    };
    let [t, x, y, p] = &NAMES;
    let four = [column(t)?, column(x)?, column(y)?, column(p)?];
    let shape = Shape::Compound(dataset.clone(), four);
    (dataset.dimensions.len() == 1).then(|| Candidate { path: dataset.path.clone(), shape })
}

fn table(dataset: &Named) -> Option<Candidate> {
    let is_table =
        matches!(dataset.dimensions.as_slice(), [_, 4]) && matches!(dataset.datatype, Datatype::Number(_));
    is_table.then(|| Candidate { path: dataset.path.clone(), shape: Shape::Table(dataset.clone()) })
}

impl Candidate {
    fn holds(&self, path: &str) -> bool {
        match &self.shape {
            Shape::Four(four) => four.iter().any(|dataset| dataset.path == path),
            Shape::Compound(dataset, _) | Shape::Table(dataset) => dataset.path == path,
        }
    }

    /// The unit that the layout defines, where it does.
    fn unit_by_layout(&self) -> Option<TimeUnit> {
        let is_events = |path: &str| path.rsplit('/').next() == Some("events");
        let is_float = |datatype: &Datatype| matches!(datatype, Datatype::Number(of) if of.kind.is_float());
        match &self.shape {
            Shape::Four([t, ..]) if !is_events(&self.path) => {
                let _ = t;
                None
            }
            Shape::Four([t, ..]) if t.name() == "t" && !is_float(&t.datatype) => Some(TimeUnit::Microseconds),
            Shape::Four([t, ..]) if t.name() == "ts" && is_float(&t.datatype) => Some(TimeUnit::Seconds),
            Shape::Compound(_, [t, ..])
                if is_events(&self.path) && t.name == "t" && !is_float(&t.datatype) =>
            {
                Some(TimeUnit::Microseconds)
            }
            _ => None,
        }
    }

    /// Opens what is to be read.
    fn open(&self, file: &File, options: &OpenOptions) -> Result<(Vec<Source>, [Place; 4]), Error> {
        let open = |named: &Named| Dataset::open(file, &named.path, &Object::read(file, named.object)?);
        let malformed = || file.malformed(&format!("dataset {}", self.path), 0);
        match &self.shape {
            Shape::Four(four) => {
                let (mut sources, mut places) = (Vec::new(), Vec::new());
                for (source, named) in four.iter().enumerate() {
                    let Datatype::Number(number) = named.datatype else { return Err(malformed()) };
                    sources.push(Source::open(file, &open(named)?, 0)?);
                    places.push(Place { source, offset: 0, number });
                }
                Ok((sources, places.try_into().map_err(|_| malformed())?))
            }
            Shape::Compound(named, members) => {
                let source = Source::open(file, &open(named)?, 0)?;
                let place = |member: &Member| match member.datatype {
                    Datatype::Number(number) => Some(Place { source: 0, offset: member.offset, number }),
                    _ => None,
                };
                let [t, x, y, p] = members;
                let places = (|| Some([place(t)?, place(x)?, place(y)?, place(p)?]))();
                Ok((vec![source], places.ok_or_else(malformed)?))
            }
            Shape::Table(named) => {
                let Datatype::Number(number) = named.datatype else { return Err(malformed()) };
                self.open_table(file, &open(named)?, number, options)
            }
        }
    }

    fn open_table(
        &self,
        file: &File,
        dataset: &Dataset,
        number: Number,
        options: &OpenOptions,
    ) -> Result<(Vec<Source>, [Place; 4]), Error> {
        let columns = options.columns.ok_or_else(|| {
            let what = format!("does not say which of the four columns of {} is what", self.path);
            let remedy = "give their order with --columns, such as t,x,y,p";
            Error::new(ErrorKind::NeedsOption, file.input.path(), what, remedy)
        })?;
        let bytes = number.kind.bytes();
        // A source for each part that the columns are cut into: nearly always one.
        let mut sources: Vec<Source> = Vec::new();
        let mut starts = Vec::new();
        let mut across = 0;
        while across < 4 {
            let source = Source::open(file, dataset, across as u64)?;
            let wide = (source.row_bytes / bytes).max(1);
            starts.push(across);
            across += wide;
            sources.push(source);
        }
        let place = |column| {
            let at = columns.place(column);
            let source = starts.iter().rposition(|start| *start <= at).unwrap_or_default();
            let start = starts.get(source).copied().unwrap_or_default();
            Place { source, offset: (at - start) * bytes, number }
        };
        let places = [Column::T, Column::X, Column::Y, Column::P].map(place);
        Ok((sources, places))
    }
}

/// What an attribute says about the unit of time; an error is the text that says something else.
fn unit_told(attribute: &Attribute) -> Result<Option<TimeUnit>, String> {
    match (attribute.name.as_str(), &attribute.value) {
        ("time_unit", Value::Text(text)) => text.parse().map(Some).map_err(|_| text.clone()),
        ("timestamp_scale_ms", Value::Numbers(numbers)) => match numbers.as_slice() {
            [1000.0] => Ok(Some(TimeUnit::Seconds)),
            [1.0] => Ok(Some(TimeUnit::Milliseconds)),
            [0.001] => Ok(Some(TimeUnit::Microseconds)),
            [0.000_001] => Ok(Some(TimeUnit::Nanoseconds)),
            other => Err(format!("{other:?} ms")),
        },
        _ => Ok(None),
    }
}

/// Width and height that attributes tell: the first that do.
fn size_told(attributes: &[Attribute]) -> Option<(f64, f64)> {
    let number = |name: &str| {
        attributes.iter().find_map(|attribute| match &attribute.value {
            Value::Numbers(numbers) if attribute.name == name => numbers.first().copied(),
            _ => None,
        })
    };
    if let Some(size) = number("width").zip(number("height")) {
        return Some(size);
    }
    attributes.iter().find_map(|attribute| match (attribute.name.as_str(), &attribute.value) {
        ("sensor_resolution", Value::Numbers(numbers)) => match numbers.as_slice() {
            [height, width] => Some((*width, *height)),
            _ => None,
        },
        ("geometry", Value::Text(text)) => {
            let (width, height) = text.split_once('x')?;
            Some((width.trim().parse().ok()?, height.trim().parse().ok()?))
        }
        _ => None,
    })
}

/// Says so where the columns are not equally long.
fn uneven(sources: &[Source]) -> Option<String> {
    let first = sources.first()?;
    let other = sources.iter().find(|source| source.rows != first.rows)?;
    let (few, many) = if first.rows < other.rows { (first, other) } else { (other, first) };
    Some(format!(
        "{} has {} rows and {} only {}: what is over is left out",
        many.name, many.rows, few.name, few.rows
    ))
}
