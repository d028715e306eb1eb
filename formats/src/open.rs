//! The one entry: which format a file is, by its content.

use crate::container::Container;
use crate::input::Input;
use crate::{Error, ErrorKind, Limits, Recording, raw};
use lobula_core::Geometry;
use lobula_core::wire::Encoding;
use std::path::Path;

/// Every format: the one list. A format is a module and a line here.
pub static FORMATS: &[Format] = &[raw::FORMAT];

/// A format of recordings.
#[derive(Debug)]
#[non_exhaustive]
pub struct Format {
    /// Its name.
    pub name: &'static str,
    /// Usual ends of file names, without the dot.
    pub extensions: &'static [&'static str],
    /// Whether files of it can be written.
    pub writes: bool,
    /// Whether a file that begins so is of this format.
    pub(crate) probe: fn(head: &[u8]) -> bool,
    /// Opens a file of this format.
    pub(crate) open: Open,
}

type Open = fn(Input, &OpenOptions) -> Result<Box<dyn Container>, Error>;

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
    /// Bounds on sizes in the file.
    pub limits: Limits,
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
    let input = Input::open(path.as_ref())?;
    let mut head = [0; 512];
    let len = input.read_at(0, &mut head)?;
    let head = &head[..len];
    let by_content = FORMATS.iter().find(|format| (format.probe)(head));
    // The bare bytes of a camera have no mark of their own: an encoding given says what they are.
    let format = by_content.or(options.encoding.map(|_| &raw::FORMAT));
    let Some(format) = format else { return Err(unknown(input.path(), head)) };
    Ok(Recording::new((format.open)(input, options)?, options.limits))
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
