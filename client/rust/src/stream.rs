//! What can be subscribed to, and under which name it goes in shared memory.

use crate::Error;
use core::fmt;
use core::str::FromStr;

/// A stream of a camera: its events, or one of its views.
///
/// Written as in `lobula echo`: `events`, `view/voxel`, and with `.lossless` at the end for a lossless replay.
///
/// ```
/// use lobula_client::Stream;
/// let stream: Stream = "view/voxel".parse()?;
/// assert_eq!(stream.service_name("cam0"), "lobula/v1/cam0/view/voxel");
/// assert_eq!(Stream::events().lossless().service_name("cam0"), "lobula/v1/cam0/events.lossless");
/// # Ok::<(), lobula_client::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Stream {
    view: Option<String>,
    lossless: bool,
}

impl Stream {
    /// The events.
    pub const fn events() -> Self {
        Self { view: None, lossless: false }
    }

    /// The view of this name.
    pub fn view(name: impl Into<String>) -> Self {
        Self { view: Some(name.into()), lossless: false }
    }

    /// The same stream in a lossless replay: the daemon waits for slow clients instead of overwriting.
    pub fn lossless(self) -> Self {
        Self { lossless: true, ..self }
    }

    /// The name of the view, if it is one.
    pub fn view_name(&self) -> Option<&str> {
        self.view.as_deref()
    }

    /// Whether it is of a lossless replay.
    pub const fn is_lossless(&self) -> bool {
        self.lossless
    }

    /// The name of its iceoryx2 services (publish-subscribe, and event for the wake-up).
    pub fn service_name(&self, camera: &str) -> String {
        format!("lobula/v1/{camera}/{self}")
    }
}

impl fmt::Display for Stream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.view {
            None => f.write_str("events")?,
            Some(name) => write!(f, "view/{name}")?,
        }
        if self.lossless { f.write_str(".lossless") } else { Ok(()) }
    }
}

impl FromStr for Stream {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let (base, lossless) = match text.strip_suffix(".lossless") {
            Some(base) => (base, true),
            None => (text, false),
        };
        let stream = match base.strip_prefix("view/") {
            Some(name) => Self::view(check_name("view", name)?),
            None if base == "events" => Self::events(),
            None => {
                return Err(Error::Invalid {
                    message: format!("`{text}` is no stream: write `events` or `view/NAME`"),
                });
            }
        };
        Ok(Self { lossless, ..stream })
    }
}

/// Checks the name of a camera or view, which becomes part of the names of services: 1 to 32 of `a-z 0-9 _ -`.
pub fn check_name<'a>(what: &str, name: &'a str) -> Result<&'a str, Error> {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-';
    if (1..=32).contains(&name.len()) && name.chars().all(allowed) {
        return Ok(name);
    }
    Err(Error::Invalid {
        message: format!("`{name}` cannot name a {what}: use 1 to 32 of the characters a-z, 0-9, _ and -"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back() {
        for text in ["events", "events.lossless", "view/voxel", "view/a-b_3.lossless"] {
            assert_eq!(text.parse::<Stream>().unwrap().to_string(), text);
        }
        for bad in ["", "event", "view/", "view/A", "view/a/b", "view/ä", "events.lossless.lossless"] {
            assert!(bad.parse::<Stream>().is_err(), "{bad}");
        }
    }
}
