//! A file being written: under a temporary name beside its own until it is complete.

use crate::{Error, ErrorKind};
use std::fs::File;
use std::io::Write;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// A file that appears under its name whole or not at all.
#[derive(Debug)]
pub(crate) struct Output {
    file: File,
    path: PathBuf,
    /// Where the bytes are until the end; `None` once they have their name.
    temporary: Option<PathBuf>,
    /// Bytes written.
    len: u64,
}

impl Output {
    /// Starts a file. One that is there stays until [`finish`](Self::finish).
    pub fn create(path: &Path, overwrite: bool) -> Result<Self, Error> {
        refuse_existing(path, overwrite)?;
        let temporary = temporary(path)?;
        let file = File::create_new(&temporary).map_err(|source| Error::io(path, "creating it", source))?;
        Ok(Self { file, path: path.to_owned(), temporary: Some(temporary), len: 0 })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds bytes; give it large pieces, it keeps none back.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.len += bytes.len() as u64;
        self.file.write_all(bytes).map_err(|source| Error::io(&self.path, "writing it", source))
    }

    /// Replaces bytes that were written before.
    #[allow(dead_code)] // for formats that are features
    pub fn write_at(&mut self, offset: u64, bytes: &[u8]) -> Result<(), Error> {
        self.file.write_all_at(bytes, offset).map_err(|source| Error::io(&self.path, "writing it", source))
    }

    /// Bytes written.
    #[allow(dead_code)] // for formats that are features
    pub fn len(&self) -> u64 {
        self.len
    }

    /// A file for what must wait until `path` is written: it has no name and is gone with the handle.
    pub fn scratch(path: &Path) -> Result<File, Error> {
        let io = |source| Error::io(path, "creating a file beside it", source);
        let name = temporary(path)?;
        let file = File::options().read(true).write(true).create_new(true).open(&name).map_err(io)?;
        std::fs::remove_file(&name).map_err(io)?;
        Ok(file)
    }

    /// Makes the bytes safe on the disk and gives the file its name; tells its length.
    pub fn finish(mut self) -> Result<u64, Error> {
        self.file.sync_all().map_err(|source| Error::io(&self.path, "writing it", source))?;
        if let Some(temporary) = &self.temporary {
            std::fs::rename(temporary, &self.path)
                .map_err(|source| Error::io(&self.path, "naming it", source))?;
        }
        self.temporary = None;
        Ok(self.len)
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            // Nothing is to be done where this fails: the name says that the file is a part.
            let _ = std::fs::remove_file(temporary);
        }
    }
}

fn refuse_existing(path: &Path, overwrite: bool) -> Result<(), Error> {
    let exists = std::fs::symlink_metadata(path);
    match exists {
        Ok(there) if there.is_dir() => {
            let remedy = "name the file to write inside it";
            Err(Error::new(ErrorKind::NotAFile, path, "is a directory", remedy))
        }
        Ok(_) if !overwrite => {
            let remedy = "give --overwrite to replace it, or another name";
            Err(Error::new(ErrorKind::Exists, path, "is there already", remedy))
        }
        _ => Ok(()),
    }
}

/// A name in the same folder, so that giving the file its own is one step. Two writers of one process differ too.
fn temporary(path: &Path) -> Result<PathBuf, Error> {
    use std::sync::atomic::{AtomicU64, Ordering};
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let Some(name) = path.file_name() else {
        let remedy = "name the file to write";
        return Err(Error::new(ErrorKind::NotAFile, path, "is no name of a file", remedy));
    };
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let name = format!(".{}.{}-{count}.part", name.to_string_lossy(), std::process::id());
    Ok(path.with_file_name(name))
}
