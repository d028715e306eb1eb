//! The one error type of every format: kind, path, byte offset, what is wrong, what to do next.

use std::fmt;
use std::path::{Path, PathBuf};

/// What sort of thing went wrong, for programs; the message is for people.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// There is no such file.
    NotFound,
    /// A directory, a pipe or a device where a file is needed.
    NotAFile,
    /// The file has no bytes.
    Empty,
    /// The content is of no format in [`FORMATS`](crate::FORMATS).
    UnknownFormat,
    /// A format or a part of one that is known and not read.
    Unsupported,
    /// The file breaks its own format or contradicts itself.
    Malformed,
    /// A size in the file is beyond [`Limits`](crate::Limits).
    TooLarge,
    /// The file does not say what is needed: an option must.
    NeedsOption,
    /// The format cannot hold what should be written.
    Refused,
    /// The file to write is there already.
    Exists,
    /// The file became shorter while it was read.
    Changed,
    /// The operating system failed; [`source`](std::error::Error::source) says how.
    Io,
}

/// Why a recording could not be opened, read or written: one sentence with the path, the cause and what to do next.
///
/// ```
/// let error = lobula_formats::open("no/such.raw").unwrap_err();
/// assert_eq!(error.kind(), lobula_formats::ErrorKind::NotFound);
/// assert_eq!(error.to_string(), "no/such.raw: no such file; check the path");
/// ```
#[derive(Debug)]
pub struct Error(Box<Parts>);

#[derive(Debug)]
struct Parts {
    kind: ErrorKind,
    path: PathBuf,
    offset: Option<u64>,
    what: String,
    remedy: String,
    source: Option<std::io::Error>,
}

impl Error {
    pub(crate) fn new(
        kind: ErrorKind,
        path: &Path,
        what: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let (path, what, remedy) = (path.to_owned(), what.into(), remedy.into());
        Self(Box::new(Parts { kind, path, offset: None, what, remedy, source: None }))
    }

    pub(crate) fn at(mut self, offset: u64) -> Self {
        self.0.offset = Some(offset);
        self
    }

    /// What the operating system said about `path` while we were `doing` something with it.
    pub(crate) fn io(path: &Path, doing: &str, source: std::io::Error) -> Self {
        use std::io::ErrorKind::{NotFound, PermissionDenied, StorageFull};
        let (kind, what, remedy) = match source.kind() {
            NotFound => (ErrorKind::NotFound, "no such file".to_owned(), "check the path"),
            PermissionDenied => {
                (ErrorKind::Io, format!("{doing} is not permitted"), "check its permissions and owner")
            }
            StorageFull => (ErrorKind::Io, format!("{doing} failed, the disk is full"), "free some space"),
            _ => (ErrorKind::Io, format!("{doing} failed ({source})"), "check the disk and the file"),
        };
        let mut error = Self::new(kind, path, what, remedy);
        error.0.source = Some(source);
        error
    }

    /// What sort of thing went wrong.
    pub fn kind(&self) -> ErrorKind {
        self.0.kind
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// Where in the file, in bytes from its start, if the fault has a place.
    pub fn offset(&self) -> Option<u64> {
        self.0.offset
    }

    /// What is wrong.
    pub fn what(&self) -> &str {
        &self.0.what
    }

    /// What to do next.
    pub fn remedy(&self) -> &str {
        &self.0.remedy
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.0.path.display(), self.0.what)?;
        if let Some(offset) = self.0.offset {
            write!(f, " at byte {offset}")?;
        }
        write!(f, "; {}", self.0.remedy)
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.source.as_ref().map(|source| source as _)
    }
}
