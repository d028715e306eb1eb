//! A file on disk, read by position in bounded pieces.
//!
//! Never mapped into memory: a mapped file that another program shortens kills the reader with SIGBUS; here it is an
//! error with an offset.

use crate::{Error, ErrorKind};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// An open file of known length.
#[derive(Debug)]
pub(crate) struct Input {
    file: File,
    path: PathBuf,
    len: u64,
}

impl Input {
    /// Opens a regular file that has at least one byte.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let io = |source| Error::io(path, "opening it", source);
        // Before opening: a pipe would block, a directory would open.
        let kind = std::fs::metadata(path).map_err(io)?.file_type();
        if kind.is_dir() {
            return Err(Error::new(
                ErrorKind::NotAFile,
                path,
                "is a directory",
                "name the recording inside it",
            ));
        }
        if !kind.is_file() {
            let remedy = "save what comes out of it to a file and open that";
            return Err(Error::new(ErrorKind::NotAFile, path, "is a pipe or a device, not a file", remedy));
        }
        let file = File::open(path).map_err(io)?;
        let len = file.metadata().map_err(io)?.len();
        if len == 0 {
            let remedy = "record it again or copy it again";
            return Err(Error::new(ErrorKind::Empty, path, "is empty (0 bytes)", remedy));
        }
        Ok(Self { file, path: path.to_owned(), len })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length when it was opened, in bytes.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Fills `buffer` from `offset`, but for what lies beyond the end; returns how many bytes were read.
    pub fn read_at(&self, offset: u64, buffer: &mut [u8]) -> Result<usize, Error> {
        let left = usize::try_from(self.len.saturating_sub(offset)).unwrap_or(usize::MAX);
        let want = left.min(buffer.len());
        let (wanted, _) = buffer.split_at_mut(want);
        self.file.read_exact_at(wanted, offset).map_err(|source| self.failed(offset, source))?;
        Ok(want)
    }

    fn failed(&self, offset: u64, source: std::io::Error) -> Error {
        if source.kind() != std::io::ErrorKind::UnexpectedEof {
            return Error::io(&self.path, "reading it", source).at(offset);
        }
        let what =
            format!("became shorter than the {} bytes it had when it was opened, while reading", self.len);
        Error::new(ErrorKind::Changed, &self.path, what, "let the other program finish, then open it again")
            .at(offset)
    }
}
