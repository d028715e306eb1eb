//! The one entry: which format a file is, by its content.

use crate::container::Container;
use crate::input::Input;
use crate::write::Create;
use crate::{Error, ErrorKind, Limits, Recording, aedat2, dat, es, nmnist, raw};
use lobula_core::Geometry;
use lobula_core::wire::Encoding;
use std::path::Path;
use std::sync::Arc;

/// Every format: the one list. A format is a module and a line here.
pub static FORMATS: &[Format] = &[
    dat::FORMAT,
    raw::FORMAT,
    aedat2::FORMAT,
    #[cfg(feature = "aedat4")]
    crate::aedat31::FORMAT,
    #[cfg(feature = "aedat4")]
    crate::aedat4::FORMAT,
    es::FORMAT,
    #[cfg(feature = "ros")]
    crate::rosbag::FORMAT,
    #[cfg(feature = "ros")]
    crate::mcap::FORMAT,
    #[cfg(feature = "ros")]
    crate::db3::FORMAT,
    #[cfg(feature = "hdf5")]
    crate::hdf5::FORMAT,
    nmnist::FORMAT,
    #[cfg(feature = "tables")]
    crate::numpy::FORMAT,
    #[cfg(feature = "tables")]
    crate::text::FORMAT,
];

/// A format of recordings.
#[derive(Debug)]
#[non_exhaustive]
pub struct Format {
    /// Its name.
    pub name: &'static str,
    /// Usual ends of file names, without the dot.
    pub extensions: &'static [&'static str],
    /// Starts a file of this format, where it can be written.
    pub(crate) create: Option<Create>,
    /// Whether a file is of this format; asked in the order of the table.
    pub(crate) probe: fn(&Probe<'_>) -> bool,
    /// Opens a file of this format.
    pub(crate) open: Open,
}

impl Format {
    /// Whether files of it can be written.
    pub fn writes(&self) -> bool {
        self.create.is_some()
    }
}

/// What is looked at to tell a file's format: its content, and where that says nothing, its name.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Probe<'a> {
    /// The first bytes.
    pub head: &'a [u8],
    /// Length of the file.
    pub bytes: u64,
    pub path: &'a Path,
    /// The file, where the first bytes are not enough.
    pub input: &'a Input,
}

impl Probe<'_> {
    /// Whether the file's name ends as those of the format do.
    pub fn has_extension(&self, format: &Format) -> bool {
        format.has_name(self.path)
    }
}

type Open = fn(Arc<Input>, &OpenOptions) -> Result<Box<dyn Container>, Error>;

/// What a file does not say, or says wrongly, and bounds. Each option is the tool's of the same name.
///
/// ```
/// let mut options = lobula_formats::OpenOptions::default();
/// options.sensor_size = Some(lobula_core::Geometry::new(640, 480));
/// ```
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct OpenOptions {
    /// Size of the sensor, in place of what the file says; events off it are counted and dropped. Default: the file's.
    pub sensor_size: Option<Geometry>,
    /// How events are encoded, in place of what the file says. Default: as the file says.
    pub encoding: Option<Encoding>,
    /// What one unit of time is, where the file does not say (text and NumPy files). Default: refused.
    pub time_unit: Option<TimeUnit>,
    /// Which column is what, where the file does not say. Default: refused where the content leaves it open.
    pub columns: Option<Columns>,
    /// Which stream of events, where the file has more than one: a topic's or a stream's name. Default: the only one.
    pub topic: Option<String>,
    /// What to add to every time, in µs. Default: 0; a time that is negative after it is an error.
    pub time_shift_us: i64,
    /// Bounds on sizes in the file.
    pub limits: Limits,
}

/// What one unit of a file's times is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // they are what they are
pub enum TimeUnit {
    Seconds,
    Milliseconds,
    Microseconds,
    Nanoseconds,
}

impl TimeUnit {
    /// Every unit, the longest first.
    pub const ALL: [Self; 4] = [Self::Seconds, Self::Milliseconds, Self::Microseconds, Self::Nanoseconds];

    /// Its symbol in options and in the files we write.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Seconds => "s",
            Self::Milliseconds => "ms",
            Self::Microseconds => "us",
            Self::Nanoseconds => "ns",
        }
    }
}

impl std::str::FromStr for TimeUnit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let unit = Self::ALL.into_iter().find(|unit| unit.name() == text);
        unit.ok_or_else(|| format!("give one of s, ms, us, ns, not {text}"))
    }
}

/// What a column of a table of events holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // they are what they are
pub enum Column {
    T,
    X,
    Y,
    P,
}

/// The order of the four columns.
///
/// ```
/// let columns: lobula_formats::Columns = "x,y,p,t".parse().unwrap();
/// assert_eq!(columns.place(lobula_formats::Column::T), 3);
/// assert!("x,y,p".parse::<lobula_formats::Columns>().is_err());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Columns([Column; 4]);

impl Columns {
    /// t, x, y, p.
    pub const TXYP: Self = Self([Column::T, Column::X, Column::Y, Column::P]);

    /// Which column, counted from 0, holds this.
    pub fn place(self, column: Column) -> usize {
        self.0.iter().position(|one| *one == column).unwrap_or_default()
    }
}

impl std::str::FromStr for Columns {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let column = |name: &str| match name.trim() {
            "t" => Some(Column::T),
            "x" => Some(Column::X),
            "y" => Some(Column::Y),
            "p" => Some(Column::P),
            _ => None,
        };
        let named: Option<Vec<_>> = text.split(',').map(column).collect();
        let four: Option<[Column; 4]> = named.and_then(|named| named.try_into().ok());
        let distinct = |four: &[Column; 4]| {
            [Column::T, Column::X, Column::Y, Column::P].iter().all(|c| four.contains(c))
        };
        let columns = four.filter(distinct).map(Self);
        columns.ok_or_else(|| format!("give the order of the four columns, such as t,x,y,p, not {text}"))
    }
}

/// Opens a recording of any format in [`FORMATS`], going by its content.
///
/// # Errors
/// One sentence with the path, the cause and what to do: no such file, not a file, empty, of no known format, a
/// header that lies or does not say enough.
pub fn open(path: impl AsRef<Path>) -> Result<Recording, Error> {
    open_with(path, &OpenOptions::default())
}

/// Opens a recording with options.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: impl AsRef<Path>, options: &OpenOptions) -> Result<Recording, Error> {
    let input = Arc::new(Input::open(path.as_ref())?);
    let mut head = [0; 4096];
    let len = input.read_at(0, &mut head)?;
    let head = &head[..len];
    let probe = Probe { head, bytes: input.len(), path: input.path(), input: &input };
    let by_content = FORMATS.iter().find(|format| (format.probe)(&probe));
    // The bare bytes of a camera have no mark of their own: an encoding given says what they are.
    let format = by_content.or(options.encoding.map(|_| &raw::FORMAT));
    let Some(format) = format else { return Err(unknown(input.path(), head)) };
    let container = (format.open)(input.clone(), options)?;
    Ok(Recording::new(input, format, container, options.limits))
}

fn unknown(path: &Path, head: &[u8]) -> Error {
    let known: Vec<_> = FORMATS.iter().map(|format| format.name).collect();
    let known = known.join(", ");
    let is_text = head.iter().all(|byte| (b' '..0x7F).contains(byte) || byte.is_ascii_whitespace());
    let what = match is_text {
        true => format!("is text, and no recording of a known format ({known})"),
        false => format!("is no recording of a known format ({known})"),
    };
    let remedy = "convert it to one of these, or give --encoding if it is the bare bytes of a camera";
    Error::new(ErrorKind::UnknownFormat, path, what, remedy)
}
