//! Room in the file system of an instance. Files there are sparse: where room is short, a write would end the process
//! with SIGBUS, so it is asked for beforehand and, for what must never fail, taken.

use crate::{Error, Root};
use std::ffi::CString;
use std::fs::File;
use std::os::fd::AsRawFd;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

/// Bytes free in the file system of an existing instance directory (or its nearest existing parent).
#[allow(unsafe_code)] // std cannot ask a file system for its room
pub fn free_bytes(root: &Root) -> Result<u64, Error> {
    let failed = |what: &str| Error::Transport { message: format!("{root}: {what}") };
    let existing = root.path().ancestors().find(|path| path.exists()).unwrap_or(Path::new("/"));
    let path = CString::new(existing.as_os_str().as_bytes()).map_err(|_| failed("not a path"))?;
    let mut stat = core::mem::MaybeUninit::<libc::statvfs>::uninit();
    // SAFETY: `path` ends with a zero byte and `stat` is room for one statvfs; both live through the call.
    let status = unsafe { libc::statvfs(path.as_ptr(), stat.as_mut_ptr()) };
    if status != 0 {
        return Err(failed(&std::io::Error::last_os_error().to_string()));
    }
    // SAFETY: statvfs returned 0, so it has filled the structure.
    let stat = unsafe { stat.assume_init() };
    Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
}

/// Takes the whole of the segment of publisher `id`, so that no write to it can fail later.
#[allow(unsafe_code)] // std cannot reserve blocks of a file
pub fn reserve(root: &Root, id: u128) -> Result<(), Error> {
    let suffix = format!("_{id}.data");
    let segments =
        std::fs::read_dir(root.path()).map_err(|error| Error::transport("list the instance", error))?;
    for entry in segments.flatten() {
        if !entry.file_name().to_string_lossy().ends_with(&suffix) {
            continue;
        }
        let failed = |error: std::io::Error| Error::transport("reserve shared memory", error);
        let file = File::options().read(true).write(true).open(entry.path()).map_err(failed)?;
        let len = file.metadata().map_err(failed)?.len();
        // SAFETY: the descriptor is open for as long as `file` lives.
        let status = unsafe { libc::posix_fallocate(file.as_raw_fd(), 0, len as libc::off_t) };
        return match status {
            0 => Ok(()),
            libc::ENOSPC => Err(Error::NoSpace { root: root.clone(), need: len, free: free_bytes(root)? }),
            code => Err(failed(std::io::Error::from_raw_os_error(code))),
        };
    }
    Err(Error::Transport { message: format!("{root}: the segment of publisher {id} is not there") })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_is_that_of_the_nearest_directory() {
        let root = Root::new("/dev/shm/lobula-not-there/deeper").unwrap();
        assert!(free_bytes(&root).unwrap() > 0);
    }
}
