//! Which daemon: an instance is a directory, and the directory's mode is its gate.

use crate::Error;
use core::fmt;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The directory of an instance of the daemon. All its shared memory, its control socket and its lock lie in it.
///
/// The daemon alone makes it. Two daemons with different roots know nothing of each other, so tests run side by side.
///
/// ```
/// use lobula_client::Root;
/// let root = Root::new("/dev/shm/lobula-test")?;
/// assert_eq!(root.control_socket().to_str(), Some("/dev/shm/lobula-test/control.sock"));
/// # Ok::<(), lobula_client::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Root(PathBuf);

impl Root {
    /// The longest path of a root in bytes, since names of sockets within it are bounded by the system.
    pub const LEN_MAX: usize = 48;
    /// Where the `system` gate lies: a tmpfs of user and group `lobula`, mode 0750, whose group may read.
    pub const SYSTEM: &'static str = "/run/lobula";
    /// The variable that names the root.
    pub const ENV: &'static str = "LOBULA_ROOT";

    /// The instance in directory `path`, which must be absolute and at most [`Self::LEN_MAX`] bytes of UTF-8.
    pub fn new(path: impl Into<PathBuf>) -> Result<Self, Error> {
        let path = path.into();
        let invalid =
            |why: &str| Error::Invalid { message: format!("instance root {}: {why}", path.display()) };
        let text = path.to_str().ok_or_else(|| invalid("give a path of plain text"))?;
        if !path.is_absolute() || text.contains("..") || path.parent().is_none() {
            return Err(invalid("give an absolute path, such as /dev/shm/lobula-test"));
        }
        if text.len() > Self::LEN_MAX {
            return Err(invalid(&format!(
                "{} bytes are too long for the names of sockets: give at most {}",
                text.len(),
                Self::LEN_MAX
            )));
        }
        Ok(Self(path.components().collect()))
    }

    /// The instance of this user: `/dev/shm/lobula-<uid>`, mode 0700. The default, which needs no set-up.
    pub fn user() -> Self {
        Self(PathBuf::from(format!("/dev/shm/lobula-{}", uid())))
    }

    /// The instance of the machine: `/run/lobula`.
    pub fn system() -> Self {
        Self(PathBuf::from(Self::SYSTEM))
    }

    /// The instance a daemon serves when nothing else is said: [`LOBULA_ROOT`](Self::ENV), else [`Self::user`].
    pub fn from_env() -> Result<Self, Error> {
        match std::env::var_os(Self::ENV) {
            Some(path) if !path.is_empty() => Self::new(PathBuf::from(path)),
            _ => Ok(Self::user()),
        }
    }

    /// The instance a client looks for when nothing else is said: as [`Self::from_env`], and that of the machine where
    /// this user has none.
    pub fn find() -> Result<Self, Error> {
        let root = Self::from_env()?;
        let named = std::env::var_os(Self::ENV).is_some_and(|path| !path.is_empty());
        if !named && !root.0.exists() && Path::new(Self::SYSTEM).exists() {
            return Ok(Self::system());
        }
        Ok(root)
    }

    /// The directory.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Where the daemon listens for control.
    pub fn control_socket(&self) -> PathBuf {
        self.0.join("control.sock")
    }

    /// The file that the one daemon of the instance keeps locked.
    pub fn lock_file(&self) -> PathBuf {
        self.0.join("lock")
    }

    /// Identity of the directory, which changes when it is removed and made again.
    pub(crate) fn identity(&self) -> Result<(u64, u64), Error> {
        match std::fs::metadata(&self.0) {
            Ok(meta) => Ok((meta.dev(), meta.ino())),
            Err(error) if error.kind() == std::io::ErrorKind::PermissionDenied => {
                Err(Error::Permission { root: self.clone() })
            }
            Err(_) => Err(Error::NoDaemon { root: self.clone() }),
        }
    }
}

impl fmt::Display for Root {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.display().fmt(f)
    }
}

#[allow(unsafe_code)] // std has no getuid
fn uid() -> u32 {
    // SAFETY: getuid has no preconditions and cannot fail.
    unsafe { libc::getuid() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_are_absolute_and_short() {
        for bad in ["", "relative", "/", "/dev/shm/../etc", &format!("/{}", "x".repeat(Root::LEN_MAX))] {
            assert!(matches!(Root::new(bad), Err(Error::Invalid { .. })), "{bad:?}");
        }
        let longest = format!("/{}", "x".repeat(Root::LEN_MAX - 1));
        assert_eq!(Root::new(&longest).unwrap().path(), Path::new(&longest));
        assert_eq!(Root::new("/a//b/").unwrap().path(), Path::new("/a/b"));
    }
}
