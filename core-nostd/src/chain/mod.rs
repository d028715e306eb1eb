//! Stages chosen at run time from settings: the one parser of them for daemon, tool and Python.

mod view;

pub use view::{BadView, Canvas, Line, Offline, PushError, View, ViewSpec};
