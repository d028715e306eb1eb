//! The instance's directory: made by the daemon alone, closed to others, held by one daemon at a time.

use lobula_client::{Error, Root, transport};
use std::fs::{self, DirBuilder, File, TryLockError};
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};

/// The instance's directory, for as long as this daemon holds its lock.
#[derive(Debug)]
pub struct Gate {
    root: Root,
    _lock: File,
}

impl Gate {
    /// Makes the directory where there is none (mode 0700) and takes its lock.
    ///
    /// # Errors
    /// [`Error::InUse`]: another daemon holds it. [`Error::Permission`]: it is somebody else's. [`Error::Invalid`]:
    /// it is open to everybody, or no directory.
    pub fn enter(root: &Root) -> Result<Self, Error> {
        make(root)?;
        check(root)?;
        let lock = lock(root)?;
        // What a killed daemon left behind would answer nobody.
        let _ = fs::remove_file(root.control_socket());
        Ok(Self { root: root.clone(), _lock: lock })
    }

    /// The instance.
    pub fn root(&self) -> &Root {
        &self.root
    }

    /// Removes all that this instance had in the directory, and the directory, unless a client still has shared memory
    /// open. Nodes of this process must be gone.
    pub fn leave(self) {
        let path = self.root.path();
        let _ = fs::remove_file(self.root.control_socket());
        let nodes_left = fs::read_dir(path.join("nodes")).is_ok_and(|mut nodes| nodes.next().is_some());
        if nodes_left {
            return;
        }
        for directory in ["nodes", "services"] {
            let _ = fs::remove_dir(path.join(directory));
        }
        for entry in fs::read_dir(path).into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(transport::PREFIX) {
                let _ = fs::remove_file(entry.path());
            }
        }
        let _ = fs::remove_file(self.root.lock_file());
        // Not empty, or a mount point: then it stays.
        let _ = fs::remove_dir(path);
    }
}

fn make(root: &Root) -> Result<(), Error> {
    match DirBuilder::new().mode(0o700).create(root.path()) {
        Ok(()) => Ok(()),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(()),
        Err(error) => {
            let path = root.path().parent().unwrap_or(root.path()).display();
            let message =
                format!("{root} cannot be made ({error}): make {path}, or give another instance.root");
            Err(Error::Invalid { message })
        }
    }
}

fn check(root: &Root) -> Result<(), Error> {
    let invalid = |why: &str| Err(Error::Invalid { message: format!("{root} {why}") });
    let Ok(meta) = fs::symlink_metadata(root.path()) else {
        return Err(Error::Permission { root: root.clone() });
    };
    if !meta.is_dir() {
        return invalid("is no directory: remove it, or give another instance.root");
    }
    if meta.mode() & 0o007 != 0 {
        return invalid("is open to everybody: close it (chmod o-rwx), or give another instance.root");
    }
    Ok(())
}

fn lock(root: &Root) -> Result<File, Error> {
    let failed = |error: std::io::Error| match error.kind() {
        ErrorKind::PermissionDenied => Error::Permission { root: root.clone() },
        _ => Error::Transport { message: format!("{}: {error}", root.lock_file().display()) },
    };
    loop {
        let file = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(root.lock_file())
            .map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(Error::InUse { root: root.clone() }),
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        // The daemon before may have removed the file between our opening and locking it.
        let ours = file.metadata().map_err(failed)?.ino();
        if fs::metadata(root.lock_file()).is_ok_and(|meta| meta.ino() == ours) {
            return Ok(file);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn root(folder: &tempfile::TempDir) -> Root {
        Root::new(folder.path().join("root")).unwrap()
    }

    #[test]
    fn one_daemon_at_a_time_and_nothing_left() {
        let folder = tempfile::tempdir().unwrap();
        let root = root(&folder);
        let gate = Gate::enter(&root).unwrap();
        assert_eq!(fs::metadata(root.path()).unwrap().mode() & 0o777, 0o700);
        assert_eq!(Gate::enter(&root).unwrap_err(), Error::InUse { root: root.clone() });
        gate.leave();
        assert!(!root.path().exists());
        Gate::enter(&root).unwrap();
    }

    #[test]
    fn an_open_directory_or_a_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let root = root(&folder);
        fs::write(root.path(), "").unwrap();
        assert!(Gate::enter(&root).unwrap_err().to_string().contains("is no directory"));
        fs::remove_file(root.path()).unwrap();
        fs::create_dir(root.path()).unwrap();
        fs::set_permissions(root.path(), fs::Permissions::from_mode(0o755)).unwrap();
        assert!(Gate::enter(&root).unwrap_err().to_string().contains("open to everybody"));
    }

    #[test]
    fn a_client_that_stays_keeps_its_files() {
        let folder = tempfile::tempdir().unwrap();
        let root = root(&folder);
        let gate = Gate::enter(&root).unwrap();
        fs::create_dir_all(root.path().join("nodes/somebody")).unwrap();
        fs::write(root.path().join("l_file"), "").unwrap();
        gate.leave();
        assert!(root.path().join("l_file").exists() && !root.control_socket().exists());
    }
}
